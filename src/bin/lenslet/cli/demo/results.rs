//! The demo's results: views of every method with their scores, and the calibration with its truth.

use std::time::Instant;

use lenslet_core::calibration::Calibration;
use lenslet_core::dictionary::PatchPredictor;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::View;
use lenslet_core::metrics::Scores;
use lenslet_data_gen::simulate::Camera;
use ndarray::Array3;

/// Views a side, and those that are scored (row, column): the centre and the corners.
pub(super) const VIEWS: usize = 7;
pub(super) const SCORED: [(usize, usize); 5] = [(3, 3), (0, 0), (0, 6), (6, 0), (6, 6)];
/// Crops shown: name and middle as shares of the picture.
pub(super) const CROPS: [(&str, f64, f64); 4] =
    [("star", 0.33, 0.27), ("letters", 0.19, 0.49), ("leaves", 0.72, 0.18), ("fruit and wall", 0.6, 0.67)];

/// What was simulated.
pub(super) struct Simulated {
    /// Longer side of the views, pixels.
    pub(super) size: usize,
    pub(super) seed: u64,
    pub(super) camera: Camera,
    /// Time of scene, capture, white images and true views.
    pub(super) seconds: f64,
}

/// One method's views, sRGB-encoded, in the order of [`SCORED`].
pub(super) struct Reconstruction {
    pub(super) name: String,
    pub(super) about: &'static str,
    /// How the views were interpolated.
    pub(super) base: Interpolation,
    /// What reconstructed them, where anything did.
    pub(super) predictor: Option<PatchPredictor>,
    pub(super) views: Vec<Array3<f32>>,
    pub(super) seconds: f64,
    pub(super) scores: Vec<Scores>,
}

impl Reconstruction {
    pub(super) fn interpolated(base: Interpolation, about: &'static str, views: &[View], began: Instant) -> Self {
        Reconstruction::new(base.name().into(), about, base, None, (views, began))
    }

    pub(super) fn learned(base: Interpolation, predictor: PatchPredictor, views: &[View], began: Instant) -> Self {
        let on = if base == Interpolation::Barycentric { String::new() } else { format!(" on {base}") };
        Reconstruction::new(format!("{predictor}{on}"), predictor.meaning(), base, Some(predictor), (views, began))
    }

    fn new(
        name: String,
        about: &'static str,
        base: Interpolation,
        predictor: Option<PatchPredictor>,
        (views, began): (&[View], Instant),
    ) -> Self {
        let seconds = began.elapsed().as_secs_f64();
        let views = views.iter().map(|view| view.encode().into_pixels()).collect();
        Reconstruction { name, about, base, predictor, views, seconds, scores: Vec::new() }
    }

    /// The options of `decode` that make these views.
    pub(super) fn decode_options(&self) -> String {
        match self.predictor {
            None => format!("--method {}", self.base),
            Some(predictor) => {
                format!("--method learned --base {} --path {}", self.base, predictor.word())
            }
        }
    }
}

/// The calibration, the number of lenslets there are, and the RMS distance of the centres from the true ones, pixels.
pub(super) struct Calibrated {
    pub(super) found: Calibration,
    pub(super) truth: usize,
    pub(super) rms: f64,
    pub(super) seconds: f64,
}

/// The mean of one score over views.
pub(super) fn mean(scores: &[Scores], of: impl Fn(&Scores) -> f64) -> f64 {
    scores.iter().map(of).sum::<f64>() / scores.len().max(1) as f64
}
