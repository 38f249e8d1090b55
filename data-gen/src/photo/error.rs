//! Errors of finding and reading photos.

use std::path::PathBuf;

use lenslet_core::progress::Interrupted;

/// Errors of finding and reading photos. Reasons are part of the message; `source` gives none of them.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file or folder cannot be read.
    #[error("photo {}: {reason}", path.display())]
    Read {
        /// Which one.
        path: PathBuf,
        /// The system's reason.
        reason: std::io::Error,
    },
    /// A file is no picture, a damaged one, or one that needs too much memory.
    #[error("photo {}: {reason}", path.display())]
    Decode {
        /// Which file.
        path: PathBuf,
        /// The decoder's reason.
        reason: lenslet_core::picture_file::Error,
    },
    /// A file is longer than any photo.
    #[error("photo {}: {length} bytes are too many for a photo", path.display())]
    TooLong {
        /// Which file.
        path: PathBuf,
        /// Its length in bytes.
        length: u64,
    },
    /// A photo has more pixels than the caller takes.
    #[error("photo {}: {width}x{height} pixels are too many", path.display())]
    TooManyPixels {
        /// Which file.
        path: PathBuf,
        /// Pixels a row.
        width: usize,
        /// Pixels a column.
        height: usize,
    },
    /// A photo has too few pixels to a side.
    #[error("photo {}: {width}x{height} pixels are too few, {least} a side are needed", path.display())]
    TooFewPixels {
        /// Which file.
        path: PathBuf,
        /// Pixels a row.
        width: usize,
        /// Pixels a column.
        height: usize,
        /// Pixels that its shorter side must have.
        least: usize,
    },
    /// A photo shows nothing.
    #[error("photo {}: it is of one colour", path.display())]
    OneColour {
        /// Which file.
        path: PathBuf,
    },
    /// The folders hold no photo.
    #[error("{places}: no photo there (PNG, JPEG, TIFF, BMP or PNM)")]
    NoPhoto {
        /// Where photos were looked for.
        places: String,
    },
    /// None of the files can be used.
    #[error("none of {count} files is a usable photo: {skipped}")]
    NoUsablePhoto {
        /// How many files there are.
        count: usize,
        /// What is wrong with each of them.
        skipped: String,
    },
    /// A plane cannot be reduced to a size of zero, or to a larger one.
    #[error("a plane of {}x{} pixels cannot be shrunk to {}x{}", from.0, from.1, to.0, to.1)]
    Reduction {
        /// Its (width, height).
        from: (usize, usize),
        /// The (width, height) asked for.
        to: (usize, usize),
    },
    /// The observer cancelled.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}
