//! A capture from a container: the first frame of its table of contents, with its metadata and white image.

use serde_json::Value;

use super::assemble::{assemble_capture, profile_for, unpack_image};
use super::capture::Capture;
use super::error::Error;
use super::json;
use super::metadata::{self, FrameFacts};
use super::profile::CameraProfile;
use super::references::{self, Reference};
use super::segments::{Container, Segment};
use crate::digest::sha256_hex;

/// The first frame of a container, its pixels not yet read.
#[derive(Debug, Clone, PartialEq)]
pub struct LocatedFrame {
    /// Its metadata.
    pub facts: FrameFacts,
    /// The segment with its pixels, if the file holds it.
    pub image: Option<Segment>,
    /// The parts that the contents name and the file does not hold.
    pub missing: Vec<Reference>,
    /// Anomalies that did not prevent reading, one line each.
    pub warnings: Vec<String>,
    /// Its entry in the table of contents.
    entry: Value,
    /// Whether the file holds renderings (-stk, -dm).
    processed: bool,
}

impl LocatedFrame {
    /// Whether the file holds renderings of a capture (-stk, -dm).
    pub fn is_processed(&self) -> bool {
        self.processed
    }
}

/// Finds the first frame a container's table of contents names.
///
/// # Errors
/// When the contents cannot be read or name no frame.
pub fn locate_frame(container: &Container) -> Result<LocatedFrame, Error> {
    let path = container.path();
    let mut warnings = container.warnings.clone();
    let contents = container.contents()?;
    let entry_of = |c| json::value_at(c, "picture.frameArray.0.frame").or_else(|| json::value_at(c, "frames.0.frame"));
    let Some((contents, entry)) = contents.iter().find_map(|c| Some((c, entry_of(c)?))) else {
        let files = contents.iter().find_map(|c| c.get("files")?.as_array());
        return Err(Error::unsupported(
            path,
            files.map_or("the container's table of contents names no frame".to_string(), |files| {
                let n = files.len();
                format!("a bundle of {n} calibration files, not a capture; take them out with `lenslet extract`")
            }),
        ));
    };
    let missing = missing_parts(container, contents);
    let private = read_document(container, entry, "privateMetadataRef", &mut warnings)?;
    let metadata = read_document(container, entry, "metadataRef", &mut warnings)?;
    // Some programs keep the metadata in the table of contents itself.
    let (mut facts, more) = metadata::read_frame(metadata.as_ref().unwrap_or(contents), private.as_ref());
    warnings.extend(more);
    facts.camera.white_ref = metadata::white_ref(contents).or(facts.camera.white_ref);
    let (is_white, is_dark) = metadata::frame_tags(contents);
    facts.is_white = is_white.or(facts.is_white);
    facts.is_dark = is_dark.or(facts.is_dark);
    let image = json::text_at(entry, "imageRef").and_then(|sha1| container.find(&sha1).cloned());
    let renderings = contents.pointer("/picture/accelerationArray").and_then(Value::as_array);
    let processed = renderings.is_some_and(|a| !a.is_empty());
    Ok(LocatedFrame { facts, image, missing, warnings, entry: entry.clone(), processed })
}

/// The segment of the image.
fn image_of(container: &Container, located: &LocatedFrame) -> Result<Segment, Error> {
    if let Some(image) = &located.image {
        return Ok(image.clone());
    }
    let path = container.path();
    let Some(sha1) = json::text_at(&located.entry, "imageRef") else {
        return Err(Error::malformed(path, "the frame names no image (imageRef)"));
    };
    let advice = if located.processed {
        "; a processed file: the raw image lies in the .lfp of the same name without -stk or -dm (`lenslet extract` saves what is here)"
    } else {
        ""
    };
    Err(Error::Missing { path: path.into(), what: "imageRef".into(), sha1, advice: advice.into() })
}

/// Reads the first frame of a container.
pub(super) fn capture_from_container(container: &Container, profile: Option<&CameraProfile>) -> Result<Capture, Error> {
    let located = locate_frame(container)?;
    let image = image_of(container, &located)?;
    let LocatedFrame { facts, entry, missing, mut warnings, .. } = located;
    warnings.extend(missing.iter().map(|m| format!("{} ({}) is named by the file but is not in it", m.path, m.sha1)));
    let (bytes, damaged) = container.checked(&image)?;
    warnings.extend(damaged);
    let guessed = profile_for(&facts, image.length);
    let profile = profile.or(guessed);
    let pixels = unpack_image(container.path(), &facts, profile, &bytes, &mut warnings);
    let pixels = pixels.map_err(|e| e.after(&warnings))?;
    let white = own_white_image(container, &entry, &facts, profile, &mut warnings)?;
    let mut capture = assemble_capture(pixels, facts, profile, container.sha256()?, warnings);
    capture.white = white.map(Box::new);
    Ok(capture)
}

/// The white image in the file (Illum), if it can be read.
fn own_white_image(
    container: &Container,
    frame: &Value,
    facts: &FrameFacts,
    profile: Option<&CameraProfile>,
    warnings: &mut Vec<String>,
) -> Result<Option<Capture>, Error> {
    let Some(segment) = json::text_at(frame, "modulationDataRef").and_then(|r| container.find(&r)) else {
        return Ok(None);
    };
    let (bytes, damaged) = container.checked(segment)?;
    warnings.extend(damaged);
    let mut own = Vec::new();
    let (mut white_facts, more) = match read_document(container, frame, "modulationDataMetadataRef", &mut own)? {
        Some(m) => metadata::read_frame(&m, None),
        None => (FrameFacts::default(), Vec::new()),
    };
    own.extend(more);
    // The same sensor: facts that the white image lacks are those of the capture.
    white_facts.size = white_facts.size.or(facts.size);
    if white_facts.packing.is_none() {
        white_facts.packing = facts.packing;
        white_facts.right_shift = facts.right_shift;
    }
    white_facts.cfa = white_facts.cfa.or(facts.cfa);
    white_facts.levels = white_facts.levels.or_else(|| facts.levels.clone());
    white_facts.mla = white_facts.mla.or_else(|| facts.mla.clone());
    if white_facts.camera.serial.is_none() {
        white_facts.camera.serial.clone_from(&facts.camera.serial);
    }
    match unpack_image(container.path(), &white_facts, profile, &bytes, &mut own) {
        Ok(mosaic) => {
            let sha256 = sha256_hex(&bytes);
            Ok(Some(assemble_capture(mosaic, white_facts, profile, sha256, own)))
        }
        Err(e) => {
            warnings.push(format!("the file's own white image was left out: {e}"));
            Ok(None)
        }
    }
}

/// Every part the contents name that is not in the file.
fn missing_parts(container: &Container, contents: &Value) -> Vec<Reference> {
    references::collect_references(contents)
        .into_iter()
        .filter(|r| references::is_part(r) && container.find(&r.sha1).is_none())
        .collect()
}

/// The JSON document a key of the frame refers to; absent or unreadable ones are a warning.
fn read_document(
    container: &Container,
    frame: &Value,
    key: &str,
    warnings: &mut Vec<String>,
) -> Result<Option<Value>, Error> {
    let Some(segment) = json::text_at(frame, key).and_then(|r| container.find(&r)) else {
        return Ok(None);
    };
    if segment.length > json::MAX_DAMAGED as u64 {
        warnings.push(format!("{key}: {} bytes are too many for metadata; ignored", segment.length));
        return Ok(None);
    }
    let (bytes, damaged) = container.checked(segment)?;
    warnings.extend(damaged);
    Ok(match json::parse_damaged(&bytes) {
        Ok((value, mended)) => {
            warnings.extend(mended.map(|what| format!("{key}: {what}")));
            Some(value)
        }
        Err(e) => {
            warnings.push(format!("{key}: {e}; ignored"));
            None
        }
    })
}
