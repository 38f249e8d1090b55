//! HTML documents that load nothing from outside: escaping, the content-security policy, the document around a body.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest as _, Sha256};

/// Style that reports and the viewer share.
pub const STYLE: &str = include_str!("style.css");
/// What the scripts of reports and of the viewer begin with.
pub const COMMON_SCRIPT: &str = include_str!("common.js");

/// Bytes in base 64, as `data:` addresses have them.
pub fn base64_of(bytes: &[u8]) -> String {
    STANDARD.encode(bytes)
}

/// Text made safe for HTML, in elements and in quoted attributes.
///
/// ```
/// assert_eq!(lenslet::page::escape_html("a < b & \"c\""), "a &lt; b &amp; &quot;c&quot;");
/// ```
pub fn escape_html(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

/// The content-security policy of a page with the given inline script and style: it allows these two, by their SHA-256,
/// and embedded pictures, nothing else.
pub fn content_security_policy(script: &str, style: &str) -> String {
    let hash = |text: &str| STANDARD.encode(Sha256::digest(text.as_bytes()));
    format!(
        "default-src 'none'; img-src data:; script-src 'sha256-{}'; style-src 'sha256-{}'; base-uri 'none'; form-action 'none'",
        hash(script),
        hash(style)
    )
}

/// A whole HTML document with its title (any text, escaped here), one style, a body of HTML and the script at its end,
/// under the [`content_security_policy`] of the two.
pub fn html_document(title: &str, style: &str, body: &str, script: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <title>{}</title>\n<style>{style}</style></head>\n<body>{body}\n<script>{script}</script>\n</body></html>\n",
        escape_html(&content_security_policy(script, style)),
        escape_html(title)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_policy_carries_the_right_hashes() {
        // SHA-256 of the empty text, a published constant, in base 64.
        let policy = content_security_policy("", "");
        assert_eq!(policy.matches("47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU=").count(), 2);
    }
}
