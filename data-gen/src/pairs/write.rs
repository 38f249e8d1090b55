//! Pairs on disk: features.npy, residuals.npy, filters.npy and manifest.json.

use std::path::Path;

use lenslet_core::dictionary::Photo;
use lenslet_core::output::{self, Pending};
use ndarray::Array2;
use serde::Serialize;

use super::error::Error;
use super::extract::Pairs;

/// What the pairs are.
#[derive(Debug, Clone, Serialize)]
pub struct Manifest {
    /// Format version, 1.
    pub version: u32,
    /// Tool and version.
    pub tool: String,
    /// Number of pairs.
    pub pairs: usize,
    /// What the arrays hold and how values are normalised.
    pub arrays: serde_json::Value,
    /// Every parameter.
    pub parameters: serde_json::Value,
    /// The photos.
    pub photos: Vec<Photo>,
    /// Pairs from each photo.
    pub pairs_of_photo: Vec<usize>,
    /// Photos left out, and why.
    pub skipped: Vec<String>,
}

/// Writes pairs as a folder, whole or not at all.
///
/// # Errors
/// When the folder exists (without `force`) or cannot be written.
pub fn write_pairs(
    target: &Path,
    pairs: &Pairs,
    filters: &Array2<f32>,
    manifest: &Manifest,
    force: bool,
) -> Result<(), Error> {
    let pending = Pending::directory(target, force)?;
    let io = |e: std::io::Error| output::Error::Io { path: target.to_path_buf(), source: e };
    for (name, array) in
        [("features.npy", &pairs.features), ("residuals.npy", &pairs.residuals), ("filters.npy", filters)]
    {
        ndarray_npy::write_npy(pending.path().join(name), array).map_err(|e| io(std::io::Error::other(e)))?;
    }
    let text = serde_json::to_string_pretty(manifest).map_err(|e| io(std::io::Error::other(e)))?;
    std::fs::write(pending.path().join("manifest.json"), text).map_err(io)?;
    Ok(pending.commit()?)
}
