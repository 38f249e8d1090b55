//! Errors of the decompositions.

/// A matrix that does not have the requested decomposition.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A pivot is not positive, is below the rounding of its column, or is not finite.
    #[error("the matrix is not positive definite to working precision")]
    NotPositiveDefinite,
    /// The iteration for singular or eigenvalues did not end: an entry is not finite.
    #[error("no singular or eigenvalues were found: is every entry finite?")]
    NoConvergence,
}
