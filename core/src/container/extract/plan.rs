//! What there is to extract: the parts of a container, bundle or archive, with names and facts.

use std::collections::HashMap;
use std::path::Path;

use serde_json::Value;

use super::names::{safe_part, safe_path};
use crate::container::error::Error;
use crate::container::members::{Member, list_members};
use crate::container::references::{Reference, collect_references, is_part};
use crate::container::segments::{Container, HEADER, MAGIC, SegmentKind};
use crate::container::{file, json};

/// A file to be written.
pub(super) struct Item {
    pub(super) member: Member,
    pub(super) name: String,
    pub(super) what: String,
    pub(super) facts: Value,
    /// Width and height of the depth map it is, if it is one.
    pub(super) depth: Option<(usize, usize)>,
}

/// What the file at `source` holds, each part with the name to give it; and warnings.
pub(super) fn plan_items(source: &Path) -> Result<(Vec<Item>, Vec<String>), Error> {
    let head = file::head(source, 8)?;
    if head == MAGIC {
        let container = Container::open(source)?;
        let contents = container.contents()?;
        if !contents.iter().any(|c| c.get("files").is_some_and(Value::is_array)) {
            return plan_segments(&container, &contents);
        }
    }
    let found = list_members(source)?;
    let item =
        |m: Member| Item { name: safe_path(&m.name), what: m.name.clone(), facts: Value::Null, depth: None, member: m };
    Ok((found.list.into_iter().map(item).collect(), found.warnings))
}

/// The segments of a capture or a processed file.
fn plan_segments(container: &Container, contents: &[Value]) -> Result<(Vec<Item>, Vec<String>), Error> {
    let mut warnings = container.warnings.clone();
    let mut used: HashMap<String, (&Value, Reference)> = HashMap::new();
    for c in contents {
        for r in collect_references(c) {
            if is_part(&r) {
                if container.find(&r.sha1).is_none() {
                    warnings.push(format!("{} ({}) is named by the file but is not in it", r.path, r.sha1));
                }
                used.entry(r.sha1.clone()).or_insert((c, r));
            }
        }
    }
    let mut items = Vec::new();
    for s in &container.segments {
        let member = Member {
            name: String::new(),
            path: container.path().to_path_buf(),
            offset: s.offset + HEADER,
            length: s.length,
            sha1: Some(s.sha1.clone()),
            archive: None,
        };
        let head = container.head(s, 64)?;
        let item = match used.get(&s.sha1) {
            _ if s.kind == SegmentKind::Contents => Item {
                member,
                name: "contents.json".into(),
                what: "table of contents".into(),
                facts: Value::Null,
                depth: None,
            },
            Some((contents, r)) => {
                let (name, facts, depth) = segment_role(contents, &r.path, &head);
                Item { member, name, what: r.path.clone(), facts, depth }
            }
            None => {
                let name = format!("segment-{:02}.{}", items.len(), extension_by_content(&head, "bin"));
                Item { member, name, what: "named by nothing in the file".into(), facts: Value::Null, depth: None }
            }
        };
        items.push(item);
    }
    Ok((items, warnings))
}

/// Name and facts of the segment that `path` refers to.
fn segment_role(contents: &Value, path: &str, head: &[u8]) -> (String, Value, Option<(usize, usize)>) {
    let (parent, key) = path.rsplit_once('.').unwrap_or(("", path));
    let node = json::value_at(contents, parent).unwrap_or(&Value::Null);
    let size = || {
        let side =
            |k| json::integer_at(node, k).and_then(|n| usize::try_from(n).ok()).filter(|n| (1..=1 << 15).contains(n));
        Some((side("width")?, side("height")?))
    };
    let facts = |keys: &[&str]| {
        keys.iter()
            .filter_map(|k| Some((k.to_string(), node.get(k)?.clone())))
            .collect::<serde_json::Map<_, _>>()
            .into()
    };
    let acceleration = parent.find("accelerationArray.").and_then(|at| {
        let number = parent[at..].split('.').nth(1)?;
        json::text_at(contents, &format!("{}accelerationArray.{number}.type", &parent[..at]))
    });
    let stack = acceleration.as_deref().and_then(|t| t.rsplit('.').next()).unwrap_or("");
    let index = || parent.rsplit('.').next().and_then(|n| n.parse::<usize>().ok()).unwrap_or(0);
    if key == "imageRef" && parent.contains("imageArray") {
        return (
            format!("refocus-{:02}.{}", index(), extension_by_content(head, "bin")),
            facts(&["lambda", "width", "height"]),
            None,
        );
    }
    if key == "imageRef" && (parent.ends_with("depthLut") || stack == "depthMap") {
        return ("depth.raw".into(), facts(&["width", "height", "minLambda", "maxLambda"]), size());
    }
    if key == "blockOfImagesRef" {
        let name = if stack == "edofParallax" { "parallax" } else { "refocus" };
        let frames = node.get("metadataArray").cloned().unwrap_or_default();
        let extension = json::text_at(node, "representation")
            .filter(|r| r == "h264")
            .unwrap_or_else(|| extension_by_content(head, "bin").into());
        return (format!("{name}.{extension}"), serde_json::json!({ "frames": frames }), None);
    }
    let in_frame = parent.ends_with("frame");
    let name = match key {
        // Under one name, so that the raw image finds its metadata beside it.
        "imageRef" if in_frame => "image.raw".into(),
        "metadataRef" if in_frame => "image.json".into(),
        "privateMetadataRef" => "private.json".into(),
        "modulationDataRef" => "white.raw".into(),
        "modulationDataMetadataRef" => "white.json".into(),
        "imageRef" if parent.contains("thumbnail") => {
            format!("thumbnail-{:02}.{}", index(), extension_by_content(head, "bin"))
        }
        _ => format!("{}.{}", safe_part(key.strip_suffix("Ref").unwrap_or(key)), extension_by_content(head, "bin")),
    };
    (name, facts(&["width", "height", "representation"]), None)
}

/// File extension by content.
fn extension_by_content(head: &[u8], otherwise: &'static str) -> &'static str {
    if head.starts_with(&[0xff, 0xd8, 0xff]) {
        "jpg"
    } else if head.starts_with(b"\x89PNG") {
        "png"
    } else if head.starts_with(&[0, 0, 0, 1]) {
        "h264"
    } else if json::looks_like_object(head) {
        "json"
    } else {
        otherwise
    }
}
