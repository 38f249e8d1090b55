//! Raw mosaics given as pictures: PNG, TIFF, JPEG, BMP or PGM of one channel, 8 or 16 bit.
//!
//! The largest value decides how values are read. Up to the camera's white level they are digital numbers as read from
//! the sensor; above it, and in 8-bit pictures, the full range of the picture corresponds to 0 to the white level.

use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ImageDecoder};

use super::assemble::{assemble_capture, profile_for};
use super::capture::{Capture, RawMosaic};
use super::error::Error;
use super::facts::MAX_SIDE;
use super::profile::CameraProfile;
use super::sidecar::read_sidecar;
use crate::digest::sha256_hex;
use crate::picture_file;

/// Longest picture file read, bytes.
pub(super) const MAX_FILE: u64 = 1 << 30;
/// Largest decoded picture, bytes: about twice an Illum's mosaic as 16-bit RGB.
const MAX_DECODED: u64 = 512 << 20;

/// Whether these first bytes are those of a picture; one in a format that is not decoded is refused.
pub(super) fn check_picture(path: &Path, head: &[u8]) -> Result<bool, Error> {
    match picture_file::format_of(head) {
        Some((_, true)) => Ok(true),
        Some((name, false)) => Err(Error::unsupported(path, picture_file::Error::Format(name).to_string())),
        None => Ok(false),
    }
}

/// Reads a mosaic from the bytes of a picture file. A .txt or .json of the same name beside it adds the camera's
/// metadata.
pub(super) fn capture_from_picture(
    path: &Path,
    bytes: &[u8],
    profile: Option<&CameraProfile>,
) -> Result<Capture, Error> {
    let (pixels, bits) = decode_picture(path, bytes)?;
    let mut warnings = Vec::new();
    let facts = read_sidecar(path, &mut warnings).filter(|f| f.size.is_none_or(|s| s == (pixels.width, pixels.height)));
    let guessed = facts.as_ref().and_then(|f| profile_for(f, 0));
    let mut hint = true;
    let profile = match (profile, guessed) {
        (Some(p), _) => {
            warnings.extend(size_warning(pixels.width, pixels.height, p));
            p
        }
        (None, Some(p)) => p,
        (None, None) => {
            // The size identifies the sensor, not the lenslet array in front of it.
            hint = false;
            profile_by_size(pixels.width, pixels.height, &mut warnings)?
        }
    };
    let mut facts = facts.unwrap_or_default();
    // A picture's packing is its own; its filter array is the sensor's.
    if facts.cfa.is_none() && facts.unsupported.iter().any(|u| u.contains("filter array")) {
        facts.check_supported(path)?;
    }
    let levels = facts.levels.take().unwrap_or_else(|| profile.levels());
    let max = pixels.data.iter().copied().max().unwrap_or(0);
    let camera_white = levels.white.iter().copied().fold(0.0, f32::max);
    let full = if bits == 8 { 255.0 } else { 65535.0 };
    let scale = if bits == 16 && f32::from(max) <= camera_white { 1.0 } else { full / camera_white };
    let mut scaled = levels;
    if scale != 1.0 {
        scaled.black = scaled.black.map(|v| v * scale);
        scaled.white = scaled.white.map(|v| v * scale);
        warnings.push(format!(
            "{bits}-bit mosaic with values up to {max}: taken as digital numbers x {scale:.5}, so black is {:.2} and white {:.0}",
            scaled.black[1], scaled.white[1]
        ));
    } else {
        warnings.push(format!(
            "16-bit mosaic with values up to {max}: taken as digital numbers (white level {camera_white:.0})"
        ));
    }
    facts.levels = Some(scaled);
    let mut capture = assemble_capture(pixels, facts, Some(profile), sha256_hex(bytes), warnings);
    capture.jpeg = bytes.starts_with(&[0xff, 0xd8, 0xff]);
    if !hint {
        capture.mla = None;
    }
    Ok(capture)
}

/// The camera of this size; for other sizes the facts of the fallback profile, with a warning.
fn profile_by_size(width: usize, height: usize, warnings: &mut Vec<String>) -> Result<&'static CameraProfile, Error> {
    let same = |p: &&CameraProfile| (p.sensor.width, p.sensor.height) == (width, height);
    if let Some(p) = CameraProfile::built_in().iter().find(same) {
        return Ok(p);
    }
    let fallback = CameraProfile::fallback().ok_or_else(|| Error::Parameter("no camera profiles".into()))?;
    warnings.push(format!(
        "{width}x{height} pixels fit no known camera: levels, colour and filter array are taken from {}; name another with --profile",
        fallback.name
    ));
    Ok(fallback)
}

/// A warning when a profile's sensor is of another size than the image.
fn size_warning(width: usize, height: usize, profile: &CameraProfile) -> Option<String> {
    let (w, h) = (profile.sensor.width, profile.sensor.height);
    ((w, h) != (width, height)).then(|| {
        format!("the image has {width}x{height} pixels, the camera {} {w}x{h}: its levels and colour are used, but the colour filter array may be shifted", profile.name)
    })
}

/// Pixels and bits per sample.
fn decode_picture(path: &Path, bytes: &[u8]) -> Result<(RawMosaic, u32), Error> {
    let failed = |e: picture_file::Error| Error::malformed(path, e.to_string());
    let decoder = picture_file::open_decoder(Cursor::new(bytes), bytes.len() as u64, 2).map_err(failed)?;
    let (width, height) = decoder.dimensions();
    if width.max(height) as usize > MAX_SIDE || decoder.total_bytes() > MAX_DECODED {
        return Err(Error::malformed(path, format!("{width}x{height} pixels are too many for a raw mosaic")));
    }
    let picture = picture_file::decode_pixels(decoder).map_err(failed)?;
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    if width < 16 || height < 16 {
        return Err(Error::unsupported(path, format!("{width}x{height} pixels are too few for a raw mosaic")));
    }
    let colour = || {
        Error::unsupported(
            path,
            "a colour picture, not a raw mosaic: its red, green and blue differ; a mosaic has one value per pixel, as read from the sensor",
        )
    };
    let wide = |v: Vec<u8>| v.into_iter().map(u16::from).collect::<Vec<u16>>();
    fn first<T: Copy + PartialEq>(samples: Vec<T>, channels: usize, used: usize) -> Option<Vec<T>> {
        let grey = samples.chunks_exact(channels).all(|p| p[1..used].iter().all(|v| *v == p[0]));
        grey.then(|| samples.chunks_exact(channels).map(|p| p[0]).collect())
    }
    let (data, bits) = match picture {
        DynamicImage::ImageLuma8(i) => (wide(i.into_raw()), 8),
        DynamicImage::ImageLuma16(i) => (i.into_raw(), 16),
        DynamicImage::ImageLumaA8(i) => (wide(first(i.into_raw(), 2, 1).ok_or_else(colour)?), 8),
        DynamicImage::ImageLumaA16(i) => (first(i.into_raw(), 2, 1).ok_or_else(colour)?, 16),
        DynamicImage::ImageRgb8(i) => (wide(first(i.into_raw(), 3, 3).ok_or_else(colour)?), 8),
        DynamicImage::ImageRgb16(i) => (first(i.into_raw(), 3, 3).ok_or_else(colour)?, 16),
        DynamicImage::ImageRgba8(i) => (wide(first(i.into_raw(), 4, 3).ok_or_else(colour)?), 8),
        DynamicImage::ImageRgba16(i) => (first(i.into_raw(), 4, 3).ok_or_else(colour)?, 16),
        other => {
            return Err(Error::unsupported(
                path,
                format!("a picture of {:?} samples; mosaics have 8 or 16 bit whole numbers", other.color()),
            ));
        }
    };
    Ok((RawMosaic { width, height, data }, bits))
}
