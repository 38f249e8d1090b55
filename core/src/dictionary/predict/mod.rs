//! Predictors of residual patches: one file each, behind one trait; this file chooses among them.

mod anchored;
mod lasso;
mod network;
mod no_codes;
mod predictor;
mod ridge;

use std::sync::Arc;

use super::error::Error;
use super::model::Model;
use super::options::ReconstructionOptions;
use super::patch_model::{PatchModel, PatchPredictor};

pub use anchored::nearest_anchors;
pub use network::network_inputs;
pub(super) use predictor::PredictPatches;

/// The predictor that `options` select.
///
/// # Errors
/// A predictor that the model does not hold; atoms that the sparse solver refuses.
pub(super) fn prepare(model: &Arc<Model>, options: &ReconstructionOptions) -> Result<Arc<dyn PredictPatches>, Error> {
    model.patch_model.require(options.predictor)?;
    Ok(match options.predictor {
        PatchPredictor::NoCodes => Arc::new(no_codes::NoCodes::new(model)),
        PatchPredictor::Ridge => Arc::new(ridge::RidgeRegressor::new(model)),
        PatchPredictor::Anchored => Arc::new(anchored::AnchoredRegressors::new(model, options.flat)),
        PatchPredictor::Lasso => Arc::new(lasso::LassoCodes::new(model, options)?),
        PatchPredictor::Network => Arc::new(network::PatchNetwork::new(model)),
    })
}

/// Checks what a model holds for predictors of its own: shapes and finite numbers.
///
/// # Errors
/// [`Error::Parameter`] that says what is wrong.
pub(super) fn check_predictors(parts: &PatchModel) -> Result<(), Error> {
    if let Some(anchored) = &parts.anchored {
        anchored::check_anchored(anchored, parts.filters.nrows(), parts.patch * parts.patch)?;
    }
    parts.network.as_ref().map_or(Ok(()), network::check_network)
}

#[cfg(test)]
pub(super) use network::tests as network_tests;
