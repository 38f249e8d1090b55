//! Patches by one ridge regressor: residual = fᵀ·W, W = argmin Σ ‖fᵀW − t‖² + ρ‖W‖² over the training pairs; the
//! baseline of a single linear filter.

use std::sync::Arc;

use ndarray::Array2;

use super::super::error::Error;
use super::super::model::Model;
use super::super::patch_model::PatchModel;
use super::predictor::{PredictPatches, low_features};
use crate::linalg::{Par, product};

/// The model's ridge regressor.
#[derive(Debug)]
pub(super) struct RidgeRegressor {
    model: Arc<Model>,
}

impl RidgeRegressor {
    pub(super) fn new(model: &Arc<Model>) -> Self {
        RidgeRegressor { model: Arc::clone(model) }
    }
}

impl PredictPatches for RidgeRegressor {
    fn patch_model(&self) -> &PatchModel {
        &self.model.patch_model
    }

    fn predict(&self, padded: &[Array2<f32>], corners: &[(usize, usize)]) -> Result<Array2<f32>, Error> {
        let parts = &self.model.patch_model;
        let features = low_features(parts, padded, corners);
        Ok(product(features.view(), parts.ridge.view(), Par::Seq))
    }
}
