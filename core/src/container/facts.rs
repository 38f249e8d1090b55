//! The facts in a capture file besides its pixels, and the checks of their ranges.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

/// Largest width or height of a sensor, pixels.
pub(super) const MAX_SIDE: usize = 1 << 15;

/// Black and white level of each channel: from metadata, else from the camera profile.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Levels {
    /// Black level of R, Gr, Gb, B (DN).
    pub black: [f32; 4],
    /// White (saturation) level of R, Gr, Gb, B (DN).
    pub white: [f32; 4],
}

impl Levels {
    /// Whether 0 <= black < white <= 65535 in every channel.
    pub fn is_valid(&self) -> bool {
        self.black.iter().zip(&self.white).all(|(b, w)| *b >= 0.0 && b < w && *w <= 65535.0)
    }
}

/// Micro-lens array facts from metadata or profile: where calibration starts, never its result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MlaHint {
    /// Pitch in sensor pixels.
    pub pitch: f64,
    /// Rotation in radians as written by the camera (sign: see `docs/file-formats.md`).
    pub rotation: f64,
    /// Distance of rows over that of an ideal grid, 1 for an ideal one (`scaleFactor.y`).
    pub row_stretch: f64,
}

impl MlaHint {
    /// Whether the pitch is 2 to 500 pixels, the rotation within ±π and the stretch 0.5 to 2.
    pub fn is_valid(&self) -> bool {
        (2.0..=500.0).contains(&self.pitch) && self.rotation.abs() <= PI && (0.5..=2.0).contains(&self.row_stretch)
    }
}

/// Colour facts of one frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ColourFacts {
    /// White balance gains of R, Gr, Gb, B.
    pub white_balance: [f32; 4],
    /// Camera RGB to linear sRGB, row-major, rows = output R, G, B.
    pub ccm: [f32; 9],
    /// Encoding exponent written by the camera (about 1/2.4), if any.
    pub gamma: Option<f32>,
}

impl ColourFacts {
    /// Colour facts that change nothing: gains of 1, the unit matrix, no gamma.
    pub fn neutral() -> Self {
        ColourFacts { white_balance: [1.0; 4], ccm: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], gamma: None }
    }

    /// Whether each of the three facts is within its range.
    pub fn is_valid(&self) -> bool {
        gains_valid(&self.white_balance) && ccm_valid(&self.ccm) && self.gamma.is_none_or(gamma_valid)
    }
}

/// Whether white balance gains are positive and below 1000.
pub(super) fn gains_valid(gains: &[f32; 4]) -> bool {
    gains.iter().all(|g| *g > 0.0 && *g < 1000.0)
}

/// Whether a colour matrix has finite entries below 1000, not all of them zero.
pub(super) fn ccm_valid(ccm: &[f32; 9]) -> bool {
    ccm.iter().all(|v| v.abs() < 1000.0) && ccm.iter().any(|v| *v != 0.0)
}

/// Whether an encoding exponent lies in 0.05..=20.
pub(super) fn gamma_valid(gamma: f32) -> bool {
    (0.05..=20.0).contains(&gamma)
}

/// Which camera took the frame, and with which settings.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraFacts {
    /// Maker.
    pub make: Option<String>,
    /// Model, e.g. `F01`, `ILLUM`, `B01`.
    pub model: Option<String>,
    /// Serial number of the body.
    pub serial: Option<String>,
    /// Zoom stepper position.
    pub zoom_step: Option<i64>,
    /// Focus stepper position.
    pub focus_step: Option<i64>,
    /// ISO speed.
    pub iso: Option<f64>,
    /// Exposure time in seconds.
    pub exposure_seconds: Option<f64>,
    /// Exposure bias in EV (`image.modulationExposureBias`).
    pub exposure_bias: Option<f64>,
    /// Normalised responses (R, Gr, Gb, B) of the sensor to white, where given (white images).
    pub normalized_response: Option<[f32; 4]>,
    /// sha1 of the white image that belongs to the capture, where named (`sha1-…`).
    pub white_ref: Option<String>,
}
