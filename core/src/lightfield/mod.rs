//! The light field on disk and in memory: our directory, .npy, and the formats of other tools.

use ndarray::Array3;
use serde::{Deserialize, Serialize};

/// How values relate to light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ColourSpace {
    /// sRGB primaries, sRGB transfer curve.
    Srgb,
    /// sRGB primaries, linear light.
    Linear,
}

/// What is known of a light field besides its pixels (`lightfield.json`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// Format version, 1.
    pub version: u32,
    /// Views (rows v, columns u).
    pub views: [usize; 2],
    /// View size (height t, width s).
    pub size: [usize; 2],
    /// Channels, 1 or 3.
    pub channels: usize,
    /// Colour space.
    pub colour: ColourSpace,
    /// Output pixels between neighbouring lenslets of a row, if the views were resampled from a lattice.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch: Option<f64>,
    /// Rotation of that lattice, radians.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<f64>,
    /// Resampling method that made the views.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method: Option<String>,
    /// What was done, oldest first: free JSON objects (tool, version, parameters, source hashes).
    #[serde(default)]
    pub provenance: Vec<serde_json::Value>,
}

/// Somewhere views can be written, one at a time, in any order; complete only after `finish`.
pub trait ViewSink: Send {
    /// Writes view (row `v`, column `u`, counted from 0), shape (t, s, c), values nominally 0..1.
    ///
    /// # Errors
    /// When the view cannot be encoded or written.
    fn write(&mut self, v: usize, u: usize, view: &Array3<f32>) -> Result<(), Error>;
    /// Completes the light field under its final name.
    ///
    /// # Errors
    /// When views are missing or the result cannot be put in place.
    fn finish(self: Box<Self>) -> Result<(), Error>;
}

/// Somewhere views can be read from, one at a time.
pub trait ViewSource: Send + Sync {
    /// What is known besides the pixels.
    fn meta(&self) -> &Meta;
    /// Reads view (row `v`, column `u`), shape (t, s, c), values 0..1.
    ///
    /// # Errors
    /// When the view is missing or malformed.
    fn read(&self, v: usize, u: usize) -> Result<Array3<f32>, Error>;
}

/// What goes wrong with light fields on disk.
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
    /// The file is not what it should be.
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
    /// The caller asked for something impossible.
    #[error("{0}")]
    Parameter(String),
}
