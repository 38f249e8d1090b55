//! Errors of rendering views from samples.

use lenslet_core::progress::Interrupted;
use lenslet_core::{decode, dictionary, lightfield, sampling};

/// Errors of interpolation, multi-view refinement and learned reconstruction.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An option out of range, or options that contradict each other: a mistake of the caller.
    #[error("{0}")]
    Parameter(String),
    /// Samples, views or images whose shapes do not belong together: a fault of the input.
    #[error("{0}")]
    Shape(String),
    /// Disparity cannot be estimated.
    #[error(transparent)]
    Disparity(#[from] crate::disparity::Error),
    /// Centres that cannot be triangulated, sizes out of range.
    #[error(transparent)]
    Sampling(#[from] sampling::Error),
    /// Samples of a capture that cannot be read or decoded.
    #[error(transparent)]
    Decode(#[from] decode::Error),
    /// A dictionary that cannot be used.
    #[error(transparent)]
    Dictionary(#[from] dictionary::Error),
    /// A light field that cannot be read or written.
    #[error(transparent)]
    LightField(#[from] lightfield::Error),
    /// Arrays of other sizes than they should have: a fault of the input.
    #[error("shapes do not belong together: {0}")]
    Array(#[from] ndarray::ShapeError),
    /// The observer cancelled.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}
