//! Predictors that need more than the atoms: one file each that fits what its predictor holds; this file calls them.

pub mod anchored;
mod fitting;
pub mod network;

use lenslet_core::dictionary::PatchModel;
use lenslet_data_gen::pairs::Crop;

pub(crate) use fitting::Fitting;

use crate::error::Error;
use crate::normalised_pairs::NormalisedPairs;

/// Fits the predictors that work on the features of Dl.
///
/// # Errors
/// Errors of each.
pub(crate) fn fit_to_pairs(model: &mut PatchModel, pairs: &NormalisedPairs, with: &Fitting<'_>) -> Result<(), Error> {
    model.anchored = anchored::fit_anchored(pairs, with)?;
    Ok(())
}

/// Fits the predictors that have features of their own.
///
/// # Errors
/// Errors of each.
pub(crate) fn fit_to_crops(model: &mut PatchModel, crops: &[Crop], with: &Fitting<'_>) -> Result<(), Error> {
    model.network = network::fit_network(crops, with)?;
    Ok(())
}
