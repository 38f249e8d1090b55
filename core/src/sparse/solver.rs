//! The solvers by name, and the function of each: a new one is a file in `reference` and a row in each match here.

use super::problem::{Finished, Problem, Work};
use super::reference::{descent, homotopy, omp, proximal};

/// The algorithm of a solve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Solver {
    /// [`Solver::ActiveSet`] for a λ, [`Solver::Omp`] for a number of non-zeros: the fastest exact ones at every shape
    /// measured.
    Auto,
    /// Exact active set on the Gram matrix.
    ActiveSet,
    /// Coordinate descent on the Gram matrix.
    CoordinateDescent,
    /// Proximal gradient, the textbook's.
    Ista,
    /// Accelerated proximal gradient.
    Fista,
    /// Homotopy (LARS-lasso).
    Homotopy,
    /// Orthogonal matching pursuit (Batch-OMP); needs [`Penalty::NonZeros`](super::Penalty::NonZeros).
    Omp,
}

/// Solves one signal: the code goes into `work.code`, its support into `work.support`.
pub(crate) type Reference = fn(&Problem<'_>, &mut Work) -> Finished;

impl Solver {
    /// All of them.
    pub const ALL: [Solver; 7] = [
        Solver::Auto,
        Solver::ActiveSet,
        Solver::CoordinateDescent,
        Solver::Ista,
        Solver::Fista,
        Solver::Homotopy,
        Solver::Omp,
    ];

    /// Short name, as on a command line.
    ///
    /// ```
    /// use lenslet_core::sparse::Solver;
    /// assert_eq!(Solver::ALL.iter().find(|solver| solver.name() == "omp"), Some(&Solver::Omp));
    /// ```
    pub fn name(self) -> &'static str {
        match self {
            Solver::Auto => "auto",
            Solver::ActiveSet => "active-set",
            Solver::CoordinateDescent => "cd",
            Solver::Ista => "ista",
            Solver::Fista => "fista",
            Solver::Homotopy => "homotopy",
            Solver::Omp => "omp",
        }
    }

    /// The plain function that solves one signal; none for the active set, which solves blocks of signals.
    pub(crate) fn reference(self) -> Option<Reference> {
        match self {
            Solver::Auto | Solver::ActiveSet => None,
            Solver::CoordinateDescent => Some(descent::solve),
            Solver::Ista => Some(proximal::ista),
            Solver::Fista => Some(proximal::fista),
            Solver::Homotopy => Some(homotopy::solve),
            Solver::Omp => Some(omp::solve),
        }
    }

    /// Whether it can solve for a given λ.
    pub(crate) fn takes_lambda(self) -> bool {
        self != Solver::Omp
    }

    /// Whether it can stop at a number of non-zeros.
    pub(crate) fn takes_nonzeros(self) -> bool {
        matches!(self, Solver::Auto | Solver::Omp | Solver::Homotopy)
    }

    /// The solver in use: of [`Solver::Auto`] the one it selects.
    pub(crate) fn resolved(self, nonzeros: bool) -> Solver {
        match self {
            Solver::Auto if nonzeros => Solver::Omp,
            Solver::Auto => Solver::ActiveSet,
            other => other,
        }
    }
}
