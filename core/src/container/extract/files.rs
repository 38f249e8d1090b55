//! Writing the parts of a container, bundle or archive into a folder.

use std::io::{BufWriter, Write};
use std::path::Path;

use crate::geometry::Size;
use serde_json::{Value, json};
use sha1::{Digest, Sha1};

use super::names::{Names, inside};
use super::plan::{Item, plan_items};
use crate::container::depth;
use crate::container::error::Error;
use crate::container::members::Member;
use crate::output::{Pending, create_part, write_part};
use crate::pfm;
use crate::progress::Observer;

/// Bytes copied at once.
/// Source: chosen.
const STEP: u64 = 8 << 20;

/// One file written.
#[derive(Debug, Clone, PartialEq)]
pub struct Extracted {
    /// Its name below the folder, parts joined by `/`.
    pub name: String,
    /// Bytes written.
    pub bytes: u64,
    /// The reference to it in the container, or its name in the bundle.
    pub what: String,
    /// Other facts about it (focus, size, range …).
    pub facts: Value,
    /// Whether its sha1 is the one the container names; `None` when nothing names one.
    pub intact: Option<bool>,
}

/// Writes every segment of a container, or every file of a bundle or .tar archive, into the new folder `out`, with
/// `index.json` saying what each file is. Lytro's depth maps are also written as .pfm and 16-bit .png. Returns what was
/// written, and warnings.
///
/// # Errors
/// When `source` cannot be read or is no container, `out` exists (without `force`) or cannot be written; interruption.
///
/// ```
/// use lenslet_core::container::extract::extract;
/// use lenslet_core::container::{Capture, Cfa, Levels, RawMosaic, write_lfp};
/// use lenslet_core::progress::Silent;
///
/// let folder = tempfile::tempdir()?;
/// let (file, out) = (folder.path().join("flat.lfp"), folder.path().join("parts"));
/// let mosaic = RawMosaic { width: 16, height: 16, data: vec![700; 256] };
/// write_lfp(&file, &Capture::bare(mosaic, Cfa::Bggr, Levels { black: [168.0; 4], white: [4095.0; 4] }), false)?;
///
/// let (written, warnings) = extract(&file, &out, false, &Silent)?;
/// assert!(warnings.is_empty() && written.iter().all(|f| f.intact != Some(false)));
/// assert_eq!(std::fs::metadata(out.join("image.raw"))?.len(), 256 * 3 / 2); // 12 bit per pixel
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn extract(
    source: &Path,
    out: &Path,
    force: bool,
    observer: &dyn Observer,
) -> Result<(Vec<Extracted>, Vec<String>), Error> {
    let (items, mut warnings) = plan_items(source)?;
    let pending = Pending::directory(out, force)?;
    let mut written = Vec::new();
    observer.begin("extracting", items.len() as u64);
    let mut names = Names::default();
    for item in items {
        let name = names.unique(&item.name);
        let (bytes, intact) = copy_member(&item.member, &inside(pending.path(), &name), observer)?;
        if intact == Some(false) {
            warnings.push(format!("{name} is damaged: its sha1 is not the one the file names"));
        }
        if let Some((width, height)) = item.depth {
            written.extend(write_depth_maps(
                &item,
                Size::new(width, height),
                &name,
                &mut names,
                pending.path(),
                &mut warnings,
            )?);
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
    write_part(&target, format!("{index:#}\n").as_bytes())
        .map_err(|source| Error::Io { path: out.join("index.json"), source })?;
    pending.commit()?;
    Ok((written, warnings))
}

/// Writes the planes of a depth map as .pfm and 16-bit .png.
fn write_depth_maps(
    item: &Item,
    size: Size,
    raw_name: &str,
    names: &mut Names,
    folder: &Path,
    warnings: &mut Vec<String>,
) -> Result<Vec<Extracted>, Error> {
    let bytes = item.member.read(1 << 30)?;
    let Some(planes) = depth::read_depth_planes(&bytes, size) else {
        warnings.push(format!("{raw_name}: {} bytes do not hold {size} depths; only saved as they are", bytes.len()));
        return Ok(Vec::new());
    };
    let mut out = Vec::new();
    for (plane, word) in planes.iter().zip(["depth", "confidence"]) {
        let (picture, range) = depth::depth_png(plane.view())
            .ok_or_else(|| Error::malformed(&item.member.path, "a depth map that cannot be a picture"))?;
        for (extension, bytes) in [("pfm", pfm::to_bytes(plane.view())), ("png", picture)] {
            let name = names.unique(&format!("{word}.{extension}"));
            let target = inside(folder, &name);
            write_part(&target, &bytes).map_err(|source| Error::Io { path: target, source })?;
            let facts = match (extension, range) {
                ("png", Some((low, high))) => json!({"lambda_at_0": low, "lambda_at_65535": high}),
                _ => Value::Null,
            };
            let what = format!("{word} map of {raw_name}, {size}");
            out.push(Extracted { name, bytes: bytes.len() as u64, what, facts, intact: None });
        }
    }
    Ok(out)
}

/// Copies a member to `target`; returns its length, and whether its sha1 is the one it should have.
fn copy_member(member: &Member, target: &Path, observer: &dyn Observer) -> Result<(u64, Option<bool>), Error> {
    let io = |source| Error::Io { path: target.to_path_buf(), source };
    let mut out = BufWriter::new(create_part(target).map_err(io)?);
    let mut hash = Sha1::new();
    let mut done = 0;
    while done < member.length {
        observer.check()?;
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
