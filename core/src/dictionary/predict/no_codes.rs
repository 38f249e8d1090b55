//! No codes: every residual patch is zero. What learned reconstruction does besides the dictionary (measured samples put
//! back, colours guided) stays, so that whatever a dictionary is worth shows as its margin over this.

use std::sync::Arc;

use ndarray::Array2;

use super::super::error::Error;
use super::super::model::Model;
use super::super::patch_model::PatchModel;
use super::predictor::PredictPatches;

/// A model whose codes are zero.
#[derive(Debug)]
pub(super) struct NoCodes {
    model: Arc<Model>,
}

impl NoCodes {
    pub(super) fn new(model: &Arc<Model>) -> Self {
        NoCodes { model: Arc::clone(model) }
    }
}

impl PredictPatches for NoCodes {
    fn patch_model(&self) -> &PatchModel {
        &self.model.patch_model
    }

    fn predict(&self, _: &[Array2<f32>], corners: &[(usize, usize)]) -> Result<Array2<f32>, Error> {
        let patch = self.patch_model().patch;
        Ok(Array2::zeros((corners.len(), patch * patch)))
    }
}
