//! Calibration without white images: the lenslet pattern of several ordinary captures.

pub mod agreement;
pub mod flatten;
pub mod pattern;
