//! Predictors that need more than the atoms: one file each that fits what its predictor holds; this file calls them.

pub mod anchored;
pub mod network;

use lenslet_core::dictionary::{Footprint, PatchModel};
use lenslet_core::progress::Observer;
use lenslet_data_gen::pairs::Crop;
use rand::rngs::ChaCha8Rng;

use crate::error::Error;
use crate::normalised_pairs::NormalisedPairs;
use crate::parameters::Parameters;

/// What the fitting of a predictor is told besides what it is fitted to.
pub(crate) struct Fitting<'a> {
    pub(crate) footprint: Footprint,
    pub(crate) parameters: &'a Parameters,
    pub(crate) observer: &'a dyn Observer,
    /// The random stream of the current model by a number that no other stage uses.
    pub(crate) random_stream: &'a dyn Fn(u64) -> ChaCha8Rng,
}

impl Fitting<'_> {
    /// Counts `n` pairs as done.
    ///
    /// # Errors
    /// Interruption.
    fn advance(&self, n: usize) -> Result<(), Error> {
        self.observer.advance(n as u64);
        Ok(self.observer.check()?)
    }
}

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
