//! Errors of decoding, by cause.

use crate::calibration;
use crate::progress::Interrupted;

/// Errors of decoding and of files of samples.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The calibration belongs to another camera.
    #[error(transparent)]
    WrongCamera(#[from] calibration::Error),
    /// The capture's own numbers contradict each other.
    #[error("the capture is inconsistent: {0}")]
    Capture(String),
    /// The calibration's own numbers contradict each other.
    #[error("the calibration is inconsistent: {0}")]
    Calibration(String),
    /// An option out of range.
    #[error("{0}")]
    Parameter(String),
    /// A file of samples that cannot be read or written.
    #[error("{path}: {reason}")]
    File {
        /// Which file.
        path: String,
        /// Why.
        reason: String,
    },
    /// The output could not be put in place.
    #[error(transparent)]
    Output(#[from] crate::output::Error),
    /// The observer cancelled the work.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}
