//! How a dictionary was trained: stored in its file, so that the training can be repeated.

use serde::{Deserialize, Serialize};

/// A photo that training pairs were cut from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Photo {
    /// File name without folders.
    pub file: String,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
}

/// How a dictionary was trained.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
#[serde(default)]
pub struct Recipe {
    /// Tool and version that trained it.
    pub tool: String,
    /// `ksvd`, `online` or `ista`.
    pub algorithm: String,
    /// Seed of the random generator.
    pub seed: u64,
    /// Name of the random generator.
    pub generator: String,
    /// Every parameter of training, by name.
    pub parameters: serde_json::Map<String, serde_json::Value>,
    /// The photos.
    pub photos: Vec<Photo>,
    /// Scores on held-out photos, by name.
    pub scores: serde_json::Map<String, serde_json::Value>,
}
