//! Errors of capture files, by cause.

use std::io;
use std::path::{Path, PathBuf};

use crate::progress::Interrupted;

/// Every message names the file, what is wrong, and where it helps what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Reading failed.
    #[error("cannot read {}: {source}", path.display())]
    Io {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file is none of the kinds that can be read.
    #[error("{}: {reason}", path.display())]
    NotRecognised {
        /// Which file.
        path: PathBuf,
        /// What was expected.
        reason: String,
    },
    /// The file begins as expected, but is damaged or violates its format.
    #[error("{}: {reason}", path.display())]
    Malformed {
        /// Which file.
        path: PathBuf,
        /// What is wrong, and where.
        reason: String,
    },
    /// A valid file whose contents are not supported.
    #[error("{}: {reason}", path.display())]
    Unsupported {
        /// Which file.
        path: PathBuf,
        /// What is not supported.
        reason: String,
    },
    /// Something the file names is not in it.
    #[error("{}: {what} ({sha1}) is named by the file but is not in it{advice}", path.display())]
    Missing {
        /// Which file.
        path: PathBuf,
        /// What is missing, e.g. `imageRef`.
        what: String,
        /// Its reference.
        sha1: String,
        /// What to do, or nothing.
        advice: String,
    },
    /// A size in the file is above the limit.
    #[error("{}: {what} is {value}, more than the {limit} allowed", path.display())]
    Limit {
        /// Which file.
        path: PathBuf,
        /// What is too large.
        what: String,
        /// Its size.
        value: u64,
        /// The limit.
        limit: u64,
    },
    /// A request that cannot be met, such as an unknown camera profile.
    #[error("{0}")]
    Parameter(String),
    /// The observer cancelled the work.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
    /// A result could not be put in place.
    #[error(transparent)]
    Output(#[from] crate::output::Error),
}

impl Error {
    /// The error with what was noticed before it: that is often its reason.
    #[must_use]
    pub(crate) fn after(mut self, warnings: &[String]) -> Error {
        if let Error::NotRecognised { reason, .. }
        | Error::Malformed { reason, .. }
        | Error::Unsupported { reason, .. } = &mut self
        {
            for warning in warnings {
                reason.push_str("; before that: ");
                reason.push_str(warning);
            }
        }
        self
    }

    pub(crate) fn io(path: &Path) -> impl FnOnce(io::Error) -> Error + '_ {
        move |source| Error::Io { path: path.to_path_buf(), source }
    }

    pub(crate) fn malformed(path: &Path, reason: impl Into<String>) -> Error {
        Error::Malformed { path: path.to_path_buf(), reason: reason.into() }
    }

    pub(crate) fn unsupported(path: &Path, reason: impl Into<String>) -> Error {
        Error::Unsupported { path: path.to_path_buf(), reason: reason.into() }
    }

    pub(crate) fn not_recognised(path: &Path, reason: impl Into<String>) -> Error {
        Error::NotRecognised { path: path.to_path_buf(), reason: reason.into() }
    }
}
