//! A capture from pixels and facts: from the metadata and, where these lack one, from the camera's profile.

use std::path::Path;

use super::capture::{Capture, RawMosaic};
use super::cfa::Cfa;
use super::error::Error;
use super::facts::{ColourFacts, Levels};
use super::metadata::FrameFacts;
use super::packing::unpack;
use super::profile::CameraProfile;

/// A capture of these pixels and facts. Missing facts are taken from `profile`; each guess beyond it adds a warning.
pub(super) fn assemble_capture(
    pixels: RawMosaic,
    frame: FrameFacts,
    profile: Option<&CameraProfile>,
    sha256: String,
    mut warnings: Vec<String>,
) -> Capture {
    let levels = frame.levels.clone().or_else(|| profile.map(CameraProfile::levels)).unwrap_or_else(|| {
        warnings.push("black and white level are not known: taken as 0 and the largest value of the packing".into());
        let max = frame.packing.map_or(u16::MAX, |p| p.max());
        Levels { black: [0.0; 4], white: [f32::from(max); 4] }
    });
    let cfa = frame.cfa.or(profile.map(|p| p.sensor.cfa)).unwrap_or_else(|| {
        warnings.push("the colour filter array is not known: taken as BGGR".into());
        Cfa::Bggr
    });
    let colour = frame.colour(&profile.map_or_else(ColourFacts::neutral, CameraProfile::colour));
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
    Capture {
        mosaic: pixels,
        cfa,
        levels,
        colour,
        camera,
        mla,
        source_sha256: sha256,
        jpeg: false,
        white: None,
        warnings,
    }
}

/// Unpacks an image by its metadata, else by a profile.
///
/// # Errors
/// When neither states how the image is stored, or there are too few bytes for it.
pub(super) fn unpack_image(
    path: &Path,
    facts: &FrameFacts,
    profile: Option<&CameraProfile>,
    bytes: &[u8],
    warnings: &mut Vec<String>,
) -> Result<RawMosaic, Error> {
    facts.check_supported(path)?;
    let from_profile = profile.map(|p| (p.sensor.width, p.sensor.height));
    let Some((width, height)) = facts.size.or(from_profile) else {
        return Err(Error::unsupported(
            path,
            format!(
                "the width and height of the image of {} bytes are not known; name the camera with --profile",
                bytes.len()
            ),
        ));
    };
    let Some(packing) = facts.packing.or(profile.map(|p| p.sensor.packing)) else {
        return Err(Error::unsupported(path, "the packing of the pixels is not known; name the camera with --profile"));
    };
    if facts.size.is_none() || facts.packing.is_none() {
        warnings.push(format!(
            "the metadata does not state how the image is stored; taken as {width}x{height} of {} bit",
            packing.bits()
        ));
    }
    let needed = width.checked_mul(height).and_then(|n| packing.bytes(n)).unwrap_or(usize::MAX);
    if bytes.len() > needed {
        // Two bits a pixel more: the stated depth and the bytes contradict each other.
        if (bytes.len() - needed) as u64 * 8 >= 2 * (width * height) as u64 {
            return Err(Error::malformed(
                path,
                format!(
                    "the metadata state {width}x{height} pixels of {} bit, {needed} bytes, but the image has {}: they contradict each other",
                    packing.bits(),
                    bytes.len()
                ),
            ));
        }
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
    Ok(RawMosaic { width, height, data: shifted(data, facts.right_shift) })
}

/// Values without the low bits that hold nothing.
pub(super) fn shifted(mut data: Vec<u16>, right_shift: u32) -> Vec<u16> {
    if right_shift > 0 {
        data.iter_mut().for_each(|v| *v = v.checked_shr(right_shift).unwrap_or(0));
    }
    data
}

/// The built-in profile for a camera's model name, else for the length of its packed image.
pub(super) fn profile_for(facts: &FrameFacts, image_bytes: u64) -> Option<&'static CameraProfile> {
    let named = facts.camera.model.as_deref().and_then(CameraProfile::of_model);
    let of_length = |p: &&CameraProfile| p.raw_bytes().map(|n| n as u64) == Some(image_bytes);
    named.or_else(|| CameraProfile::built_in().iter().find(of_length))
}
