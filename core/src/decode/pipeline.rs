//! Decoding: the raw stage, the demosaic and the view stage, one after the other.

use crate::geometry::Size;
use ndarray::Array3;

use super::error::Error;
use super::options::Options;
use super::raw_stage::develop_mosaic;
use super::samples::HexSamples;
use super::steps::{Demosaic, steps_for};
use super::turn::Turn;
use super::view_stage::apply_view_steps;
use super::{aperture, check, cokriging, demosaic, slice};
use crate::calibration::{Calibration, check_compatible};
use crate::container::{Capture, Cfa};
use crate::progress::{Observer, Silent};

/// Decodes `capture`: every view's value at every lenslet, linear light, colour-corrected RGB (grey for a sensor
/// without colour filters). Values are nominally 0..1 (1 = a white surface in full light), and clamped only by
/// [`ViewStep::Gamut`](super::ViewStep::Gamut).
///
/// # Errors
/// A calibration of another camera, inconsistent inputs, options out of range, interruption.
pub fn sample_views(
    capture: &Capture,
    calibration: &Calibration,
    options: &Options,
    observer: &dyn Observer,
) -> Result<HexSamples, Error> {
    check_compatible(calibration, capture)?;
    check::check_inputs(capture, calibration, options)?;
    let mosaic = develop_mosaic(capture, calibration, options, observer)?;
    observer.check()?;
    let [dx, dy] = if options.recentre { aperture::aperture_middle(calibration) } else { [0.0; 2] };
    let centres: Vec<[f64; 2]> = calibration.lenslets.iter().map(|l| [l.x + dx, l.y + dy]).collect();
    let mut samples = HexSamples {
        sensor: Size::new(calibration.width, calibration.height),
        index: calibration.lenslets.iter().map(|l| [l.i, l.j]).collect(),
        views: options.views,
        view_step: options.view_step,
        weights: aperture::view_weights(calibration, &centres, options.views, options.view_step),
        centres,
        values: Array3::zeros((0, 0, 0)),
    };
    let cfa = capture.cfa;
    let slice = |image: Array3<f32>| {
        if !options.rotate_raw {
            return slice::slice_views(&image, &samples, &|place| place, observer);
        }
        let turn = Turn::upright(calibration.lattice.rotation(), calibration.width, calibration.height);
        slice::slice_views(&turn.apply(&image), &samples, &|place| turn.turned(place), observer)
    };
    samples.values = match options.steps.demosaic {
        // Without a filter array nothing is missing.
        _ if cfa == Cfa::Mono => slice(demosaic::mono(&mosaic))?,
        Demosaic::CoKriging => cokriging::sample_views(&mosaic, cfa, calibration, &samples, observer)?,
        Demosaic::Bilinear => slice(demosaic::bilinear(&mosaic, cfa))?,
        Demosaic::Malvar => slice(demosaic::malvar(&mosaic, cfa))?,
    };
    drop(mosaic);
    apply_view_steps(&mut samples, &options.steps.view, capture, calibration, observer)?;
    Ok(samples)
}

impl HexSamples {
    /// Decodes a capture with the default [`Options`] and the steps that fit it ([`steps_for`]), without reporting
    /// progress.
    ///
    /// # Errors
    /// As [`sample_views`].
    ///
    /// An evenly lit grey surface comes out grey in all views:
    /// ```
    /// use lenslet_core::calibration::{Calibration, Grid, Lattice, Lenslet};
    /// use lenslet_core::container::{Capture, Cfa, Levels, RawMosaic};
    /// use lenslet_core::decode::HexSamples;
    ///
    /// let lattice = Lattice { grid: Grid::Square, origin: [32.0, 32.0], a: [10.0, 0.0], b: [0.0, 10.0] };
    /// let places = (-2..=2).flat_map(|j| (-2..=2).map(move |i| (i, j)));
    /// let lenslet = |(i, j)| {
    ///     let [x, y] = lattice.centre(i, j);
    ///     Lenslet { i, j, x, y, trust: 1.0 }
    /// };
    /// let calibration = Calibration {
    ///     width: 64,
    ///     height: 64,
    ///     lattice,
    ///     lenslets: places.map(lenslet).collect(),
    ///     vignetting: None,
    ///     hot_pixels: Vec::new(),
    ///     quality: Default::default(),
    ///     origin: Default::default(),
    /// };
    /// let mosaic = RawMosaic { width: 64, height: 64, data: vec![500; 64 * 64] };
    /// let capture = Capture::bare(mosaic, Cfa::Bggr, Levels { black: [0.0; 4], white: [1000.0; 4] });
    /// let samples = HexSamples::decode(&capture, &calibration)?;
    /// assert_eq!(samples.values.dim(), (49, 25, 3));
    /// assert!(samples.values.iter().all(|value| (value - 0.5).abs() < 1e-3));
    /// # Ok::<(), lenslet_core::decode::Error>(())
    /// ```
    pub fn decode(capture: &Capture, calibration: &Calibration) -> Result<HexSamples, Error> {
        let options = Options { steps: steps_for(capture), ..Options::default() };
        sample_views(capture, calibration, &options, &Silent)
    }
}

impl Capture {
    /// Decodes to hexagonal samples of 7×7 views with the default steps: see [`HexSamples::decode`].
    ///
    /// # Errors
    /// As [`sample_views`]: a calibration of another camera, a mosaic that does not fit.
    pub fn decode(&self, calibration: &Calibration) -> Result<HexSamples, Error> {
        HexSamples::decode(self, calibration)
    }
}
