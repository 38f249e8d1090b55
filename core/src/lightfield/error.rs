//! Errors of light fields on disk, by cause.

use std::path::Path;

/// Errors of reading and writing light fields.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Reading or writing failed.
    #[error("{path}: {source}")]
    Io {
        /// Which file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// The file is not a light field, or is damaged.
    #[error("{path}: {reason}")]
    Malformed {
        /// Which file.
        path: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A valid file of a kind that is not supported.
    #[error("{path}: {reason}")]
    Unsupported {
        /// Which file.
        path: String,
        /// What is not supported.
        reason: String,
    },
    /// The view asked for is absent: only views that are there can be read.
    #[error("{path}: its view in row {row}, column {column} is absent")]
    Absent {
        /// Which light field.
        path: String,
        /// Row of the view, from 0.
        row: usize,
        /// Column of the view, from 0.
        column: usize,
    },
    /// A parameter out of range, or a request that cannot be met.
    #[error("{0}")]
    Parameter(String),
    /// The output exists already or cannot be put in place.
    #[error(transparent)]
    Output(#[from] crate::output::Error),
}

pub(super) fn io_at(path: &Path) -> impl FnOnce(std::io::Error) -> Error + '_ {
    move |source| Error::Io { path: path.display().to_string(), source }
}

pub(super) fn absent(path: &Path, row: usize, column: usize) -> Error {
    Error::Absent { path: path.display().to_string(), row, column }
}

pub(super) fn malformed(path: &Path, reason: impl Into<String>) -> Error {
    Error::Malformed { path: path.display().to_string(), reason: reason.into() }
}

pub(super) fn unsupported(path: &Path, reason: impl Into<String>) -> Error {
    Error::Unsupported { path: path.display().to_string(), reason: reason.into() }
}
