//! PSNR of dictionaries on the held-out crops while they are learned.

use lenslet_core::dictionary::{
    Footprint, Model, PatchModel, PatchPredictor, PlaneReconstructor, ReconstructionOptions,
};
use lenslet_core::interpolation::Interpolation;
use lenslet_data_gen::pairs::{Crop, Degradation};
use ndarray::Array2;

use crate::error::Error;
use crate::normalised_pairs::NormalisedPairs;
use crate::parameters::Parameters;

/// Held-out crops that are scored at most: enough to see whether learning gains.
/// Source: chosen.
const MOST_CROPS: usize = 6;

/// Pixels between neighbouring patches while scoring.
/// Source: chosen; a third of the time of every pixel, scores stay comparable.
const STEP: usize = 3;

/// Scores dictionaries on the held-out crops.
pub struct Scorer<'a> {
    /// The model without atoms: what all scored models share.
    pub patch_model: PatchModel,
    footprint: Footprint,
    base: Interpolation,
    pitch: f64,
    crops: &'a [Crop],
    /// Mean PSNR, dB, of the low images.
    pub low: Option<f64>,
}

impl<'a> Scorer<'a> {
    /// A scorer of models that share everything but the atoms (and what comes later) with `pairs`.
    pub fn new(
        footprint: Footprint,
        degradation: &Degradation,
        crops: &'a [Crop],
        pairs: &NormalisedPairs,
        parameters: &Parameters,
    ) -> Self {
        let d = &parameters.dictionary;
        let patch_model = PatchModel {
            lambda: d.lambda,
            ridge: pairs.ridge.clone(),
            ..PatchModel::of_features(d.window + 4, d.patch, pairs.filters.clone(), pairs.floor)
        };
        let crops = &crops[..crops.len().min(MOST_CROPS)];
        let errors = crops.iter().map(|c| mean_squared_error(&c.low, &c.high));
        let low = mean_psnr(errors);
        let (base, pitch) = (degradation.base, degradation.pitch);
        Scorer { patch_model, footprint, base, pitch, crops, low }
    }

    /// Mean PSNR, dB, of atoms Dl and Dh by the LASSO path; `None` without held-out crops.
    ///
    /// # Errors
    /// Errors of the reconstruction.
    pub fn score(&self, low: &Array2<f32>, high: &Array2<f32>) -> Result<Option<f64>, Error> {
        let patch_model = PatchModel { low: low.clone(), high: high.clone(), ..self.patch_model.clone() };
        self.score_by(patch_model, PatchPredictor::Lasso)
    }

    /// Mean PSNR, dB, of a whole model by one path.
    ///
    /// # Errors
    /// Errors of the reconstruction.
    pub fn score_by(&self, patch_model: PatchModel, predictor: PatchPredictor) -> Result<Option<f64>, Error> {
        let model = Model { footprint: self.footprint, base: self.base, pitch: self.pitch, patch_model };
        let step = STEP.min(self.patch_model.patch);
        let options = ReconstructionOptions { predictor, step, ..ReconstructionOptions::default() };
        let reconstructor = PlaneReconstructor::new(&model, &options)?;
        let mut errors = Vec::new();
        for crop in self.crops {
            errors.push(mean_squared_error(
                &reconstructor.reconstruct_plane(crop.low.view(), &crop.side_inputs)?,
                &crop.high,
            ));
        }
        Ok(mean_psnr(errors.into_iter()))
    }
}

/// Mean squared error, values clamped to the range.
fn mean_squared_error(result: &Array2<f32>, truth: &Array2<f32>) -> f64 {
    let sum: f64 = result.iter().zip(truth).map(|(a, b)| f64::from(a.clamp(0.0, 1.0) - b).powi(2)).sum();
    sum / truth.len().max(1) as f64
}

fn mean_psnr(errors: impl Iterator<Item = f64>) -> Option<f64> {
    let all: Vec<f64> = errors.map(|e| -10.0 * e.max(1e-10).log10()).collect();
    if all.is_empty() { None } else { Some(all.iter().sum::<f64>() / all.len() as f64) }
}
