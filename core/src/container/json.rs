//! JSON as cameras write it: bytes after the last brace are tolerated, sizes and depth are bounded.

use serde::Deserialize;
use serde_json::Value;

/// Longest JSON text parsed. The worst text (`[0,0,…]`) takes about 40 times its length in memory, so this bounds it to
/// about 330 MiB.
pub const MAX_TEXT: usize = 8 << 20;

/// Longest JSON text that [`parse_damaged`] shortens, bytes.
/// Source: chosen.
pub const MAX_DAMAGED: usize = 64 << 20;

/// Strings longer than this are left out of a text that is too long, bytes; no fact of a camera is that long.
/// Source: chosen.
const LONG_STRING: usize = 4096;

/// Parses the first JSON value of `bytes`; what follows it is ignored, nesting deeper than 128 is refused.
///
/// # Errors
/// A line that says what is wrong, when the text is too long or not JSON.
///
/// ```
/// use lenslet_core::container::json;
///
/// let value = json::parse(b"{\"frames\": [{\"iso\": 80.0}]}\0\0").unwrap(); // padding is ignored
/// assert_eq!(json::integer_at(&value, "frames.0.iso"), Some(80));
/// assert!(json::parse(b"{").is_err());
/// ```
pub fn parse(bytes: &[u8]) -> Result<Value, String> {
    if bytes.len() > MAX_TEXT {
        return Err(format!("JSON text of {} bytes, more than the {MAX_TEXT} allowed", bytes.len()));
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    Value::deserialize(&mut serde_json::Deserializer::from_slice(bytes)).map_err(|e| format!("not valid JSON: {e}"))
}

/// Parses JSON that is damaged in a few places, as [`parse`] else: bytes that are not UTF-8 are taken as Latin-1, `NaN`
/// and `Infinity` as null, and of a text too long for [`parse`] the long strings are left out. Says what was mended.
///
/// # Errors
/// As [`parse`], where the text cannot be read in that way either.
///
/// ```
/// use lenslet_core::container::json;
///
/// let (value, mended) = json::parse_damaged(b"{\"owner\": \"J\xfcrgen\", \"lambda\": NaN, \"iso\": 80}").unwrap();
/// assert_eq!((json::integer_at(&value, "iso"), json::text_at(&value, "owner").unwrap()), (Some(80), "Jürgen".into()));
/// assert!(mended.unwrap().contains("line 1"));
/// assert_eq!(json::parse_damaged(b"{}").unwrap().1, None);
/// ```
pub fn parse_damaged(bytes: &[u8]) -> Result<(Value, Option<String>), String> {
    let reason = match parse(bytes) {
        Ok(value) => return Ok((value, None)),
        Err(reason) => reason,
    };
    if bytes.len() > MAX_DAMAGED {
        return Err(reason);
    }
    let mended = mend(bytes);
    match parse(&mended) {
        Ok(value) => Ok((value, Some(format!("{reason}; what can be read of it is used")))),
        Err(_) => Err(reason),
    }
}

/// The text with long strings left out, and with valid bytes and words for those that are not.
fn mend(bytes: &[u8]) -> Vec<u8> {
    let shorten = bytes.len() > MAX_TEXT;
    let mut out = Vec::with_capacity(bytes.len().min(MAX_TEXT) + 64);
    let mut k = 0;
    while k < bytes.len() {
        let rest = &bytes[k..];
        if bytes[k] == b'"' {
            let length = string_length(rest);
            if !(shorten && length > LONG_STRING) {
                for part in rest[..length].utf8_chunks() {
                    out.extend_from_slice(part.valid().as_bytes());
                    let latin: String = part.invalid().iter().map(|&b| char::from(b)).collect();
                    out.extend_from_slice(latin.as_bytes());
                }
            } else {
                out.extend_from_slice(b"\"\"");
            }
            k += length;
            continue;
        }
        let word = [&b"-Infinity"[..], b"Infinity", b"-NaN", b"NaN"].into_iter().find(|w| rest.starts_with(w));
        match word {
            Some(word) => {
                out.extend_from_slice(b"null");
                k += word.len();
            }
            None => {
                out.push(bytes[k]);
                k += 1;
            }
        }
    }
    out
}

/// Length of the string that begins `bytes`, both quotes included; all of them where it does not end.
fn string_length(bytes: &[u8]) -> usize {
    let mut k = 1;
    while k < bytes.len() {
        match bytes[k] {
            b'"' => return k + 1,
            b'\\' => k += 2,
            _ => k += 1,
        }
    }
    bytes.len()
}

/// Whether `bytes` look like the start of a JSON object.
pub fn looks_like_object(bytes: &[u8]) -> bool {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    bytes.iter().find(|b| !b.is_ascii_whitespace()) == Some(&b'{')
}

/// The value at a dotted path such as `picture.frameArray.0.frame`; numbers index arrays.
pub fn value_at<'a>(value: &'a Value, path: &str) -> Option<&'a Value> {
    path.split('.').try_fold(value, |v, key| match v {
        Value::Array(a) => a.get(key.parse::<usize>().ok()?),
        _ => v.get(key),
    })
}

/// The finite number at `path`.
pub fn number_at(value: &Value, path: &str) -> Option<f64> {
    value_at(value, path)?.as_f64().filter(|x| x.is_finite())
}

/// The whole number at `path` (a number with a zero fraction counts).
pub fn integer_at(value: &Value, path: &str) -> Option<i64> {
    let v = value_at(value, path)?;
    v.as_i64().or_else(|| v.as_f64().filter(|x| x.fract() == 0.0 && x.abs() < 9e15).map(|x| x as i64))
}

/// The text at `path`.
pub fn text_at(value: &Value, path: &str) -> Option<String> {
    Some(value_at(value, path)?.as_str()?.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tolerates_trailing_bytes_and_refuses_depth() {
        assert_eq!(number_at(&parse(b"{\"a\":[1.5e-006]}\0\0garbage").unwrap(), "a.0"), Some(1.5e-6));
        let deep = [b"[".repeat(100_000), b"]".repeat(100_000)].concat();
        assert!(parse(&deep).unwrap_err().contains("recursion"));
        assert!(parse(b"{\"a\": NaN}").is_err());
        assert!(parse(b"").is_err());
        assert!(parse(&vec![b' '; MAX_TEXT + 1]).is_err());
    }

    #[test]
    fn values_are_read_at_dotted_paths() {
        let v = parse(br#"{"f":[{"g":{"n":3.0,"s":"x"}}],"big":1e300}"#).unwrap();
        assert_eq!(integer_at(&v, "f.0.g.n"), Some(3));
        assert_eq!(text_at(&v, "f.0.g.s").as_deref(), Some("x"));
        assert_eq!(integer_at(&v, "big"), None);
        assert!(value_at(&v, "f.1.g").is_none() && value_at(&v, "f.x").is_none());
    }
}
