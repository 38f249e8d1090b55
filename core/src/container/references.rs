//! The roles of segments: every `sha1-…` in a container's JSON, with the key that refers to it.

use std::collections::HashMap;

use serde_json::Value;

/// One mention of a segment.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reference {
    /// Where in the JSON it is named, e.g. `picture.frameArray.0.frame.imageRef`.
    pub path: String,
    /// `sha1-…` in lower case.
    pub sha1: String,
}

/// Whether `text` is `sha1-` and 40 hexadecimal digits.
pub fn is_sha1(text: &str) -> bool {
    text.len() == 45
        && text.get(..5).is_some_and(|p| p.eq_ignore_ascii_case("sha1-"))
        && text.bytes().skip(5).all(|b| b.is_ascii_hexdigit())
}

/// Every reference in `value`, in document order.
///
/// ```
/// use lenslet_core::container::references::collect_references;
///
/// let sha1 = format!("sha1-{}", "a".repeat(40));
/// let found = collect_references(&serde_json::json!({"frame": {"imageRef": sha1}}));
/// assert_eq!(found[0].path, "frame.imageRef");
/// ```
pub fn collect_references(value: &Value) -> Vec<Reference> {
    let mut out = Vec::new();
    collect_below(value, String::new(), &mut out);
    out
}

fn collect_below(value: &Value, path: String, out: &mut Vec<Reference>) {
    let join = |key: &str| if path.is_empty() { key.to_string() } else { format!("{path}.{key}") };
    match value {
        Value::String(text) if is_sha1(text) => out.push(Reference { path, sha1: text.to_ascii_lowercase() }),
        Value::Array(items) => {
            for (k, item) in items.iter().enumerate() {
                if matches!(item, Value::Array(_) | Value::Object(_) | Value::String(_)) {
                    collect_below(item, join(&k.to_string()), out);
                }
            }
        }
        Value::Object(items) => {
            for (key, item) in items {
                collect_below(item, join(key), out);
            }
        }
        _ => {}
    }
}

/// First mention of each segment, by its sha1.
pub fn by_sha1(references: &[Reference]) -> HashMap<&str, &Reference> {
    let mut map = HashMap::new();
    for r in references {
        map.entry(r.sha1.as_str()).or_insert(r);
    }
    map
}

/// Whether a reference names a part of this file (keys ending in `Ref`), not an ancestor in another file
/// (`derivationArray`).
pub fn is_part(reference: &Reference) -> bool {
    reference.path.rsplit('.').next().is_some_and(|key| key.ends_with("Ref"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references_are_found_with_their_place() {
        let a = format!("sha1-{}", "a".repeat(40));
        let v = serde_json::json!({"f": [{"imageRef": a.to_uppercase(), "n": 1}], "derivationArray": [a, "sha1-short"], "x": "sha1-é"});
        let found = collect_references(&v);
        assert_eq!(found.len(), 2);
        assert_eq!(found[0].path, "f.0.imageRef");
        assert_eq!(found[0].sha1, a);
        assert!(is_part(&found[0]) && !is_part(&found[1]));
        assert_eq!(by_sha1(&found).len(), 1);
    }
}
