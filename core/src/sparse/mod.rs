//! Sparse coding: min over φ of ½‖y − Dᵀφ‖² + λ‖φ‖₁ for millions of small problems, every answer with its duality gap.
//!
//! Scaling: ½ on the data term, no 1/n, atoms of unit norm. `D` is K×m (one atom a row, as in scikit-learn), `Y` is N×m.
//! [`prepare`] a dictionary once, then [`solve`] any number of signals; every solver has the same signature and gives
//! the same [`Codes`]. Answers do not depend on the number of threads nor on the order of the signals.

mod active;
mod codes;
mod descent;
mod exact;
mod fast;
mod gap;
mod homotopy;
mod near;
mod omp;
mod prepared;
mod product;
mod proximal;
mod sampled;
mod simd;
mod solve;

pub use codes::Codes;
pub use homotopy::{Knot, path};
pub use prepared::{Prepared, prepare};
pub use sampled::{solve_sampled, solve_weighted};
pub use simd::Simd;
pub use solve::solve;

/// How strongly codes are penalised.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Penalty {
    /// λ as it stands in the objective.
    Lambda(f32),
    /// λ as a fraction of each signal's λ_max = max |D y|.
    FractionOfMax(f32),
    /// At most this many non-zeros a signal (OMP, or the homotopy path stopped there).
    NonZeros(usize),
}

/// Which algorithm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Solver {
    /// The fastest exact one for the shape at hand.
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
    /// Orthogonal matching pursuit (Batch-OMP); needs `Penalty::NonZeros`.
    Omp,
}

/// Options common to all solvers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Algorithm.
    pub solver: Solver,
    /// Penalty.
    pub penalty: Penalty,
    /// Stop when the duality gap is at most `tolerance`·½‖y‖².
    pub tolerance: f64,
    /// Iteration cap a signal.
    pub max_iterations: usize,
    /// Codes must be ≥ 0.
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

/// How a signal's solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Ended {
    /// The gap reached the tolerance.
    Converged,
    /// The iteration cap came first.
    IterationCap,
    /// Rounding stopped progress first.
    Stalled,
}

/// What goes wrong in sparse coding.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An input has a NaN or an infinity.
    #[error("{what} holds a value that is not finite (row {row})")]
    NotFinite {
        /// Which input.
        what: &'static str,
        /// Which row.
        row: usize,
    },
    /// Shapes do not fit.
    #[error("{0}")]
    Shape(String),
    /// A parameter out of range.
    #[error("{0}")]
    Parameter(String),
}
