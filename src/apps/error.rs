//! Errors of the applications.

use lenslet_core::progress::Interrupted;

use crate::image_io;

/// Errors of the applications.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A setting out of range, or an aperture without weight: a mistake of the caller.
    #[error("{0}")]
    Parameter(String),
    /// Light fields, maps and pictures whose sizes do not belong together: a fault of the input.
    #[error("{0}")]
    Shape(String),
    /// A page that would be larger than allowed.
    #[error(
        "the page needs {needed} bytes even at JPEG quality {quality}, more than the {allowed} allowed; make the views smaller"
    )]
    PageTooLarge {
        /// Bytes of the page at that quality.
        needed: usize,
        /// The lowest JPEG quality that was tried.
        quality: u8,
        /// Bytes it may have.
        allowed: usize,
    },
    /// The disparity could not be estimated.
    #[error(transparent)]
    Disparity(#[from] crate::disparity::Error),
    /// A picture could not be encoded.
    #[error(transparent)]
    Image(#[from] image_io::Error),
    /// The observer cancelled.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}
