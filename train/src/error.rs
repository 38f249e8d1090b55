//! Errors of training.

use lenslet_core::progress::Interrupted;

/// Errors of training.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A parameter out of range.
    #[error("{0}")]
    Parameter(String),
    /// Too few textured pairs for the atoms or anchors wanted, or pairs that do not determine a regressor.
    #[error("{0}")]
    TooLittle(String),
    /// The crops of [`crate::train_on_crops`] could not be made.
    #[error("{0}")]
    Crops(String),
    /// Photos that cannot be found or read.
    #[error(transparent)]
    Photos(#[from] lenslet_data_gen::photo::Error),
    /// Crops or pairs that cannot be made.
    #[error(transparent)]
    Pairs(#[from] lenslet_data_gen::pairs::Error),
    /// A dictionary that is not valid.
    #[error(transparent)]
    Dictionary(#[from] lenslet_core::dictionary::Error),
    /// Sparse coding failed.
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
        /// The reason and a way out.
        reason: String,
    },
    /// Output failed.
    #[error(transparent)]
    Output(#[from] lenslet_core::output::Error),
    /// The observer cancelled; the checkpoint, if any, holds the last whole epoch.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}
