//! Errors of disparity estimation.

use lenslet_core::progress::Interrupted;

/// Errors of disparity estimation.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The light field cannot be used.
    #[error("disparity needs at least 2 views of one or three channels: {0}")]
    Shape(String),
    /// An option is out of range.
    #[error("{0}")]
    Parameter(String),
    /// The observer cancelled.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}
