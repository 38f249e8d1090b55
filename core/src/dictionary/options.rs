//! Options of the reconstruction of a plane.

use super::error::Error;
use super::patch_model::PatchPredictor;

/// Options of a [`super::PlaneReconstructor`].
#[derive(Debug, Clone, PartialEq)]
pub struct ReconstructionOptions {
    /// How residuals are predicted; [`PatchPredictor::Lasso`] by default.
    pub predictor: PatchPredictor,
    /// Pixels between patches, 1 to the patch's side (that of the network's patches where it is used); 2 by default.
    pub step: usize,
    /// Standard deviation of the Gaussian that weights a patch's pixels, as a fraction of its side, above 0.01;
    /// infinite (the default) gives all pixels the same weight.
    pub spread: f32,
    /// Patches whose features have a smaller norm stay as they are in the low image (LASSO and anchored); 0 by default.
    pub flat: f32,
    /// λ of eq. (4), 0 to 1, instead of the trained one.
    pub lambda: Option<f32>,
    /// Averages the results of this many mirrored copies of the plane: 1 (the default), 2 (turned by half) or 4 (also
    /// mirrored).
    pub ensemble: usize,
}

impl Default for ReconstructionOptions {
    fn default() -> Self {
        ReconstructionOptions {
            predictor: PatchPredictor::Lasso,
            step: 2,
            spread: f32::INFINITY,
            flat: 0.0,
            lambda: None,
            ensemble: 1,
        }
    }
}

impl ReconstructionOptions {
    /// Checks the ranges that do not depend on a model.
    pub(super) fn check(&self) -> Result<(), Error> {
        let wrong = |what: String| Err(Error::Parameter(what));
        if !matches!(self.ensemble, 1 | 2 | 4) {
            return wrong(format!("an ensemble of {} copies: 1, 2 or 4", self.ensemble));
        }
        if !(self.spread > 0.01 && self.flat >= 0.0) || self.lambda.is_some_and(|l| !(0.0..=1.0).contains(&l)) {
            return wrong("spread, flatness or λ is out of range".into());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_and_ranges_are_those_that_the_fields_say() {
        let default = ReconstructionOptions::default();
        assert_eq!((default.step, default.spread, default.flat, default.ensemble), (2, f32::INFINITY, 0.0, 1));
        assert_eq!((default.predictor, default.lambda), (PatchPredictor::Lasso, None));
        let with = |change: fn(&mut ReconstructionOptions)| {
            let mut options = ReconstructionOptions::default();
            change(&mut options);
            options.check().is_ok()
        };
        assert!(with(|o| o.spread = 0.011) && with(|o| o.flat = 3.0));
        assert!(with(|o| o.lambda = Some(0.0)) && with(|o| o.lambda = Some(1.0)));
        assert!(with(|o| o.ensemble = 2) && with(|o| o.ensemble = 4));
        assert!(!with(|o| o.spread = 0.01) && !with(|o| o.spread = f32::NAN));
        assert!(!with(|o| o.flat = -0.1) && !with(|o| o.flat = f32::NAN));
        assert!(!with(|o| o.lambda = Some(1.1)) && !with(|o| o.lambda = Some(-0.1)));
        assert!(!with(|o| o.ensemble = 0) && !with(|o| o.ensemble = 3));
    }
}
