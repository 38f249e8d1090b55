//! Sparse coding: min over φ of ½‖y − Dᵀφ‖² + λ‖φ‖₁ for millions of small problems, every code with its duality gap.
//!
//! Scaling: ½ on the data term, no 1/n, atoms of unit norm. `D` is K×m (one atom per row, as in scikit-learn), signals
//! are N×m (one per row). [`prepare`] a dictionary once, then [`solve`] any number of signals; every solver has the
//! same signature and result type, [`Codes`]. Results do not depend on the number of threads, the order of the signals,
//! or the processor.
//!
//! | function | objective |
//! |---|---|
//! | [`solve`] | ½‖y − Dᵀφ‖² + λ‖φ‖₁, or at most T non-zeros |
//! | [`solve_weighted`] | ½ Σ w_i (y − Dᵀφ)_i² + λ‖φ‖₁, weights for each signal |
//! | [`solve_sampled`] | ½‖y − S Dᵀφ‖² + λ‖φ‖₁, a sampling matrix for each signal |
//! | [`homotopy_path`] | the minimisers for all λ |
//!
//! The layers, each above the next: `solve` and `masked` (checks, blocks of signals) → `options`, `solver` →
//! `reference` (plain solvers, the oracles) → `kernel` (the f32 active set on SIMD lanes, that in f64) → `codes`,
//! `problem`, `prepared`.

mod codes;
mod error;
mod kernel;
mod masked;
mod options;
mod penalty;
mod prepared;
mod problem;
mod reference;
mod solve;
mod solver;

pub use codes::Codes;
pub use error::Error;
pub use kernel::simd::Simd;
pub use masked::{solve_sampled, solve_weighted};
pub use options::Options;
pub use penalty::Penalty;
pub use prepared::{Prepared, prepare};
pub use problem::Ended;
pub use reference::homotopy::{Knot, homotopy_path};
pub use solve::solve;
pub use solver::Solver;
