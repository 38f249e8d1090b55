//! A capture out of a container: the frame its table of contents names, with metadata and own white image.

use std::path::Path;

use serde_json::Value;

use super::capture::{assemble, profile_for, sha256_of};
use super::metadata::{self, Frame};
use super::packing::unpack;
use super::profile::Profile;
use super::references::{self, Reference};
use super::segments::{Container, Segment};
use super::{Capture, Error, RawMosaic, json};

/// The first frame of a container, its pixels not yet read.
#[derive(Debug, Clone, PartialEq)]
pub struct Located {
    /// What is known of it.
    pub facts: Frame,
    /// The segment with its pixels, if the file holds it.
    pub image: Option<Segment>,
    /// The parts that the contents name and the file does not hold.
    pub missing: Vec<Reference>,
    /// Oddities that did not stop the reading.
    pub warnings: Vec<String>,
    /// Its entry in the table of contents.
    entry: Value,
    /// Whether the file holds renderings (-stk, -dm).
    processed: bool,
}

/// Finds the first frame a container's table of contents names.
///
/// # Errors
/// When the contents cannot be read or name no frame.
pub fn locate(container: &Container) -> Result<Located, Error> {
    let path = container.path();
    let mut warnings = container.warnings.clone();
    let contents = container.contents()?;
    let entry_of = |c| json::at(c, "picture.frameArray.0.frame").or_else(|| json::at(c, "frames.0.frame"));
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
    let missing = missing(container, contents);
    let private = document(container, entry, "privateMetadataRef", &mut warnings)?;
    let metadata = document(container, entry, "metadataRef", &mut warnings)?;
    // Some programs keep the metadata in the table of contents itself.
    let (mut facts, more) = metadata::frame(metadata.as_ref().unwrap_or(contents), private.as_ref());
    warnings.extend(more);
    facts.camera.white_ref = metadata::white_ref(contents).or(facts.camera.white_ref);
    let (is_white, is_dark) = metadata::tags(contents);
    facts.is_white = is_white.or(facts.is_white);
    facts.is_dark = is_dark.or(facts.is_dark);
    let image = json::text(entry, "imageRef").and_then(|sha1| container.find(&sha1).cloned());
    let renderings = contents.pointer("/picture/accelerationArray").and_then(Value::as_array);
    let processed = renderings.is_some_and(|a| !a.is_empty());
    Ok(Located { facts, image, missing, warnings, entry: entry.clone(), processed })
}

/// The image, or why there is none.
fn image_of(container: &Container, located: &Located) -> Result<Segment, Error> {
    if let Some(image) = &located.image {
        return Ok(image.clone());
    }
    let path = container.path();
    let Some(sha1) = json::text(&located.entry, "imageRef") else {
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
pub(super) fn capture(container: &Container, profile: Option<&Profile>) -> Result<Capture, Error> {
    let located = locate(container)?;
    let image = image_of(container, &located)?;
    let Located { facts, entry, missing, mut warnings, .. } = located;
    warnings.extend(missing.iter().map(|m| format!("{} ({}) is named by the file but is not in it", m.path, m.sha1)));
    let (bytes, damaged) = container.checked(&image)?;
    warnings.extend(damaged);
    let guessed = profile_for(&facts, image.length);
    let profile = profile.or(guessed.as_ref());
    let pixels = pixels(container.path(), &facts, profile, &bytes, &mut warnings)?;
    let white = white(container, &entry, &facts, profile, &mut warnings)?;
    let mut capture = assemble(pixels, facts, profile, container.sha256()?, warnings);
    capture.white = white.map(Box::new);
    Ok(capture)
}

/// The white image the file carries (Illum), if it is whole.
fn white(
    container: &Container,
    frame: &Value,
    facts: &Frame,
    profile: Option<&Profile>,
    warnings: &mut Vec<String>,
) -> Result<Option<Capture>, Error> {
    let Some(segment) = json::text(frame, "modulationDataRef").and_then(|r| container.find(&r)) else {
        return Ok(None);
    };
    let (bytes, damaged) = container.checked(segment)?;
    warnings.extend(damaged);
    let mut own = Vec::new();
    let (mut white_facts, more) = match document(container, frame, "modulationDataMetadataRef", &mut own)? {
        Some(m) => metadata::frame(&m, None),
        None => (Frame::default(), Vec::new()),
    };
    own.extend(more);
    // What the white image does not say of itself is as in the capture, of the same sensor.
    white_facts.size = white_facts.size.or(facts.size);
    white_facts.packing = white_facts.packing.or(facts.packing);
    white_facts.cfa = white_facts.cfa.or(facts.cfa);
    white_facts.levels = white_facts.levels.or_else(|| facts.levels.clone());
    white_facts.mla = white_facts.mla.or_else(|| facts.mla.clone());
    if white_facts.camera.serial.is_none() {
        white_facts.camera.serial.clone_from(&facts.camera.serial);
    }
    match pixels(container.path(), &white_facts, profile, &bytes, &mut own) {
        Ok(mosaic) => {
            let sha256 = sha256_of(&bytes);
            Ok(Some(assemble(mosaic, white_facts, profile, sha256, own)))
        }
        Err(e) => {
            warnings.push(format!("the file's own white image was left out: {e}"));
            Ok(None)
        }
    }
}

/// Unpacks an image by its metadata, else by a profile; its size must be that of the bytes there are.
pub(super) fn pixels(
    path: &Path,
    facts: &Frame,
    profile: Option<&Profile>,
    bytes: &[u8],
    warnings: &mut Vec<String>,
) -> Result<RawMosaic, Error> {
    let from_profile = profile.map(|p| (p.sensor.width, p.sensor.height));
    let Some((width, height)) = facts.size.or(from_profile) else {
        return Err(Error::unsupported(
            path,
            format!("nothing says how large the image of {} bytes is; name the camera with --profile", bytes.len()),
        ));
    };
    let Some(packing) = facts.packing.or(profile.map(|p| p.sensor.packing)) else {
        return Err(Error::unsupported(path, "nothing says how the pixels are packed; name the camera with --profile"));
    };
    if facts.size.is_none() || facts.packing.is_none() {
        warnings.push(format!(
            "the metadata does not say how the image is stored; taken as {width}x{height} of {} bit",
            packing.bits()
        ));
    }
    let needed = width.checked_mul(height).and_then(|n| packing.bytes(n)).unwrap_or(usize::MAX);
    if bytes.len() > needed {
        warnings.push(format!(
            "the image has {} bytes, {} more than {width}x{height} of {} bit need",
            bytes.len(),
            bytes.len() - needed,
            packing.bits()
        ));
    }
    let data = if bytes.len() < needed { None } else { unpack(packing, bytes, width * height) };
    let data = data.ok_or_else(|| {
        Error::malformed(
            path,
            format!(
                "{width}x{height} pixels of {} bit need {needed} bytes, but the image has {}",
                packing.bits(),
                bytes.len()
            ),
        )
    })?;
    Ok(RawMosaic { width, height, data })
}

/// Every part the contents name that is not in the file.
fn missing(container: &Container, contents: &Value) -> Vec<Reference> {
    references::collect(contents)
        .into_iter()
        .filter(|r| references::is_part(r) && container.find(&r.sha1).is_none())
        .collect()
}

/// The JSON document a key of the frame refers to; absent or unreadable ones are a warning.
fn document(
    container: &Container,
    frame: &Value,
    key: &str,
    warnings: &mut Vec<String>,
) -> Result<Option<Value>, Error> {
    let Some(segment) = json::text(frame, key).and_then(|r| container.find(&r)) else {
        return Ok(None);
    };
    if segment.length > json::MAX_TEXT as u64 {
        warnings.push(format!("{key}: {} bytes are too many for metadata; ignored", segment.length));
        return Ok(None);
    }
    let (bytes, damaged) = container.checked(segment)?;
    warnings.extend(damaged);
    Ok(match json::parse(&bytes) {
        Ok(value) => Some(value),
        Err(e) => {
            warnings.push(format!("{key}: {e}; ignored"));
            None
        }
    })
}
