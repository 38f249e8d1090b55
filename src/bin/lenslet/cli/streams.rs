//! Where text leaves the program: the only place that writes to stdout and stderr.
//!
//! A message that cannot be told (its reader is gone, the disk of the log is full) changes nothing about the work. An
//! answer that is lost is a failure. Much of the text comes from files: what a terminal would obey is written as an escape.

use std::borrow::Cow;
use std::io::{self, Write};

/// Whether a terminal obeys the character instead of showing it: controls (but line break and tab), and marks that turn
/// the direction of text.
fn is_obeyed(c: char) -> bool {
    (c.is_control() && c != '\n' && c != '\t')
        || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Text in which a terminal obeys nothing: such characters become `\u202e`, which JSON reads as the same character.
pub fn tame(text: &str) -> Cow<'_, str> {
    if !text.contains(is_obeyed) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_obeyed(c) {
            out.push_str(&format!("\\u{:04x}", u32::from(c)));
        } else {
            out.push(c);
        }
    }
    Cow::Owned(out)
}

/// A line on stderr, whether or not anyone reads it.
pub fn tell(line: &str) {
    let mut text = tame(line).into_owned();
    text.push('\n');
    let mut out = io::stderr().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

/// The answer on stdout. A reader that has seen enough and closed the pipe is no error.
///
/// # Errors
/// When it cannot be written whole, as on a full disk.
pub fn answer(text: &str) -> io::Result<()> {
    let text = text.trim_end();
    if text.is_empty() {
        return Ok(());
    }
    let text = tame(text);
    let mut out = io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(e) if e.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        written => written,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_terminal_obeys_nothing_and_json_stays_the_same() {
        assert_eq!(tame("a\u{1b}[31m\u{9b}2J\u{202e}b\r\n\tü"), "a\\u001b[31m\\u009b2J\\u202eb\\u000d\n\tü");
        assert!(matches!(tame("plain text, ünïcode"), Cow::Borrowed(_)));
        let value = serde_json::json!({"serial": "A\u{1b}\u{85}\u{2066}\u{202e}B"});
        let told = tame(&value.to_string()).into_owned();
        assert!(told.is_ascii());
        assert_eq!(serde_json::from_str::<serde_json::Value>(&told).unwrap(), value);
    }
}
