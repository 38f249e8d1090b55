//! Plain solvers, one signal at a time: oracles for testing the kernels, and the cases that the kernels do not cover
//! (paths, many non-zeros).

pub(crate) mod descent;
pub(crate) mod homotopy;
pub(crate) mod omp;
pub(crate) mod proximal;
