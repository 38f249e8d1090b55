//! Why training fails.

use lenslet_core::progress::Interrupted;

/// What goes wrong in training.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A parameter out of range.
    #[error("{0}")]
    Parameter(String),
    /// The photos do not give enough to learn from.
    #[error("{0}")]
    TooLittle(String),
    /// The caller's own crops could not be made.
    #[error("{0}")]
    Crops(String),
    /// Photos.
    #[error(transparent)]
    Photos(#[from] lenslet_data_gen::photo::Error),
    /// Crops and pairs.
    #[error(transparent)]
    Pairs(#[from] lenslet_data_gen::pairs::Error),
    /// The dictionary itself.
    #[error(transparent)]
    Dictionary(#[from] lenslet_core::dictionary::Error),
    /// The solver of sparse codes.
    #[error(transparent)]
    Sparse(#[from] lenslet_core::sparse::Error),
    /// Linear algebra: a matrix that is not finite.
    #[error(transparent)]
    LinearAlgebra(#[from] lenslet_core::linalg::Error),
    /// A checkpoint that cannot be used.
    #[error("checkpoint {path}: {reason}")]
    Checkpoint {
        /// Which file.
        path: String,
        /// Why, and what to do.
        reason: String,
    },
    /// Output failed.
    #[error(transparent)]
    Output(#[from] lenslet_core::output::Error),
    /// The observer asked to stop; the checkpoint, if any, holds the last whole epoch.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}
