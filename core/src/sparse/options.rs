//! Options of a solve: solver, penalty, tolerance; and the check of their ranges.

use super::error::Error;
use super::penalty::{Penalty, check_lambda};
use super::solver::Solver;

/// Options common to all solvers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Algorithm. Default: [`Solver::Auto`].
    pub solver: Solver,
    /// Penalty. Default: λ = 0.1.
    pub penalty: Penalty,
    /// Stop when the duality gap is at most `tolerance`·½‖y‖²; at least 0. Default 1e-6, about the accuracy of f32
    /// codes.
    pub tolerance: f64,
    /// Most iterations (rounds, sweeps, knots) a signal; at least 1. Default 10,000.
    pub max_iterations: usize,
    /// Codes must be ≥ 0. Default: no.
    pub nonnegative: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            solver: Solver::Auto,
            penalty: Penalty::Lambda(0.1),
            tolerance: 1e-6,
            max_iterations: 10_000,
            nonnegative: false,
        }
    }
}

impl Options {
    /// Refuses values out of range, and a penalty that the solver does not support. Every solve begins with this check.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    ///
    /// ```
    /// use lenslet_core::sparse::{Options, Penalty};
    /// assert!(Options::default().check().is_ok());
    /// let error = Options { penalty: Penalty::Lambda(-0.1), ..Options::default() }.check().unwrap_err();
    /// assert_eq!(error.to_string(), "λ must be a number of at least 0, not -0.1");
    /// ```
    pub fn check(&self) -> Result<(), Error> {
        match self.penalty {
            Penalty::Lambda(v) | Penalty::FractionOfMax(v) => check_lambda(f64::from(v))?,
            Penalty::NonZeros(_) => {}
        }
        if !(self.tolerance.is_finite() && self.tolerance >= 0.0) {
            return Err(Error::Parameter(format!("the tolerance must be at least 0, not {}", self.tolerance)));
        }
        if self.max_iterations == 0 {
            return Err(Error::Parameter("at least one iteration is needed".into()));
        }
        let counted = self.penalty.nonzeros().is_some();
        if if counted { !self.solver.takes_nonzeros() } else { !self.solver.takes_lambda() } {
            return Err(Error::Parameter(
                "only OMP and homotopy accept a number of non-zeros, and OMP accepts no λ".into(),
            ));
        }
        Ok(())
    }

    /// The iteration cap as a u32.
    pub(crate) fn max_rounds(&self) -> u32 {
        u32::try_from(self.max_iterations).unwrap_or(u32::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_range_is_checked_by_itself() {
        let with = |change: fn(&mut Options)| {
            let mut options = Options::default();
            change(&mut options);
            options.check().is_ok()
        };
        assert!(with(|o| o.tolerance = 0.0) && with(|o| o.max_iterations = 1));
        assert!(!with(|o| o.tolerance = -1e-9) && !with(|o| o.tolerance = f64::NAN) && !with(|o| o.max_iterations = 0));
        assert!(!with(|o| o.penalty = Penalty::FractionOfMax(-0.1)));
        for solver in Solver::ALL {
            let takes = |penalty| Options { solver, penalty, ..Options::default() }.check().is_ok();
            assert_eq!(takes(Penalty::Lambda(0.1)), solver != Solver::Omp, "{solver:?}");
            let counts = [Solver::Auto, Solver::Omp, Solver::Homotopy].contains(&solver);
            assert_eq!(takes(Penalty::NonZeros(3)), counts, "{solver:?}");
        }
    }
}
