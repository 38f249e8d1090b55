//! Files of lenslet cameras: LFP/LFR containers, raw mosaics, metadata, camera profiles.
//!
//! [`open`] turns any capture file into a [`Capture`]; [`segments`] and [`references`] look inside a container,
//! [`write_lfp`] makes one; [`whites`] finds the white image of a
//! capture. The plain types below are what the rest of the toolkit sees of a capture.

mod capture;
mod depth;
mod error;
pub mod extract;
mod file;
pub mod json;
mod lfp;
pub mod members;
pub mod metadata;
mod mosaic;
pub mod packing;
pub mod profile;
mod raw;
pub mod references;
pub mod segments;
pub mod whites;
mod write;

pub use capture::{is_jpeg, open};
pub use error::Error;
pub use lfp::{Located, locate};
pub use profile::{Profile, profile, profiles};
pub use write::write_lfp;

use serde::{Deserialize, Serialize};

/// Colour filter array of the 2×2 tile whose top left pixel is pixel (0,0).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Cfa {
    /// R G / G B
    Rggb,
    /// B G / G R (Lytro F01)
    Bggr,
    /// G R / B G (Lytro Illum)
    Grbg,
    /// G B / R G
    Gbrg,
    /// No colour filter.
    Mono,
}

impl Cfa {
    /// Channel of the pixel at (`x`, `y`): 0 red, 1 green on red rows, 2 green on blue rows, 3 blue; `Mono` is 1.
    #[inline]
    pub fn plane(self, x: usize, y: usize) -> usize {
        let k = (y & 1) * 2 + (x & 1);
        match self {
            Cfa::Rggb => [0, 1, 2, 3][k],
            Cfa::Bggr => [3, 2, 1, 0][k],
            Cfa::Grbg => [1, 0, 3, 2][k],
            Cfa::Gbrg => [2, 3, 0, 1][k],
            Cfa::Mono => 1,
        }
    }

    /// Colour of the pixel at (`x`, `y`): 0 red, 1 green, 2 blue.
    #[inline]
    pub fn colour(self, x: usize, y: usize) -> usize {
        [0, 1, 1, 2][self.plane(x, y)]
    }
}

/// A raw sensor image: one value a pixel, row 0 on top, digital numbers as stored.
#[derive(Debug, Clone, PartialEq)]
pub struct RawMosaic {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width·height` digital numbers, row-major.
    pub data: Vec<u16>,
}

/// What develops a mosaic: filled from metadata, else from the camera profile.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Levels {
    /// Black level of R, Gr, Gb, B (DN).
    pub black: [f32; 4],
    /// White (saturation) level of R, Gr, Gb, B (DN).
    pub white: [f32; 4],
}

/// Micro-lens array facts from metadata or profile: a first guess for calibration, never the truth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MlaHint {
    /// Pitch in sensor pixels.
    pub pitch: f64,
    /// Rotation in radians as written by the camera (sign: see `docs/file-formats.md`).
    pub rotation: f64,
    /// Row stretch (`scaleFactor.y`).
    pub row_stretch: f64,
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

/// Who took the frame, and how.
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
    /// `image.modulationExposureBias` (EV).
    pub exposure_bias: Option<f64>,
    /// Normalised responses (R, Gr, Gb, B) of the sensor to white, where given (white images).
    pub normalized_response: Option<[f32; 4]>,
    /// sha1 of the white image that belongs to the capture, where named (`sha1-…`).
    pub white_ref: Option<String>,
}

/// A capture: mosaic and every fact needed to develop it.
#[derive(Debug, Clone, PartialEq)]
pub struct Capture {
    /// Raw pixels.
    pub mosaic: RawMosaic,
    /// Colour filter array.
    pub cfa: Cfa,
    /// Black and white levels.
    pub levels: Levels,
    /// Colour facts.
    pub colour: ColourFacts,
    /// Camera facts.
    pub camera: CameraFacts,
    /// Micro-lens array hint.
    pub mla: Option<MlaHint>,
    /// sha256 (hex) of the file the mosaic came from.
    pub source_sha256: String,
    /// White image carried by the same file (Illum .lfr), if any.
    pub white: Option<Box<Capture>>,
    /// Things that were odd but survivable (a sha1 that does not match, missing metadata …), one line each.
    pub warnings: Vec<String>,
}

impl Capture {
    /// A capture of which nothing is known but its pixels, filter array and levels: neutral colours, no camera, no lenslets.
    pub fn bare(mosaic: RawMosaic, cfa: Cfa, levels: Levels) -> Self {
        Capture {
            mosaic,
            cfa,
            levels,
            colour: profile::neutral(),
            camera: CameraFacts::default(),
            mla: None,
            source_sha256: String::new(),
            white: None,
            warnings: Vec::new(),
        }
    }
}
