//! Pairs on disk: features.npy, residuals.npy, filters.npy and manifest.json.

use std::io::Write;
use std::path::Path;

use lenslet_core::dictionary::Photo;
use lenslet_core::output::{self, Pending};
use ndarray::Array2;
use ndarray_npy::WriteNpyExt;
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
        let mut part = std::io::BufWriter::new(output::create_part(&pending.path().join(name)).map_err(io)?);
        array.write_npy(&mut part).map_err(|e| io(std::io::Error::other(e)))?;
        part.flush().map_err(io)?;
    }
    let text = serde_json::to_string_pretty(manifest).map_err(|e| io(std::io::Error::other(e)))?;
    output::write_part(&pending.path().join("manifest.json"), text.as_bytes()).map_err(io)?;
    Ok(pending.commit()?)
}
