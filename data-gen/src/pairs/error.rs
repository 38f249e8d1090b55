//! Errors of making training pairs.

use lenslet_core::progress::Interrupted;

use crate::photo;

/// Errors of making training pairs.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A photo cannot be used.
    #[error(transparent)]
    Photo(#[from] photo::Error),
    /// A parameter out of range.
    #[error("{0}")]
    Parameter(String),
    /// Sampling refused.
    #[error(transparent)]
    Sampling(#[from] lenslet_core::sampling::Error),
    /// Features or filters refused.
    #[error(transparent)]
    Dictionary(#[from] lenslet_core::dictionary::Error),
    /// Output failed.
    #[error(transparent)]
    Output(#[from] lenslet_core::output::Error),
    /// The observer cancelled.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}
