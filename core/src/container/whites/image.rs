//! An image of a calibration folder, classified by its exposure.

use crate::container::assemble::{assemble_capture, profile_for, shifted, unpack_image};
use crate::container::capture::Capture;
use crate::container::error::Error;
use crate::container::members::Member;
use crate::container::metadata::FrameFacts;
use crate::container::packing::unpack;
use crate::container::profile::CameraProfile;
use crate::container::segments::sha1_of;
use crate::digest::sha256_hex;

/// Longest image read, bytes.
const MAX_IMAGE: u64 = 512 << 20;
/// Images with a mean under this share of the white level are too dark to find centres in.
/// Source: 500 of 4095, the limit the Light Field Toolbox uses for white images of the F01.
const DARK: f64 = 500.0 / 4095.0;
/// Images whose mean is this little above the black level (as a share of the range) are black images.
/// Source: chosen.
const BLACK: f64 = 0.02;
/// Largest share of saturated pixels in a white image.
/// Source: chosen.
const SATURATED: f64 = 0.01;
/// Share of the white level from which on a pixel is saturated.
/// Source: chosen.
const SATURATION: f32 = 0.995;
/// Stretches of an image that are read to classify it, spread evenly.
/// Source: chosen.
const STRETCHES: u64 = 64;
/// Bytes that are whole groups of every packing.
const GROUP: u64 = 30;
/// Length of a stretch, bytes.
/// Source: chosen; about 2,500 pixels of 12 bit.
const STRETCH: u64 = GROUP * 128;

/// The use of an image, by its exposure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExposureClass {
    /// A white image.
    White,
    /// A white image with too little light.
    Dark,
    /// A white image with too much light.
    Saturated,
    /// A black image (hot pixels).
    Black,
}

/// An image of a calibration folder.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationImage {
    /// Where its packed pixels lie.
    pub member: Member,
    /// The facts in its metadata.
    pub frame: FrameFacts,
    /// Every `sha1-…` under which metadata, bundle or manifest refer to it; that of its pixels is not computed.
    pub names: Vec<String>,
    /// Its class by exposure.
    pub class: ExposureClass,
    /// Mean value in DN over a sample of its pixels (a thousandth to all of them).
    pub mean: f64,
}

impl CalibrationImage {
    /// Reads the whole image.
    ///
    /// # Errors
    /// When it cannot be read, or its size is not that in its metadata.
    pub fn load(&self) -> Result<Capture, Error> {
        let bytes = self.member.read(MAX_IMAGE)?;
        let mut warnings = Vec::new();
        if let Some(sha1) = self.member.sha1.as_ref().filter(|s| **s != sha1_of(&bytes)) {
            warnings.push(format!("{} is damaged: it does not have the {sha1} it should", self.member.label()));
        }
        let profile = profile_for(&self.frame, self.member.length);
        let pixels = unpack_image(&self.member.path, &self.frame, profile, &bytes, &mut warnings)?;
        Ok(assemble_capture(pixels, self.frame.clone(), profile, sha256_hex(&bytes), warnings))
    }

    /// Name, serial, zoom, focus and brightness in one line.
    pub fn describe(&self) -> String {
        let c = &self.frame.camera;
        let mut out = self.member.label();
        if let Some(serial) = &c.serial {
            out.push_str(&format!(", serial {serial}"));
        }
        for (word, value) in [("zoom", c.zoom_step), ("focus", c.focus_step)] {
            if let Some(value) = value {
                out.push_str(&format!(", {word} {value}"));
            }
        }
        out.push_str(&format!(", mean {:.0} DN", self.mean));
        out
    }
}

/// Classifies an image by a sample of its pixels: [`STRETCHES`] of [`STRETCH`] bytes.
///
/// # Errors
/// When its packing or its levels are not known, or its length is not that of its pixels.
pub(super) fn classify(member: Member, frame: FrameFacts) -> Result<CalibrationImage, Error> {
    let profile = profile_for(&frame, member.length);
    let describe = |reason: &str| Error::malformed(&member.path, format!("{}: {reason}", member.name));
    frame.check_supported(&member.path)?;
    let packing = frame
        .packing
        .or(profile.map(|p| p.sensor.packing))
        .ok_or_else(|| describe("the packing of its pixels is not known"))?;
    let levels = frame
        .levels
        .clone()
        .or(profile.map(CameraProfile::levels))
        .ok_or_else(|| describe("its black and white level are not known"))?;
    let size = frame.size.or(profile.map(|p| (p.sensor.width, p.sensor.height)));
    if let Some((w, h)) = size
        && packing.bytes(w * h).map(|n| n as u64) != Some(member.length)
    {
        return Err(describe(&format!(
            "its {} bytes do not hold {w}x{h} pixels of {} bit",
            member.length,
            packing.bits()
        )));
    }
    let (mut sum, mut count, mut high) = (0u64, 0u64, 0u64);
    let white = levels.white.iter().copied().fold(f32::INFINITY, f32::min);
    for k in 0..STRETCHES {
        let start = (member.length.saturating_sub(STRETCH) * k / (STRETCHES - 1)) / GROUP * GROUP;
        let bytes = member.part(start, STRETCH)?;
        let pixels = bytes.len() * 8 / packing.bits() as usize / 4 * 4;
        for v in shifted(unpack(packing, &bytes, pixels).unwrap_or_default(), frame.right_shift) {
            sum += u64::from(v);
            count += 1;
            high += u64::from(f32::from(v) >= white * SATURATION);
        }
        if member.length <= STRETCH {
            break;
        }
    }
    if count == 0 {
        return Err(describe("it holds no pixels"));
    }
    let mean = sum as f64 / count as f64;
    let (black, white) = (f64::from(levels.black[1]), f64::from(white));
    let class = if frame.is_dark == Some(true) || mean < black + BLACK * (white - black) {
        ExposureClass::Black
    } else if mean < DARK * white {
        ExposureClass::Dark
    } else if high as f64 > SATURATED * count as f64 {
        ExposureClass::Saturated
    } else {
        ExposureClass::White
    };
    let names = frame.camera.white_ref.iter().cloned().collect();
    Ok(CalibrationImage { member, frame, names, class, mean })
}
