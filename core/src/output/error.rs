//! Why an output cannot be put in place.

use std::io;
use std::path::{Path, PathBuf};

/// Why an output cannot be put in place.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The target exists already, and `force` would replace it.
    #[error("{} exists already; choose another name or add --force to replace it", .0.display())]
    Exists(PathBuf),
    /// What stands at the target is never replaced, whether or not `force` is given.
    #[error("{} is kept: {why}; choose another name, or remove it yourself", path.display())]
    Kept {
        /// Which path.
        path: PathBuf,
        /// Why it is not replaced, as the end of a sentence that begins with its name.
        why: String,
    },
    /// The target has no file name.
    #[error("{} cannot be written: it has no file name", .0.display())]
    NoName(PathBuf),
    /// Another run is writing there.
    #[error("another run is writing to {}; wait for its end, or choose another name", .0.display())]
    Busy(PathBuf),
    /// The system reported an error.
    #[error("cannot write {}: {source}", path.display())]
    Io {
        /// Which path.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

pub(super) fn io_at(path: &Path) -> impl FnOnce(io::Error) -> Error + '_ {
    move |source| Error::Io { path: path.to_path_buf(), source }
}
