//! Which predictor reconstructs a view, and how densely: a pure function of the mode, of what the dictionary holds and of
//! what is known of the view.

use std::fmt;

use lenslet_core::dictionary::{self, Model, PatchPredictor};
use lenslet_core::interpolation::Interpolation;

use super::options::{Mode, Options};

/// What is available of a view besides its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Available {
    /// Nothing.
    ViewAlone,
    /// The samples that it was made of, so that a network can have interpolations of them as side inputs.
    Samples,
}

/// What is done to every view. `{}` formats it as the names of its predictors.
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

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.averaged_with {
            Some(second) => write!(f, "{} and {second}", self.predictor),
            None => write!(f, "{}", self.predictor),
        }
    }
}

impl Plan {
    /// The plan of `options` with this model. A mode that names a predictor gets it or fails; [`Mode::Learned`],
    /// [`Mode::Fast`] and [`Mode::Best`] choose among what the model holds.
    ///
    /// # Errors
    /// [`dictionary::Error::NoPredictor`] for a predictor that the model does not hold,
    /// [`dictionary::Error::NoSideInputs`] for a network whose side inputs are not available.
    pub fn new(model: &Model, options: &Options, available: Available) -> Result<Plan, dictionary::Error> {
        let parts = &model.patch_model;
        let network = parts.network.as_ref();
        let lacking =
            network.map(|n| n.side_inputs.as_slice()).filter(|i| !i.is_empty() && available == Available::ViewAlone);
        let usable = network.is_some() && lacking.is_none();
        let refined = model.base == Interpolation::Multiview && usable;
        let (predictor, step, ensemble) = match options.mode {
            Mode::Learned if refined => (PatchPredictor::Network, 2, 1),
            Mode::Learned => (PatchPredictor::Lasso, 2, 1),
            Mode::Fast if refined => (PatchPredictor::Network, 4, 1),
            Mode::Fast if parts.anchored.is_some() => (PatchPredictor::Anchored, 4, 1),
            Mode::Fast => (PatchPredictor::Lasso, 4, 1),
            Mode::Best if refined => (PatchPredictor::Network, 2, 4),
            Mode::Best => (PatchPredictor::Lasso, 2, 4),
            Mode::Only(predictor) => (predictor, predictor.spacing(), 1),
        };
        parts.require(predictor)?;
        if let (PatchPredictor::Network, Some(inputs)) = (predictor, lacking) {
            return Err(dictionary::Error::no_side_inputs(inputs));
        }
        let both = options.mode == Mode::Best && usable && !refined;
        // Patches must not leave gaps.
        let smallest = network.map_or(parts.patch, |n| n.patch().min(parts.patch));
        Ok(Plan {
            predictor,
            averaged_with: both.then_some(PatchPredictor::Network),
            step: options.step.unwrap_or(step.min(smallest)),
            ensemble: options.ensemble.unwrap_or(ensemble),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruct::{embedded_by_name, embedded_dictionary, embedded_dictionary_for};

    #[test]
    fn learned_is_the_network_on_refined_views_and_lasso_elsewhere() {
        let (interpolated, refined) =
            (embedded_dictionary().unwrap(), embedded_dictionary_for(Interpolation::Multiview).unwrap());
        let with = |mode, model, available| Plan::new(model, &Options { mode, ..Options::default() }, available);
        let plan = |mode, model| with(mode, model, Available::Samples).unwrap();
        assert_eq!(plan(Mode::Learned, &interpolated.models[0]).predictor, PatchPredictor::Lasso);
        assert_eq!(plan(Mode::Learned, &refined.models[0]).predictor, PatchPredictor::Network);
        assert_eq!(plan(Mode::Only(PatchPredictor::Lasso), &refined.models[0]).predictor, PatchPredictor::Lasso);
        assert_eq!(plan(Mode::Best, &interpolated.models[0]).to_string(), "LASSO and network");
        assert_eq!(plan(Mode::Best, &refined.models[0]).averaged_with, None);
        assert_eq!(plan(Mode::Fast, &interpolated.models[0]).predictor, PatchPredictor::Anchored);
        // Every predictor by its own name.
        for predictor in PatchPredictor::ALL {
            assert_eq!(plan(Mode::Only(predictor), &refined.models[0]).predictor, predictor);
        }
        // Without the view's samples the network has not got its inputs.
        let alone = |mode| with(mode, &refined.models[0], Available::ViewAlone);
        assert_eq!(alone(Mode::Learned).unwrap().predictor, PatchPredictor::Lasso);
        assert_eq!(alone(Mode::Fast).unwrap().predictor, PatchPredictor::Anchored);
        assert!(
            alone(Mode::Only(PatchPredictor::Network))
                .unwrap_err()
                .to_string()
                .contains("barycentric, cubic and noise")
        );
        // A dictionary without a network is told from one with.
        let small = embedded_by_name("small").unwrap().unwrap();
        let refused =
            with(Mode::Only(PatchPredictor::Network), &small.models[0], Available::Samples).unwrap_err().to_string();
        assert_eq!(refused, "the dictionary has no network; it has no codes, ridge, anchored, LASSO");
        assert_eq!(plan(Mode::Best, &small.models[0]).averaged_with, None);
        let mut bare = small.models[0].clone();
        bare.patch_model.anchored = None;
        assert_eq!(plan(Mode::Fast, &bare).predictor, PatchPredictor::Lasso);
        assert!(with(Mode::Only(PatchPredictor::Anchored), &bare, Available::Samples).is_err());
        let dense = Options { step: Some(1), ensemble: Some(2), ..Options::default() };
        let dense = Plan::new(&refined.models[0], &dense, Available::Samples).unwrap();
        assert_eq!((dense.step, dense.ensemble), (1, 2));
    }
}
