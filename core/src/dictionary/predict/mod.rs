//! Predictors of residual patches: one file each, behind one trait; this file chooses among them.

mod anchored;
mod lasso;
mod network;
mod predictor;
mod ridge;

use std::sync::Arc;

use super::error::Error;
use super::model::{Model, PatchModel, PatchPredictor};
use super::options::ReconstructionOptions;

pub use anchored::nearest_anchors;
pub use network::network_inputs;
pub(super) use predictor::PredictPatches;

/// The predictor that `options` select, or the LASSO codes where the model has no such predictor.
///
/// # Errors
/// Atoms that the sparse solver refuses.
pub(super) fn prepare(model: &Arc<Model>, options: &ReconstructionOptions) -> Result<Arc<dyn PredictPatches>, Error> {
    let parts = &model.patch_model;
    Ok(match options.predictor {
        PatchPredictor::Anchored if parts.anchored.is_some() => {
            Arc::new(anchored::AnchoredRegressors::new(model, options.flat))
        }
        PatchPredictor::Network if parts.network.is_some() => Arc::new(network::PatchNetwork::new(model)),
        PatchPredictor::Ridge => Arc::new(ridge::RidgeRegressor::new(model)),
        _ => Arc::new(lasso::LassoCodes::new(model, options)?),
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

/// The predictor for calls that lack side inputs, where `first` has any.
///
/// # Errors
/// As [`prepare`].
pub(super) fn prepare_without_side_inputs(
    first: &dyn PredictPatches,
    model: &Arc<Model>,
    options: &ReconstructionOptions,
) -> Result<Option<Arc<dyn PredictPatches>>, Error> {
    if first.side_inputs().is_empty() {
        return Ok(None);
    }
    Ok(Some(Arc::new(lasso::LassoCodes::new(model, options)?)))
}

#[cfg(test)]
pub(super) use network::tests as network_tests;
