//! Captures taken apart, changed and put together again, from the published layout of the container.

use std::path::Path;

use lenslet_core::container::references::{by_sha1, collect_references};
use lenslet_core::container::segments::{Container, sha1_of};
use serde_json::Value;

/// The container at `path`, each part as `edit` makes it of what it is used as (`metadataRef`, `imageRef` …) and its bytes.
pub fn edited(path: &Path, mut edit: impl FnMut(&str, Vec<u8>) -> Vec<u8>) -> Vec<u8> {
    let container = Container::open(path).unwrap();
    let contents: Vec<Value> = container.contents().unwrap();
    let named: Vec<_> = contents.iter().flat_map(collect_references).collect();
    let named = by_sha1(&named);
    let mut parts = Vec::new();
    let mut renamed = Vec::new();
    for segment in &container.segments {
        let bytes = container.payload(segment).unwrap();
        let used = named.get(segment.sha1.as_str()).and_then(|r| r.path.rsplit('.').next()).unwrap_or("contents");
        let bytes = if used == "contents" { bytes } else { edit(used, bytes) };
        renamed.push((segment.sha1.clone(), sha1_of(&bytes)));
        parts.push((segment.kind.name(), bytes));
    }
    let mut out = b"\x89LFP\r\n\x1a\n\0\0\0\x01\0\0\0\0".to_vec();
    for (kind, mut bytes) in parts {
        if kind == "LFM" {
            let text = String::from_utf8(bytes).unwrap();
            bytes = renamed.iter().fold(text, |t, (old, new)| t.replace(old, new)).into_bytes();
            bytes = edit("contents", bytes);
        }
        out.push(0x89);
        out.extend(kind.as_bytes());
        out.extend(b"\r\n\x1a\n\0\0\0\0");
        out.extend((bytes.len() as u32).to_be_bytes());
        out.extend(sha1_of(&bytes).as_bytes());
        out.extend([0; 35]);
        out.extend(&bytes);
        out.resize(out.len().next_multiple_of(16), 0);
    }
    out
}

/// A JSON document after `change`.
pub fn changed(bytes: &[u8], change: impl FnOnce(&mut Value)) -> Vec<u8> {
    let mut value: Value = serde_json::from_slice(bytes).unwrap();
    change(&mut value);
    serde_json::to_vec_pretty(&value).unwrap()
}

/// A .tar archive of these files.
pub fn archive(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut out = Vec::new();
    for (name, bytes) in files {
        let mut head = [0u8; 512];
        head[..name.len()].copy_from_slice(name.as_bytes());
        head[100..107].copy_from_slice(b"0000644");
        head[124..135].copy_from_slice(format!("{:011o}", bytes.len()).as_bytes());
        head[156] = b'0';
        head[257..263].copy_from_slice(b"ustar\0");
        head[263..265].copy_from_slice(b"00");
        head[148..156].fill(b' ');
        let sum: u32 = head.iter().map(|b| u32::from(*b)).sum();
        head[148..155].copy_from_slice(format!("{sum:06o}\0").as_bytes());
        out.extend(head);
        out.extend(*bytes);
        out.resize(out.len().next_multiple_of(512), 0);
    }
    out.resize(out.len() + 1024, 0);
    out
}
