//! Errors of a simulation.

use std::path::PathBuf;

use lenslet_core::progress::Interrupted;

use crate::photo;

/// Errors of a simulation.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A value out of range.
    #[error("{0}")]
    Parameter(String),
    /// A photo cannot be used.
    #[error(transparent)]
    Photo(#[from] photo::Error),
    /// A file of the result cannot be written.
    #[error("cannot write {}: {reason}", path.display())]
    Write {
        /// Which file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The result cannot be put in place.
    #[error(transparent)]
    Output(#[from] lenslet_core::output::Error),
    /// A capture cannot be written.
    #[error(transparent)]
    Container(#[from] lenslet_core::container::Error),
    /// The truth views cannot be written.
    #[error(transparent)]
    LightField(#[from] lenslet_core::lightfield::Error),
    /// The observer cancelled.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}
