//! Which predictor reconstructs a view, and how densely: a pure function of the mode and of what the dictionary holds.

use lenslet_core::dictionary::{Model, PatchPredictor};
use lenslet_core::interpolation::Interpolation;

use super::options::{Mode, Options};

/// What is done to every view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Plan {
    /// How residual patches are predicted.
    pub predictor: PatchPredictor,
    /// A second predictor whose result is averaged with it.
    pub averaged_with: Option<PatchPredictor>,
    /// Pixels between patches.
    pub step: usize,
    /// Mirrored copies of the view whose results are averaged: 1, 2 or 4.
    pub ensemble: usize,
}

impl Plan {
    /// The plan of `options` with this model: [`Mode::Learned`] is the network on refined views of a dictionary that
    /// has one, the LASSO codes otherwise; [`Mode::Fast`] the network or the anchored regressors.
    #[must_use]
    pub fn new(model: &Model, options: &Options) -> Plan {
        let network = model.patch_model.network.is_some();
        let refined = model.base == Interpolation::Multiview && network;
        let (predictor, step, ensemble) = match options.mode {
            Mode::Learned if refined => (PatchPredictor::Network, 2, 1),
            Mode::Network => (PatchPredictor::Network, 2, 1),
            Mode::Learned | Mode::Lasso => (PatchPredictor::Lasso, 2, 1),
            Mode::Fast if refined => (PatchPredictor::Network, 4, 1),
            Mode::Fast => (PatchPredictor::Anchored, 4, 1),
            Mode::Anchored => (PatchPredictor::Anchored, 3, 1),
            Mode::Best if refined => (PatchPredictor::Network, 2, 4),
            Mode::Best => (PatchPredictor::Lasso, 2, 4),
            Mode::Ridge => (PatchPredictor::Ridge, 3, 1),
        };
        let both = options.mode == Mode::Best && network && !refined;
        // Patches must not leave gaps.
        let patch = model.patch_model.patch;
        let smallest = model.patch_model.network.as_ref().map_or(patch, |n| n.patch().min(patch));
        Plan {
            predictor,
            averaged_with: both.then_some(PatchPredictor::Network),
            step: options.step.unwrap_or(step.min(smallest)),
            ensemble: options.ensemble.unwrap_or(ensemble),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruct::{embedded_dictionary, embedded_dictionary_for};

    #[test]
    fn learned_is_the_network_on_refined_views_and_lasso_elsewhere() {
        let (interpolated, refined) =
            (embedded_dictionary().unwrap(), embedded_dictionary_for(Interpolation::Multiview).unwrap());
        let plan = |mode, model| Plan::new(model, &Options { mode, ..Options::default() });
        assert_eq!(plan(Mode::Learned, &interpolated.models[0]).predictor, PatchPredictor::Lasso);
        assert_eq!(plan(Mode::Learned, &refined.models[0]).predictor, PatchPredictor::Network);
        assert_eq!(plan(Mode::Lasso, &refined.models[0]).predictor, PatchPredictor::Lasso);
        assert_eq!(plan(Mode::Best, &interpolated.models[0]).averaged_with, Some(PatchPredictor::Network));
        assert_eq!(plan(Mode::Best, &refined.models[0]).averaged_with, None);
        assert_eq!(plan(Mode::Fast, &interpolated.models[0]).predictor, PatchPredictor::Anchored);
        let dense = Options { step: Some(1), ensemble: Some(2), ..Options::default() };
        assert_eq!(
            (Plan::new(&refined.models[0], &dense).step, Plan::new(&refined.models[0], &dense).ensemble),
            (1, 2)
        );
    }
}
