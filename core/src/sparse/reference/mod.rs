//! Plain solvers, one signal at a time: oracles of the kernels, and what they cannot do (paths, many non-zeros).

pub(crate) mod descent;
pub(crate) mod homotopy;
pub(crate) mod omp;
pub(crate) mod proximal;
