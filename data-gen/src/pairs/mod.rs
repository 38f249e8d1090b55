//! Training pairs out of photos (paper section 4.4): photo → luminance crop → hexagonal drop → re-interpolation → pairs of
//! low features and residual patches.
//!
//! Everything random comes from ChaCha8 streams named by (seed, photo, crop), so that a crop is the same whatever else
//! is made, in whatever order, on however many threads.

mod crop;
mod extract;
mod photo;
mod twins;
mod write;

pub use crop::{Crop, Degradation, crops, degrade};
pub use extract::{Pairs, PatchOptions, learn_beside, learn_filters, pairs, pairs_beside};
pub use photo::{Kernel, Loaded, find_photos, load_photo, load_photo_in, reduce};
pub use write::{Manifest, write};

/// What goes wrong in making pairs.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A photo cannot be read or decoded.
    #[error("photo {path}: {reason}")]
    Photo {
        /// Which file.
        path: String,
        /// Why.
        reason: String,
    },
    /// No photo is left to learn from.
    #[error("no usable photo: {0}")]
    NoPhotos(String),
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
    /// The caller asked to stop.
    #[error("interrupted")]
    Interrupted,
}
