//! Every white, dark and black image of a calibration folder, bundle or archive.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::image::{CalibrationImage, classify};
use crate::container::error::Error;
use crate::container::members::{Member, list_members};
use crate::container::metadata::{self, FrameFacts};
use crate::container::segments::{Container, HEADER, MAGIC};
use crate::container::{json, lfp};

/// An archive (empty for plain files) and a folder.
type Place = (PathBuf, PathBuf);

/// Every image of a folder.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CalibrationImages {
    /// White, dark and black images, in order of place.
    pub images: Vec<CalibrationImage>,
    /// Files that look like images but cannot be used, and other anomalies, one line each.
    pub warnings: Vec<String>,
}

/// Lists the images of a calibration folder, `data.C.n` bundle or .tar archive: packed .RAW files with their
/// metadata, and containers that are tagged as white images or whose name begins with `white` or `MOD`.
///
/// # Errors
/// When the place cannot be read.
pub fn list_calibration_images(place: &Path) -> Result<CalibrationImages, Error> {
    let found = list_members(place)?;
    let mut out = CalibrationImages { images: Vec::new(), warnings: found.warnings };
    // Every camera calls its images alike: only what lies in the same archive and folder belongs to an image.
    let key = |m: &Member| (m.place(), m.stem_and_extension().0);
    let mut texts = HashMap::new();
    let mut manifests = Vec::new();
    for m in &found.list {
        let (stem, extension) = m.stem_and_extension();
        if extension == "TXT" || extension == "JSON" {
            if stem == "CAL_FILE_MANIFEST" {
                manifests.push((m.place(), read_manifest(m)));
            }
            texts.insert(key(m), m);
        }
    }
    for m in &found.list {
        let (stem, extension) = m.stem_and_extension();
        let image = if extension == "RAW" {
            raw_image(m, texts.get(&key(m)).copied())
        } else if m.offset == 0 && m.part(0, 8).is_ok_and(|h| h == MAGIC) {
            container_image(m, &stem).transpose()
        } else {
            None
        };
        match image {
            None => {}
            Some(Ok(mut c)) => {
                c.names.extend(hash_of(m, &stem, &manifests));
                c.names.extend(c.member.sha1.clone());
                out.images.push(c);
            }
            Some(Err(e)) => out.warnings.push(format!("left out: {e}")),
        }
    }
    Ok(out)
}

/// The hash of an image in the manifest of its archive, or of the nearest folder above it.
fn hash_of(member: &Member, stem: &str, manifests: &[(Place, HashMap<String, String>)]) -> Option<String> {
    let (archive, folder) = member.place();
    let above = |(a, f): &Place| *a == archive && (member.archive.is_some() || folder.starts_with(f));
    let shared = |f: &Path| f.components().zip(folder.components()).take_while(|(x, y)| x == y).count();
    let own = manifests.iter().filter(|(place, _)| above(place)).max_by_key(|((_, f), _)| shared(f))?;
    own.1.get(stem).cloned()
}

/// Stem of each calibration file and its hash.
fn read_manifest(member: &Member) -> HashMap<String, String> {
    let Ok(bytes) = member.read(json::MAX_TEXT as u64) else { return HashMap::new() };
    let Ok((value, _)) = json::parse_damaged(&bytes) else { return HashMap::new() };
    let files = value.get("calibrationFiles").and_then(serde_json::Value::as_array);
    let entry = |f: &serde_json::Value| {
        let name = json::text_at(f, "name")?.to_ascii_uppercase();
        let stem = name.rsplit(['\\', '/']).next()?.rsplit_once('.')?.0.to_string();
        Some((stem, json::text_at(f, "hash")?.to_ascii_lowercase()))
    };
    files.into_iter().flatten().filter_map(entry).collect()
}

fn raw_image(member: &Member, text: Option<&Member>) -> Option<Result<CalibrationImage, Error>> {
    let frame = match text.map(|t| (t, t.read(json::MAX_TEXT as u64))) {
        None => Ok(FrameFacts::default()),
        Some((t, bytes)) => bytes
            .and_then(|b| json::parse_damaged(&b).map_err(|e| Error::malformed(&t.path, format!("{}: {e}", t.name))))
            .map(|(v, _)| metadata::read_frame(&v, None).0),
    };
    Some(frame.and_then(|f| classify(member.clone(), f)))
}

fn container_image(member: &Member, stem: &str) -> Result<Option<CalibrationImage>, Error> {
    let container = Container::open(&member.path)?;
    let looks = stem.starts_with("WHITE") || stem.starts_with("MOD");
    let (frame, image) = match lfp::locate_frame(&container) {
        Ok(lfp::LocatedFrame { facts, image: Some(image), .. }) => (facts, image),
        Err(e) if looks => return Err(e),
        _ => return Ok(None),
    };
    if !(looks || frame.is_white == Some(true)) {
        return Ok(None);
    }
    let inside = Member {
        name: member.name.clone(),
        path: member.path.clone(),
        offset: image.offset + HEADER,
        length: image.length,
        sha1: Some(image.sha1),
        archive: None,
    };
    classify(inside, frame).map(Some)
}
