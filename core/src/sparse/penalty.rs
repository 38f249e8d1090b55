//! The penalty, and the one range check of λ.

use super::error::Error;

/// How strongly codes are penalised.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Penalty {
    /// λ of the objective; at least 0.
    Lambda(f32),
    /// λ as a fraction of each signal's λ_max = max |D y|, above which its code is zero; at least 0.
    FractionOfMax(f32),
    /// At most this many non-zeros per signal (OMP, or the homotopy path stopped there).
    NonZeros(usize),
}

impl Penalty {
    /// λ of a signal whose λ_max is `lambda_max` (needed by [`Penalty::FractionOfMax`] only); 0 for a number of
    /// non-zeros.
    pub(crate) fn lambda(self, lambda_max: f64) -> f32 {
        match self {
            Penalty::Lambda(lambda) => lambda,
            Penalty::FractionOfMax(fraction) => (f64::from(fraction) * lambda_max) as f32,
            Penalty::NonZeros(_) => 0.0,
        }
    }

    /// The largest number of non-zeros, where the penalty is one.
    pub(crate) fn nonzeros(self) -> Option<usize> {
        if let Penalty::NonZeros(most) = self { Some(most) } else { None }
    }
}

/// The one range check of λ (or of its share of λ_max).
pub(crate) fn check_lambda(lambda: f64) -> Result<(), Error> {
    if lambda.is_finite() && lambda >= 0.0 {
        return Ok(());
    }
    Err(Error::Parameter(format!("λ must be a number of at least 0, not {}", lambda as f32)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_penalty_gives_its_lambda_or_its_number() {
        assert_eq!(Penalty::Lambda(0.3).lambda(7.0), 0.3);
        assert_eq!(Penalty::FractionOfMax(0.25).lambda(8.0), 2.0);
        assert_eq!((Penalty::NonZeros(4).lambda(8.0), Penalty::NonZeros(4).nonzeros()), (0.0, Some(4)));
        assert_eq!(Penalty::Lambda(0.3).nonzeros(), None);
        assert!(check_lambda(0.0).is_ok() && check_lambda(1e30).is_ok());
        assert!(
            check_lambda(-1e-9).is_err() && check_lambda(f64::NAN).is_err() && check_lambda(f64::INFINITY).is_err()
        );
    }
}
