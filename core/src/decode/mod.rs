//! From a raw mosaic to hexagonally sampled views (paper sections 3.1 and 4): vignetting, demosaic, colour, slicing.
//!
//! The way is a list of [`Step`]s, so that any of them can be left out or exchanged and the loss measured. Everything
//! is linear light until the views are encoded for the screen, which happens after resampling.

mod aperture;
mod calm;
mod check;
pub mod colour;
mod demosaic;
mod develop;
pub mod gamut;
mod micro;
pub mod npz;
mod slice;

use ndarray::Array3;

pub use develop::{Mosaic, mosaic};

use crate::calibration::{Calibration, Grid};
use crate::container::{Capture, Cfa};
use crate::progress::Observer;

/// Hexagonal samples: one value a lenslet of each view, before any resampling. Linear light.
#[derive(Debug, Clone, PartialEq)]
pub struct HexSamples {
    /// Sensor size (width, height) in pixels: the frame of `centres`.
    pub sensor: (usize, usize),
    /// Lenslet centres (x, y) in sensor pixels, pixel centres at integers. They place the samples of *every* view.
    pub centres: Vec<[f64; 2]>,
    /// Lattice index (i, j) of each lenslet.
    pub index: Vec<[i32; 2]>,
    /// Views a row and a column (odd): view (v, u) has index `(v + n/2)·n + u + n/2`.
    pub views: usize,
    /// Sensor pixels between neighbouring views.
    pub view_step: f64,
    /// How far each view can be relied on, 0..=1 in the order of the views: its share of the light of the best lit one, 0 where
    /// it looks past the border of its micro-image.
    pub weights: Vec<f32>,
    /// Values, shape (views², lenslets, channels).
    pub values: Array3<f32>,
}

/// How three colours a pixel come from one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Demosaic {
    /// Means of the nearest pixels of each colour.
    Bilinear,
    /// Malvar, He and Cutler's gradient-corrected 5×5 filters (2004): the plain alternative.
    Malvar,
    /// Each micro-image by itself, colours and views in one least-error estimate. See `micro`.
    Lenslet,
}

/// One step of the way from digital numbers to linear colour, in the order it is taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// Subtract the black level of each colour. Without it black counts as light.
    BlackLevel,
    /// Replace the pixels the calibration knows to be hot, and single ones far above all their neighbours of the same colour.
    HotPixels,
    /// Divide by the white image, where the calibration has one.
    Vignetting,
    /// Multiply by the white balance.
    WhiteBalance,
    /// Cut every colour where the first one saturates, so that highlights stay neutral.
    Highlights,
    /// Three colours from one. Exactly one such step; steps before it see the mosaic, steps after it the samples.
    Demosaic(Demosaic),
    /// Smooth the colours, not the light: for mosaics whose colours a JPEG coder damaged, and very noisy ones. Not among the
    /// default steps.
    CalmColours,
    /// Camera colours to linear sRGB.
    ColourMatrix,
    /// Multiply by 2^(the exposure bias that the capture states), see [`colour::exposure_bias`].
    ExposureBias,
    /// Multiply by 2^EV.
    Exposure(f32),
    /// Bring colours that the screen cannot show into 0..=1, hue kept: see [`gamut`]. Without it values may lie
    /// anywhere, as scene-linear output wants.
    Gamut,
}

/// Where the white balance comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WhiteBalance {
    /// The capture's own gains (metadata or profile).
    Camera,
    /// Estimated from the capture: see [`colour::estimate_gains`].
    Auto,
    /// Gains of red, green, blue.
    Gains([f32; 3]),
}

/// Options of [`samples`].
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Views a row and a column: odd, 1 to 15. Default 7, the paper's choice.
    pub views: usize,
    /// Sensor pixels between neighbouring views: above 0, up to 4. Default 1.
    pub view_step: f64,
    /// Where the white balance comes from. Default: the capture.
    pub white_balance: WhiteBalance,
    /// Move all views so that (0, 0) is the middle of the aperture, where the white image shows another than the
    /// calibration's centres. Default: yes.
    pub recentre: bool,
    /// The steps. Default: [`default_steps`].
    pub steps: Vec<Step>,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            views: 7,
            view_step: 1.0,
            white_balance: WhiteBalance::Camera,
            recentre: true,
            steps: default_steps(),
        }
    }
}

/// The usual steps, in order.
pub fn default_steps() -> Vec<Step> {
    vec![
        Step::BlackLevel,
        Step::Vignetting,
        Step::HotPixels,
        Step::WhiteBalance,
        Step::Highlights,
        Step::Demosaic(Demosaic::Lenslet),
        Step::ColourMatrix,
        Step::ExposureBias,
        Step::Gamut,
    ]
}

/// What goes wrong in decoding.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The calibration belongs to another camera.
    #[error(
        "the calibration is for a {}x{} sensor, the capture has {}x{} pixels; use the calibration of this camera",
        calibration.0, calibration.1, capture.0, capture.1
    )]
    Mismatch {
        /// Sensor of the calibration.
        calibration: (usize, usize),
        /// Sensor of the capture.
        capture: (usize, usize),
    },
    /// The capture's own numbers contradict each other.
    #[error("the capture is inconsistent: {0}")]
    Capture(String),
    /// The calibration's own numbers contradict each other.
    #[error("the calibration is inconsistent: {0}")]
    Calibration(String),
    /// An option out of range.
    #[error("{0}")]
    Parameter(String),
    /// A file of samples that cannot be read or written.
    #[error("{path}: {reason}")]
    File {
        /// Which file.
        path: String,
        /// Why.
        reason: String,
    },
    /// The output could not be put in place.
    #[error(transparent)]
    Output(#[from] crate::output::Error),
    /// The observer asked to stop.
    #[error("interrupted")]
    Interrupted,
}

/// Decodes `capture`: every view's value at every lenslet, linear light, colour-corrected RGB (grey for a sensor
/// without colour filters). Values are nominally 0..1 (1 = a white surface in full light), and clamped only by [`Step::Gamut`].
///
/// # Errors
/// A calibration of another sensor size, inconsistent inputs, options out of range, interruption.
pub fn samples(
    capture: &Capture,
    calibration: &Calibration,
    options: &Options,
    observer: &dyn Observer,
) -> Result<HexSamples, Error> {
    check::check(capture, calibration, options)?;
    let developed = develop::mosaic(capture, calibration, options, observer)?;
    if observer.cancelled() {
        return Err(Error::Interrupted);
    }
    let [dx, dy] = if options.recentre { aperture::middle(calibration) } else { [0.0; 2] };
    let centres: Vec<[f64; 2]> = calibration.lenslets.iter().map(|l| [l.x + dx, l.y + dy]).collect();
    let mut samples = HexSamples {
        sensor: (calibration.width, calibration.height),
        index: calibration.lenslets.iter().map(|l| [l.i, l.j]).collect(),
        views: options.views,
        view_step: options.view_step,
        weights: aperture::weights(calibration, &centres, options.views, options.view_step),
        centres,
        values: Array3::zeros((0, 0, 0)),
    };
    let kind = options.steps.iter().find_map(|s| match s {
        Step::Demosaic(kind) => Some(*kind),
        _ => None,
    });
    samples.values = match kind {
        Some(Demosaic::Lenslet) => micro::views(&developed, capture.cfa, calibration, &samples, observer)?,
        kind => {
            let image = match kind {
                _ if capture.cfa == Cfa::Mono => demosaic::mono(&developed),
                Some(Demosaic::Bilinear) => demosaic::bilinear(&developed, capture.cfa),
                _ => demosaic::malvar(&developed, capture.cfa),
            };
            slice::views(&image, &samples, observer)?
        }
    };
    for step in after_demosaic(&options.steps) {
        match step {
            Step::CalmColours => {
                let hexagonal = calibration.lattice.grid != Grid::Square;
                calm::smooth(&mut samples.values, &samples.index, hexagonal);
            }
            Step::ColourMatrix if capture.cfa != Cfa::Mono => {
                colour::apply_matrix(&mut samples.values, &capture.colour.ccm)
            }
            Step::ExposureBias => colour::brighten(&mut samples.values, colour::exposure_bias(&capture.camera)),
            Step::Exposure(ev) => colour::brighten(&mut samples.values, *ev),
            Step::Gamut => gamut::fit_all(&mut samples.values),
            _ => {}
        }
    }
    Ok(samples)
}

fn after_demosaic(steps: &[Step]) -> impl Iterator<Item = &Step> {
    steps.iter().skip_while(|s| !matches!(s, Step::Demosaic(_)))
}
