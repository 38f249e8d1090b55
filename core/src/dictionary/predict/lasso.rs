//! Patches by LASSO codes (paper section 4.4, eq. (4)): φ = argmin ½‖y − Dlᵀφ‖² + λ‖φ‖₁ with y = f/n, n = max(‖f‖,
//! floor); the patch is n·Dhᵀφ.

use std::sync::Arc;

use ndarray::{Array2, Axis};

use super::super::error::Error;
use super::super::features::row_norms;
use super::super::model::Model;
use super::super::options::ReconstructionOptions;
use super::super::patch_model::PatchModel;
use super::predictor::{PredictPatches, low_features};
use crate::sparse;

/// Duality gap, relative to ½‖y‖², at which a code is good enough.
///
/// Source: chosen.
const TOLERANCE: f64 = 1e-4;

/// Dl prepared for the solver, and Dh.
#[derive(Debug)]
pub(super) struct LassoCodes {
    model: Arc<Model>,
    low: sparse::Prepared,
    lambda: f32,
    /// Patches whose features have at most this norm have no residual.
    least_norm: f32,
}

impl LassoCodes {
    /// # Errors
    /// Atoms that the sparse solver refuses.
    pub(super) fn new(model: &Arc<Model>, options: &ReconstructionOptions) -> Result<Self, Error> {
        let parts = &model.patch_model;
        let lambda = options.lambda.unwrap_or(parts.lambda);
        // The code of a flat patch is zero, since |Dl y| ≤ ‖y‖ ≤ λ, so it is not passed to the solver.
        let least_norm = (lambda * parts.floor).max(options.flat);
        Ok(LassoCodes { low: sparse::prepare(parts.low.view())?, model: Arc::clone(model), lambda, least_norm })
    }
}

impl PredictPatches for LassoCodes {
    fn patch_model(&self) -> &PatchModel {
        &self.model.patch_model
    }

    fn predict(&self, padded: &[Array2<f32>], corners: &[(usize, usize)]) -> Result<Array2<f32>, Error> {
        let parts = &self.model.patch_model;
        let features = low_features(parts, padded, corners);
        let norms = row_norms(&features);
        let kept: Vec<usize> = (0..norms.len()).filter(|&n| norms[n] > self.least_norm).collect();
        let mut patches = Array2::zeros((features.nrows(), parts.high.ncols()));
        if kept.is_empty() {
            return Ok(patches);
        }
        let mut signals = features.select(Axis(0), &kept);
        for (mut row, &n) in signals.rows_mut().into_iter().zip(&kept) {
            row /= norms[n].max(parts.floor);
        }
        let options = sparse::Options {
            penalty: sparse::Penalty::Lambda(self.lambda),
            tolerance: TOLERANCE,
            ..sparse::Options::default()
        };
        let mut codes = sparse::solve(&self.low, signals.view(), &options)?;
        for (i, &n) in kept.iter().enumerate() {
            let range = codes.indptr[i]..codes.indptr[i + 1];
            codes.values[range].iter_mut().for_each(|v| *v *= norms[n].max(parts.floor));
        }
        let coded = codes.multiply(parts.high.view())?;
        for (row, &n) in coded.rows().into_iter().zip(&kept) {
            patches.row_mut(n).assign(&row);
        }
        Ok(patches)
    }
}
