//! Everything a container, calibration bundle or archive holds, as files in a folder: under safe names, never outside it.

use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Component, Path, PathBuf};

use serde_json::{Value, json};
use sha1::{Digest, Sha1};

use super::members::{Member, members};
use super::references::{Reference, collect};
use super::segments::{Container, HEADER, Kind, MAGIC};
use super::{Error, depth, file, json as paths};
use crate::output::Pending;
use crate::pfm;
use crate::progress::Observer;

/// Bytes copied at once.
const STEP: u64 = 8 << 20;

/// One file written.
#[derive(Debug, Clone, PartialEq)]
pub struct Extracted {
    /// Its name below the folder, parts joined by `/`.
    pub name: String,
    /// Bytes written.
    pub bytes: u64,
    /// What it is: the reference to it, or its name in the bundle.
    pub what: String,
    /// What is known besides (focus, size, range …).
    pub facts: Value,
    /// Whether its sha1 is the one the container names; `None` when nothing names one.
    pub intact: Option<bool>,
}

/// Writes every segment of a container, or every file of a bundle or .tar archive, into the new folder `out`, with
/// `index.json` saying what each file is. Lytro's depth maps come as .pfm and 16-bit .png besides. Returns what was
/// written, and warnings.
///
/// # Errors
/// When `source` cannot be read or is no container, or `out` exists (without `force`) or cannot be written.
pub fn extract(
    source: &Path,
    out: &Path,
    force: bool,
    observer: &dyn Observer,
) -> Result<(Vec<Extracted>, Vec<String>), Error> {
    let (plan, mut warnings) = plan(source)?;
    let pending = Pending::directory(out, force)?;
    let mut written = Vec::new();
    observer.begin("extracting", plan.len() as u64);
    let mut names = Names::default();
    for item in plan {
        let name = names.unique(&item.name);
        let (bytes, intact) = copy(&item.member, &inside(pending.path(), &name), observer)?;
        if intact == Some(false) {
            warnings.push(format!("{name} is damaged: its sha1 is not the one the file names"));
        }
        if let Some((width, height)) = item.depth {
            written.extend(depth_files(&item, (width, height), &name, &mut names, pending.path(), &mut warnings)?);
        }
        written.push(Extracted { name, bytes, what: item.what, facts: item.facts, intact });
        observer.advance(1);
    }
    let index: Vec<Value> = written
        .iter()
        .map(|f| json!({"file": f.name, "bytes": f.bytes, "what": f.what, "intact": f.intact, "facts": f.facts}))
        .collect();
    let index =
        json!({"source": source.file_name().map(|n| n.to_string_lossy()), "files": index, "warnings": warnings});
    let target = inside(pending.path(), "index.json");
    std::fs::write(&target, format!("{index:#}\n"))
        .map_err(|source| Error::Io { path: out.join("index.json"), source })?;
    pending.commit()?;
    Ok((written, warnings))
}

/// A file to be written.
struct Item {
    member: Member,
    name: String,
    what: String,
    facts: Value,
    /// Width and height of the depth map it is, if it is one.
    depth: Option<(usize, usize)>,
}

fn plan(source: &Path) -> Result<(Vec<Item>, Vec<String>), Error> {
    let head = file::head(source, 8)?;
    if head == MAGIC {
        let container = Container::open(source)?;
        let contents = container.contents()?;
        if !contents.iter().any(|c| c.get("files").is_some_and(Value::is_array)) {
            return segments(&container, &contents);
        }
    }
    let found = members(source)?;
    let item =
        |m: Member| Item { name: safe_path(&m.name), what: m.name.clone(), facts: Value::Null, depth: None, member: m };
    Ok((found.list.into_iter().map(item).collect(), found.warnings))
}

/// The segments of a capture or a processed file.
fn segments(container: &Container, contents: &[Value]) -> Result<(Vec<Item>, Vec<String>), Error> {
    let mut warnings = container.warnings.clone();
    let mut used: HashMap<String, (&Value, Reference)> = HashMap::new();
    for c in contents {
        for r in collect(c) {
            if super::references::is_part(&r) {
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
        };
        let head = container.head(s, 64)?;
        let item = match used.get(&s.sha1) {
            _ if s.kind == Kind::Contents => Item {
                member,
                name: "contents.json".into(),
                what: "table of contents".into(),
                facts: Value::Null,
                depth: None,
            },
            Some((contents, r)) => {
                let (name, facts, depth) = role(contents, &r.path, &head);
                Item { member, name, what: r.path.clone(), facts, depth }
            }
            None => {
                let name = format!("segment-{:02}.{}", items.len(), extension(&head, "bin"));
                Item { member, name, what: "named by nothing in the file".into(), facts: Value::Null, depth: None }
            }
        };
        items.push(item);
    }
    Ok((items, warnings))
}

/// Name and facts of the segment that `path` refers to.
fn role(contents: &Value, path: &str, head: &[u8]) -> (String, Value, Option<(usize, usize)>) {
    let (parent, key) = path.rsplit_once('.').unwrap_or(("", path));
    let node = paths::at(contents, parent).unwrap_or(&Value::Null);
    let size = || {
        let side =
            |k| paths::integer(node, k).and_then(|n| usize::try_from(n).ok()).filter(|n| (1..=1 << 15).contains(n));
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
        paths::text(contents, &format!("{}accelerationArray.{number}.type", &parent[..at]))
    });
    let stack = acceleration.as_deref().and_then(|t| t.rsplit('.').next()).unwrap_or("");
    let index = || parent.rsplit('.').next().and_then(|n| n.parse::<usize>().ok()).unwrap_or(0);
    if key == "imageRef" && parent.contains("imageArray") {
        return (
            format!("refocus-{:02}.{}", index(), extension(head, "bin")),
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
        let extension = paths::text(node, "representation")
            .filter(|r| r == "h264")
            .unwrap_or_else(|| extension(head, "bin").into());
        return (format!("{name}.{extension}"), json!({ "frames": frames }), None);
    }
    let in_frame = parent.ends_with("frame");
    let name = match key {
        // Under one name, so that the raw image finds its metadata beside it.
        "imageRef" if in_frame => "image.raw".into(),
        "metadataRef" if in_frame => "image.json".into(),
        "privateMetadataRef" => "private.json".into(),
        "modulationDataRef" => "white.raw".into(),
        "modulationDataMetadataRef" => "white.json".into(),
        "imageRef" if parent.contains("thumbnail") => format!("thumbnail-{:02}.{}", index(), extension(head, "bin")),
        _ => format!("{}.{}", safe_part(key.strip_suffix("Ref").unwrap_or(key)), extension(head, "bin")),
    };
    (name, facts(&["width", "height", "representation"]), None)
}

fn depth_files(
    item: &Item,
    size: (usize, usize),
    raw_name: &str,
    names: &mut Names,
    folder: &Path,
    warnings: &mut Vec<String>,
) -> Result<Vec<Extracted>, Error> {
    let bytes = item.member.read(1 << 30)?;
    let Some(planes) = depth::read_depth_planes(&bytes, size) else {
        warnings.push(format!(
            "{raw_name}: {} bytes do not hold {}x{} depths; only saved as they are",
            bytes.len(),
            size.0,
            size.1
        ));
        return Ok(Vec::new());
    };
    let mut out = Vec::new();
    for (plane, word) in planes.iter().zip(["depth", "confidence"]) {
        let (picture, range) = depth::depth_png(plane.view())
            .ok_or_else(|| Error::malformed(&item.member.path, "a depth map that cannot be a picture"))?;
        for (extension, bytes) in [("pfm", pfm::to_bytes(plane.view())), ("png", picture)] {
            let name = names.unique(&format!("{word}.{extension}"));
            let target = inside(folder, &name);
            std::fs::write(&target, &bytes).map_err(|source| Error::Io { path: target, source })?;
            let facts = match (extension, range) {
                ("png", Some((low, high))) => json!({"lambda_at_0": low, "lambda_at_65535": high}),
                _ => Value::Null,
            };
            let what = format!("{word} map of {raw_name}, {}x{}", size.0, size.1);
            out.push(Extracted { name, bytes: bytes.len() as u64, what, facts, intact: None });
        }
    }
    Ok(out)
}

fn copy(member: &Member, target: &Path, observer: &dyn Observer) -> Result<(u64, Option<bool>), Error> {
    let io = |source| Error::Io { path: target.to_path_buf(), source };
    if let Some(parent) = target.parent() {
        std::fs::create_dir_all(parent).map_err(io)?;
    }
    let mut out = BufWriter::new(File::create_new(target).map_err(io)?);
    let mut hash = Sha1::new();
    let mut done = 0;
    while done < member.length {
        if observer.cancelled() {
            return Err(Error::Interrupted);
        }
        let bytes = member.part(done, STEP)?;
        if bytes.is_empty() {
            return Err(Error::malformed(&member.path, "the file became shorter while it was read"));
        }
        hash.update(&bytes);
        out.write_all(&bytes).map_err(io)?;
        done += bytes.len() as u64;
    }
    out.flush().map_err(io)?;
    let found = format!("sha1-{:x}", hash.finalize());
    Ok((done, member.sha1.as_ref().map(|s| *s == found)))
}

/// File extension by content.
fn extension(head: &[u8], otherwise: &'static str) -> &'static str {
    if head.starts_with(&[0xff, 0xd8, 0xff]) {
        "jpg"
    } else if head.starts_with(b"\x89PNG") {
        "png"
    } else if head.starts_with(&[0, 0, 0, 1]) {
        "h264"
    } else if super::json::looks_like(head) {
        "json"
    } else {
        otherwise
    }
}

/// One path component with nothing in it that any file system minds.
fn safe_part(part: &str) -> String {
    let keep = |c: char| if c.is_ascii_alphanumeric() || "._-+ ()".contains(c) { c } else { '_' };
    let clean: String = part.chars().take(100).map(keep).collect();
    let clean = clean.trim_matches([' ', '.']);
    if clean.is_empty() { "_".into() } else { clean.into() }
}

/// A stored name (`C:\T1CALIB\MOD_0001.RAW`) as a path below a folder: drive letters, `.` and `..` are dropped.
pub fn safe_path(name: &str) -> String {
    let drive = |p: &str| p.len() == 2 && p.ends_with(':');
    let parts: Vec<&str> =
        name.split(['/', '\\']).filter(|p| !p.trim_matches([' ', '.']).is_empty() && !drive(p)).collect();
    let skip = parts.len().saturating_sub(8);
    let parts: Vec<String> = parts[skip..].iter().map(|p| safe_part(p)).collect();
    if parts.is_empty() { "_".into() } else { parts.join("/") }
}

/// `name` below `folder`; components that would leave it (there are none after [`safe_path`]) are dropped.
fn inside(folder: &Path, name: &str) -> PathBuf {
    let mut path = folder.to_path_buf();
    path.extend(Path::new(name).components().filter(|c| matches!(c, Component::Normal(_))));
    path
}

/// Names given out so far: no two that differ only in case, none that is also a folder of another.
#[derive(Default)]
struct Names {
    files: HashSet<String>,
    folders: HashSet<String>,
}

impl Names {
    fn unique(&mut self, name: &str) -> String {
        let free = |n: &str| {
            let n = n.to_ascii_lowercase();
            let parents: Vec<&str> = n.match_indices('/').map(|(i, _)| &n[..i]).collect();
            n != "index.json"
                && !self.files.contains(&n)
                && !self.folders.contains(&n)
                && !parents.iter().any(|p| self.files.contains(*p))
        };
        let (stem, extension) = match name.rsplit_once('.') {
            Some((s, e)) if !e.contains('/') && !s.is_empty() => (s.to_string(), format!(".{e}")),
            _ => (name.to_string(), String::new()),
        };
        let flat = name.replace('/', "_");
        let tries = std::iter::once(name.to_string())
            .chain((2..1000).map(|k| format!("{stem}-{k}{extension}")))
            .chain((0..).map(|k| format!("{k}-{flat}")));
        let chosen = tries.into_iter().find(|n| free(n)).unwrap_or_else(|| name.to_string());
        let lower = chosen.to_ascii_lowercase();
        self.folders.extend(lower.match_indices('/').map(|(i, _)| lower[..i].to_string()));
        self.files.insert(lower);
        chosen
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_inside() {
        for (name, expected) in [
            ("C:\\T1CALIB\\MOD_0001.RAW", "T1CALIB/MOD_0001.RAW"),
            ("../../etc/passwd", "etc/passwd"),
            ("/abs/olute", "abs/olute"),
            ("..\\..\\x\u{0}y\n.raw", "x_y_.raw"),
            ("", "_"),
            ("..", "_"),
            ("...", "_"),
            ("a/./b//c", "a/b/c"),
            ("nül/con", "n_l/con"),
        ] {
            assert_eq!(safe_path(name), expected);
        }
        let long = "x/".repeat(500) + &"y".repeat(5000);
        let safe = safe_path(&long);
        assert!(safe.len() < 200 && safe.split('/').count() == 8);
    }

    #[test]
    fn no_two_files_share_a_name() {
        let mut names = Names::default();
        let given: Vec<String> = ["a/b.raw", "A/B.RAW", "a", "a/b.raw/c", "index.json", "x", "x/y"]
            .iter()
            .map(|n| names.unique(n))
            .collect();
        assert_eq!(given, ["a/b.raw", "A/B-2.RAW", "a-2", "0-a_b.raw_c", "index-2.json", "x", "0-x_y"]);
    }
}
