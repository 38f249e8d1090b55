//! From a raw mosaic to hexagonally sampled views (paper sections 3.1 and 4): vignetting, demosaic, colour, slicing.
//!
//! The way is a list of [`Step`]s, so that any of them can be left out or exchanged and the loss measured. Everything
//! is linear light until the views are encoded for the screen, which happens after resampling.

pub mod colour;
mod demosaic;
mod develop;
mod micro;
pub mod npz;
mod slice;

use ndarray::Array3;

pub use develop::{Mosaic, mosaic};

use crate::calibration::Calibration;
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
    /// Camera colours to linear sRGB.
    ColourMatrix,
    /// Multiply by 2^EV.
    Exposure(f32),
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
    /// The steps. Default: [`default_steps`].
    pub steps: Vec<Step>,
}

impl Default for Options {
    fn default() -> Self {
        Options { views: 7, view_step: 1.0, white_balance: WhiteBalance::Camera, steps: default_steps() }
    }
}

/// All steps, in order.
pub fn default_steps() -> Vec<Step> {
    vec![
        Step::BlackLevel,
        Step::Vignetting,
        Step::HotPixels,
        Step::WhiteBalance,
        Step::Highlights,
        Step::Demosaic(Demosaic::Lenslet),
        Step::ColourMatrix,
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
/// without colour filters). Values are nominally 0..1 (1 = a white surface in full light), not clamped.
///
/// # Errors
/// A calibration of another sensor size, inconsistent inputs, options out of range, interruption.
pub fn samples(
    capture: &Capture,
    calibration: &Calibration,
    options: &Options,
    observer: &dyn Observer,
) -> Result<HexSamples, Error> {
    check(capture, calibration, options)?;
    let developed = develop::mosaic(capture, calibration, options, observer)?;
    if observer.cancelled() {
        return Err(Error::Interrupted);
    }
    let mut samples = HexSamples {
        sensor: (calibration.width, calibration.height),
        centres: calibration.lenslets.iter().map(|l| [l.x, l.y]).collect(),
        index: calibration.lenslets.iter().map(|l| [l.i, l.j]).collect(),
        views: options.views,
        view_step: options.view_step,
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
            Step::ColourMatrix if capture.cfa != Cfa::Mono => {
                colour::apply_matrix(&mut samples.values, &capture.colour.ccm)
            }
            Step::Exposure(ev) => samples.values.mapv_inplace(|v| v * ev.exp2()),
            _ => {}
        }
    }
    Ok(samples)
}

fn after_demosaic(steps: &[Step]) -> impl Iterator<Item = &Step> {
    steps.iter().skip_while(|s| !matches!(s, Step::Demosaic(_)))
}

fn check(capture: &Capture, calibration: &Calibration, options: &Options) -> Result<(), Error> {
    let (width, height) = (capture.mosaic.width, capture.mosaic.height);
    if (calibration.width, calibration.height) != (width, height) {
        return Err(Error::Mismatch { calibration: (calibration.width, calibration.height), capture: (width, height) });
    }
    let pixels = width.checked_mul(height).filter(|&n| n > 0 && n <= 1 << 28);
    if pixels != Some(capture.mosaic.data.len()) || width < 8 || height < 8 {
        return Err(Error::Capture(format!("{} values for {width}x{height} pixels", capture.mosaic.data.len())));
    }
    for k in 0..4 {
        let (black, white) = (capture.levels.black[k], capture.levels.white[k]);
        if !(black.is_finite() && white.is_finite() && white > black) {
            return Err(Error::Capture(format!("black level {black} and white level {white} leave no range")));
        }
    }
    let finite = |v: &[f32]| v.iter().all(|v| v.abs() < 1e6);
    if !finite(&capture.colour.ccm) || !capture.colour.white_balance.iter().all(|&g| g > 0.0 && g < 1e3) {
        return Err(Error::Capture("its white balance or colour matrix has no sensible values".into()));
    }
    if let Some(v) = &calibration.vignetting
        && ((v.width, v.height) != (width, height) || Some(v.white.len()) != pixels)
    {
        return Err(Error::Calibration(format!(
            "its white image is {}x{}, its sensor {width}x{height}",
            v.width, v.height
        )));
    }
    let hot = &calibration.hot_pixels;
    if !hot.windows(2).all(|w| w[0] < w[1]) || hot.last().is_some_and(|&k| Some(k as usize) >= pixels) {
        return Err(Error::Calibration("its hot pixels are not on its sensor, or not in order".into()));
    }
    if calibration.lenslets.is_empty() || u32::try_from(calibration.lenslets.len()).is_err() {
        return Err(Error::Calibration(format!("it has {} lenslets", calibration.lenslets.len())));
    }
    let near = |l: &crate::calibration::Lenslet| {
        (-64.0..width as f64 + 64.0).contains(&l.x) && (-64.0..height as f64 + 64.0).contains(&l.y)
    };
    if !calibration.lenslets.iter().all(near) {
        return Err(Error::Calibration("it has a lenslet far off the sensor".into()));
    }
    if options.views.is_multiple_of(2) || options.views > 15 {
        return Err(Error::Parameter(format!("{0}x{0} views: the number must be odd, 1 to 15", options.views)));
    }
    if !(options.view_step > 0.0 && options.view_step <= 4.0) {
        return Err(Error::Parameter(format!(
            "a view step of {} pixels: it must be above 0, up to 4",
            options.view_step
        )));
    }
    let kinds = options.steps.iter().filter(|s| matches!(s, Step::Demosaic(_))).count();
    let mut early = options.steps.iter().take_while(|s| !matches!(s, Step::Demosaic(_)));
    if kinds != 1 || early.any(|s| matches!(s, Step::ColourMatrix | Step::Exposure(_))) {
        return Err(Error::Parameter(
            "the steps need exactly one demosaic, and colour matrix and exposure come after it".into(),
        ));
    }
    let mut late = after_demosaic(&options.steps).skip(1);
    if late.any(|s| !matches!(s, Step::ColourMatrix | Step::Exposure(_))) {
        return Err(Error::Parameter("after the demosaic only colour matrix and exposure can follow".into()));
    }
    if options.steps.iter().any(|s| matches!(s, Step::Exposure(ev) if !(-32.0..=32.0).contains(ev))) {
        return Err(Error::Parameter("the exposure must be within 32 EV".into()));
    }
    if let WhiteBalance::Gains(gains) = options.white_balance
        && !gains.iter().all(|&g| g > 0.0 && g < 1e3)
    {
        return Err(Error::Parameter(format!("white balance {gains:?}: each gain must be above 0, below 1000")));
    }
    Ok(())
}
