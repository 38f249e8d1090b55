//! Any capture file to a [`Capture`]: the kind is told by the content, the facts come from metadata, else from a profile.

use std::path::Path;

use sha2::{Digest, Sha256};

use super::metadata::Frame;
use super::profile::{self, Profile};
use super::segments::{self, Container};
use super::{Capture, Cfa, Error, Levels, RawMosaic, file, lfp, mosaic, raw};

/// Opens a capture: a container (.lfp, .lfr), a raw mosaic as a picture (PNG, TIFF, JPEG, PGM; 8 or 16 bit, one
/// channel), or a packed .raw with its metadata in a .txt or .json of the same name.
///
/// `profile` names a camera (`lytro-f01`, or the path of a TOML file) for what the file does not say; without it,
/// pictures and raw files are recognised by their size.
///
/// # Errors
/// When the file cannot be read, is none of these, or names an image it does not hold.
pub fn open(path: &Path, profile: Option<&str>) -> Result<Capture, Error> {
    let profile = profile.map(profile::profile).transpose()?;
    let head = file::head(path, 16)?;
    if head.is_empty() {
        return Err(Error::not_recognised(path, "the file is empty"));
    }
    if head.starts_with(&segments::MAGIC) {
        return lfp::capture(&Container::open(path)?, profile.as_ref());
    }
    let named_raw = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("raw"));
    if !named_raw && mosaic::is_picture(&head) {
        let bytes = file::read(path, "a picture", mosaic::MAX_FILE)?;
        return mosaic::capture(path, &bytes, profile.as_ref());
    }
    raw::capture(path, profile.as_ref())
}

/// Whether a file is a JPEG picture: a mosaic kept so has lost some of its colour (the filter array is the finest detail there is).
pub fn is_jpeg(path: &Path) -> bool {
    file::head(path, 3).is_ok_and(|head| head == [0xff, 0xd8, 0xff])
}

/// sha256 of a file's bytes, in hexadecimal.
pub(super) fn sha256_of(bytes: &[u8]) -> String {
    format!("{:x}", Sha256::digest(bytes))
}

/// Puts a capture together from pixels and facts.
pub(super) fn assemble(
    pixels: RawMosaic,
    frame: Frame,
    profile: Option<&Profile>,
    sha256: String,
    mut warnings: Vec<String>,
) -> Capture {
    let levels = frame.levels.clone().or_else(|| profile.map(Profile::levels)).unwrap_or_else(|| {
        warnings.push("black and white level are not known: taken as 0 and the largest value of the packing".into());
        let max = frame.packing.map_or(u16::MAX, |p| p.max());
        Levels { black: [0.0; 4], white: [f32::from(max); 4] }
    });
    let cfa = frame.cfa.or(profile.map(|p| p.sensor.cfa)).unwrap_or_else(|| {
        warnings.push("the colour filter array is not known: taken as BGGR".into());
        Cfa::Bggr
    });
    let colour = frame.colour(&profile.map_or_else(profile::neutral, Profile::colour));
    let mut camera = frame.camera;
    if let Some(p) = profile {
        if camera.make.is_none() {
            camera.make.clone_from(&p.make);
        }
        if camera.model.is_none() {
            camera.model = p.models.first().cloned();
        }
    }
    let mla = frame.mla.or_else(|| profile.and_then(|p| p.lenslets.clone()));
    Capture { mosaic: pixels, cfa, levels, colour, camera, mla, source_sha256: sha256, white: None, warnings }
}

/// The built-in profile for a camera's model name, else for the length of its packed image.
pub(super) fn profile_for(facts: &Frame, image_bytes: u64) -> Option<Profile> {
    let known = profile::profiles();
    let model = facts.camera.model.as_deref().unwrap_or_default();
    let named = known.iter().find(|p| p.models.iter().any(|m| m.eq_ignore_ascii_case(model)));
    named.or_else(|| known.iter().find(|p| p.raw_bytes().map(|n| n as u64) == Some(image_bytes))).cloned()
}

/// Says so when a profile's size is not the image's.
pub(super) fn size_warning(width: usize, height: usize, profile: &Profile) -> Option<String> {
    let (w, h) = (profile.sensor.width, profile.sensor.height);
    ((w, h) != (width, height)).then(|| {
        format!("the image has {width}x{height} pixels, the camera {} {w}x{h}: levels and colour are its, the colour filter array may start elsewhere", profile.name)
    })
}
