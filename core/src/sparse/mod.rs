//! Sparse coding: min over φ of ½‖y − Dᵀφ‖² + λ‖φ‖₁ for millions of small problems, every answer with its duality gap.
//!
//! Scaling: ½ on the data term, no 1/n, atoms of unit norm. `D` is K×m (one atom a row, as in scikit-learn), `Y` is N×m.

use ndarray::ArrayView2;

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

/// Sparse codes of N signals in compressed rows: signal n has entries `indptr[n]..indptr[n+1]`.
#[derive(Debug, Clone, Default)]
pub struct Codes {
    /// N+1 offsets.
    pub indptr: Vec<usize>,
    /// Atom of each entry.
    pub atoms: Vec<u32>,
    /// Value of each entry.
    pub values: Vec<f32>,
    /// Duality gap of each signal (absolute, in f64); NaN for OMP.
    pub gaps: Vec<f64>,
    /// Iterations of each signal.
    pub iterations: Vec<u32>,
    /// How each ended.
    pub ended: Vec<Ended>,
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

/// A dictionary made ready for solving: atoms, Gram matrix, bounds.
#[derive(Debug, Clone)]
pub struct Prepared {
    // the solver's own
}

/// Prepares atoms (K×m, one unit-norm atom a row; norms within 1e-3 of 1) for solving.
///
/// # Errors
/// Non-finite atoms, empty shapes, norms far from one.
pub fn prepare(_atoms: ArrayView2<'_, f32>) -> Result<Prepared, Error> {
    Err(Error::Shape("not built yet".into()))
}

/// Solves min ½‖y − Dᵀφ‖² + λ‖φ‖₁ for every row of `signals` (N×m) on the current rayon pool.
///
/// # Errors
/// Non-finite signals, shapes that do not fit, parameters out of range.
pub fn solve(_dictionary: &Prepared, _signals: ArrayView2<'_, f32>, _options: &Options) -> Result<Codes, Error> {
    Err(Error::Shape("not built yet".into()))
}
