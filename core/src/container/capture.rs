//! A capture: the raw pixels of one frame and the facts needed to develop them.

use super::cfa::Cfa;
use super::facts::{CameraFacts, ColourFacts, Levels, MlaHint};

/// A raw sensor image: one value per pixel, row 0 on top, digital numbers as stored.
#[derive(Debug, Clone, PartialEq)]
pub struct RawMosaic {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width·height` digital numbers, row-major.
    pub data: Vec<u16>,
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
    /// Whether the mosaic was stored as a JPEG picture. Its colours are damaged then: the filter array is the finest
    /// detail of a mosaic, and JPEG discards the finest detail first.
    pub jpeg: bool,
    /// White image in the same file (Illum .lfr), if any.
    pub white: Option<Box<Capture>>,
    /// Anomalies that did not prevent reading (a sha1 that does not match, missing metadata …), one line each.
    pub warnings: Vec<String>,
}

impl Capture {
    /// A capture with pixels, filter array and levels only: neutral colours, no facts of the camera or of its lenslets.
    ///
    /// ```
    /// use lenslet_core::container::{Capture, Cfa, Levels, RawMosaic};
    ///
    /// let mosaic = RawMosaic { width: 16, height: 16, data: vec![700; 256] };
    /// let capture = Capture::bare(mosaic, Cfa::Bggr, Levels { black: [168.0; 4], white: [4095.0; 4] });
    /// assert!(capture.mla.is_none() && capture.camera.model.is_none());
    /// assert_eq!(capture.colour.white_balance, [1.0; 4]);
    /// ```
    pub fn bare(mosaic: RawMosaic, cfa: Cfa, levels: Levels) -> Self {
        Capture {
            mosaic,
            cfa,
            levels,
            colour: ColourFacts::neutral(),
            camera: CameraFacts::default(),
            mla: None,
            source_sha256: String::new(),
            jpeg: false,
            white: None,
            warnings: Vec::new(),
        }
    }
}
