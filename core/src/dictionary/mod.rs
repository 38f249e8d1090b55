//! Coupled dictionaries Dl, Dh (paper section 4.4, eq. (3) and (4)): what is learned, its file, and its use on a plane.
//!
//! A [`Dictionary`] holds a [`Model`] for each footprint it was trained for; a model is a chain of [`Pass`]es. One pass:
//!
//! 1. features of the low image around each patch: `f = F·w`, where `w` is the square window of `support`² values and
//!    `F` (m × support²) are gradients of first and second order followed by their principal components (Zeyde 2010),
//!    folded into one matrix; every row of `F` sums to zero, so the mean of the window does not matter;
//! 2. norm: `n = max(‖f‖, floor)`, `y = f/n`;
//! 3. code: φ = argmin ½‖y − Dlᵀφ‖² + λ‖φ‖₁ (eq. (4)), or its replacement by anchored regression (A+) or a small network;
//! 4. residual patch `n·Dhᵀφ` (`patch`² values), added to the low image where patches overlap by weighted mean.
//!
//! The mean of the patch comes from the low image, since the residual high − low is what is learned.

mod export;
mod features;
mod file;
mod network;
mod reconstruct;

use ndarray::{Array2, Array3};
use serde::{Deserialize, Serialize};

pub use crate::interpolation::Interpolation;
pub use export::{export_npy, export_safetensors};
pub use features::{extract, gradient_operator, learn_components, learn_filters, pad, windows};
pub use file::{FORMAT_VERSION, from_bytes, load, save, to_bytes};
pub use network::{Layer, Network, extract_beside, forward, inputs, product};
pub use reconstruct::{Options, Path, Reconstructor};

/// What a sample of the low image was: the scene at a point, or its mean over the lenslet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Footprint {
    /// The image at the lenslet centre, interpolated bilinearly.
    Point,
    /// The mean over a disc one pitch in diameter.
    Lenslet,
    /// Pixels of a rectangular grid (plain enlargement of views decoded elsewhere).
    Grid,
}

impl std::fmt::Display for Footprint {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Footprint::Point => "point",
            Footprint::Lenslet => "lenslet",
            Footprint::Grid => "grid",
        })
    }
}

/// Regressors anchored at unit vectors of the feature space (A+, Timofte 2014).
#[derive(Debug, Clone, PartialEq)]
pub struct Anchored {
    /// Anchors, K'×m, unit rows; the nearest by |correlation| is used.
    pub anchors: Array2<f32>,
    /// One linear map an anchor, K'×m×patch²: residual = fᵀ·map.
    pub maps: Array3<f32>,
}

/// One pass of learned reconstruction.
#[derive(Debug, Clone, PartialEq)]
pub struct Pass {
    /// Side of the window of the low image that features see (odd), pixels.
    pub support: usize,
    /// Side of the residual patch (odd, at most `support`), pixels.
    pub patch: usize,
    /// Feature filters F, m × support², rows sum to zero.
    pub filters: Array2<f32>,
    /// Smallest norm a feature vector is divided by.
    pub floor: f32,
    /// λ of eq. (4) for unit features.
    pub lambda: f32,
    /// Dl, K×m, unit rows.
    pub low: Array2<f32>,
    /// Dh, K×patch².
    pub high: Array2<f32>,
    /// One ridge regressor for every patch, m×patch².
    pub linear: Array2<f32>,
    /// Whether the ridge regressor's residual is added to that of the codes.
    pub with_linear: bool,
    /// Anchored regressors, the fast path.
    pub anchored: Option<Anchored>,
    /// A network, with features of its own.
    pub network: Option<Network>,
}

/// Passes trained for one footprint; each works on the result of the one before.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// What a sample was.
    pub footprint: Footprint,
    /// Which interpolation made the low image.
    pub base: Interpolation,
    /// Output pixels between neighbouring samples of a row.
    pub pitch: f64,
    /// At least one.
    pub passes: Vec<Pass>,
}

/// How values of the file's anchored maps are stored; everything else is f32.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(rename_all = "lowercase")]
pub enum Storage {
    /// As they are.
    #[default]
    F32,
    /// Signed bytes with one f32 scale a row (patch² values).
    I8,
}

/// A photo that pairs were cut from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Photo {
    /// File name without folders.
    pub file: String,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
}

/// How a dictionary came to be.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
#[serde(default)]
pub struct Recipe {
    /// Tool and version that trained it.
    pub tool: String,
    /// `ksvd`, `online` or `ista`.
    pub algorithm: String,
    /// Seed of the generator.
    pub seed: u64,
    /// Name of the generator.
    pub generator: String,
    /// Every parameter of training, by name.
    pub parameters: serde_json::Map<String, serde_json::Value>,
    /// The photos.
    pub photos: Vec<Photo>,
    /// Scores on held-out photos, by name.
    pub scores: serde_json::Map<String, serde_json::Value>,
}

/// Learned dictionaries and how they came to be.
#[derive(Debug, Clone, PartialEq)]
pub struct Dictionary {
    /// How it was made.
    pub recipe: Recipe,
    /// How the anchored maps are stored.
    pub storage: Storage,
    /// One model a footprint.
    pub models: Vec<Model>,
}

impl Dictionary {
    /// The model for a footprint, or the first where there is none for it.
    #[must_use]
    pub fn model(&self, footprint: Footprint) -> Option<&Model> {
        self.models.iter().find(|m| m.footprint == footprint).or_else(|| self.models.first())
    }
}

/// Largest numbers a dictionary may have: no file can make us allocate more than this allows.
pub mod limits {
    /// Atoms or anchors of a pass.
    pub const ATOMS: usize = 1 << 16;
    /// Features of a pass.
    pub const FEATURES: usize = 1024;
    /// Side of a window or patch.
    pub const SIDE: usize = 65;
    /// Models of a file, and passes of a model.
    pub const PARTS: usize = 16;
    /// Bytes of a header.
    pub const HEADER: usize = 1 << 22;
    /// Bytes of a file.
    pub const FILE: u64 = 1 << 30;
}

/// What goes wrong with dictionaries.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Reading failed.
    #[error("cannot read {path}: {source}")]
    Io {
        /// Which file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// Not a dictionary at all.
    #[error("{path} is not a lenslet dictionary (.lfd); train one with `lenslet train-dict`")]
    NotDictionary {
        /// Which file.
        path: String,
    },
    /// A dictionary of another format version.
    #[error("{path} is a dictionary of format version {found}, and this lenslet reads version {known}: {remedy}")]
    Version {
        /// Which file.
        path: String,
        /// Its version.
        found: u32,
        /// Ours.
        known: u32,
        /// What to do.
        remedy: &'static str,
    },
    /// Truncated or damaged.
    #[error("{path} is damaged: {reason}; fetch or train it again")]
    Malformed {
        /// Which file.
        path: String,
        /// What is wrong.
        reason: String,
    },
    /// Writing failed.
    #[error(transparent)]
    Output(#[from] crate::output::Error),
    /// A parameter out of range, or shapes that do not fit each other.
    #[error("{0}")]
    Parameter(String),
    /// The sparse solver refused.
    #[error(transparent)]
    Sparse(#[from] crate::sparse::Error),
    /// The caller asked to stop.
    #[error("interrupted")]
    Interrupted,
}

/// Checks that a dictionary's shapes fit, its numbers are finite and its atoms have unit norm.
///
/// # Errors
/// [`Error::Parameter`] with what is wrong.
pub fn validate(dictionary: &Dictionary) -> Result<(), Error> {
    let wrong = |what: String| Err(Error::Parameter(what));
    if dictionary.models.is_empty() || dictionary.models.len() > limits::PARTS {
        return wrong(format!("a dictionary has 1 to {} models, not {}", limits::PARTS, dictionary.models.len()));
    }
    for model in &dictionary.models {
        if model.passes.is_empty() || model.passes.len() > limits::PARTS {
            return wrong(format!("a model has 1 to {} passes, not {}", limits::PARTS, model.passes.len()));
        }
        if !(model.pitch.is_finite() && model.pitch > 0.0) {
            return wrong(format!("pitch {} is not a positive number", model.pitch));
        }
        for pass in &model.passes {
            validate_pass(pass)?;
        }
    }
    Ok(())
}

fn validate_pass(pass: &Pass) -> Result<(), Error> {
    let wrong = |what: String| Err(Error::Parameter(what));
    let (p2, m) = (pass.patch * pass.patch, pass.filters.nrows());
    if pass.support > limits::SIDE
        || pass.patch > pass.support
        || pass.support.is_multiple_of(2)
        || pass.patch.is_multiple_of(2)
    {
        return wrong(format!("window of {} and patch of {} pixels do not fit", pass.support, pass.patch));
    }
    if m == 0 || m > limits::FEATURES || pass.filters.ncols() != pass.support * pass.support {
        return wrong(format!("feature filters have shape {:?}", pass.filters.dim()));
    }
    let k = pass.low.nrows();
    if k == 0 || k > limits::ATOMS || pass.low.ncols() != m || pass.high.dim() != (k, p2) {
        return wrong(format!("atoms have shapes {:?} and {:?}", pass.low.dim(), pass.high.dim()));
    }
    if pass.linear.dim() != (m, p2) {
        return wrong(format!("the single regressor has shape {:?}", pass.linear.dim()));
    }
    if !(pass.floor > 0.0 && pass.floor.is_finite() && pass.lambda >= 0.0 && pass.lambda.is_finite()) {
        return wrong(format!("floor {} or λ {} is out of range", pass.floor, pass.lambda));
    }
    let finite = |a: &Array2<f32>| a.iter().all(|v| v.is_finite());
    if !(finite(&pass.filters) && finite(&pass.low) && finite(&pass.high) && finite(&pass.linear)) {
        return wrong("a value is not finite".into());
    }
    let unit = |a: &Array2<f32>| a.rows().into_iter().all(|r| (r.dot(&r).sqrt() - 1.0).abs() < 1e-3);
    if !unit(&pass.low) {
        return wrong("an atom of Dl has not unit norm".into());
    }
    if let Some(a) = &pass.anchored {
        let n = a.anchors.nrows();
        if n == 0 || n > limits::ATOMS || a.anchors.ncols() != m || a.maps.dim() != (n, m, p2) {
            return wrong(format!("anchors have shapes {:?} and {:?}", a.anchors.dim(), a.maps.dim()));
        }
        if !unit(&a.anchors) || !finite(&a.anchors) || !a.maps.iter().all(|v| v.is_finite()) {
            return wrong("an anchor is not a finite unit vector, or a map is not finite".into());
        }
    }
    pass.network.as_ref().map_or(Ok(()), Network::check)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    /// A small valid dictionary of random numbers.
    pub(crate) fn small(seed: u64) -> Dictionary {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (support, patch, m, k) = (7, 3, 5, 8);
        let mut random = |rows, columns| Array2::from_shape_fn((rows, columns), |_| rng.random::<f32>() - 0.5);
        let unit = |mut a: Array2<f32>| {
            a.rows_mut().into_iter().for_each(|mut r| {
                let n = r.dot(&r).sqrt();
                r /= n;
            });
            a
        };
        let mut filters = random(m, support * support);
        filters.rows_mut().into_iter().for_each(|mut r| {
            let mean = r.sum() / (support * support) as f32;
            r -= mean;
        });
        let maps = random(4 * m, patch * patch).into_shape_with_order((4, m, patch * patch)).unwrap();
        let pass = Pass {
            support,
            patch,
            filters,
            floor: 0.05,
            lambda: 0.1,
            low: unit(random(k, m)),
            high: random(k, patch * patch),
            linear: random(m, patch * patch),
            with_linear: false,
            anchored: Some(Anchored { anchors: unit(random(4, m)), maps }),
            network: None,
        };
        let model =
            Model { footprint: Footprint::Point, base: Interpolation::Barycentric, pitch: 3.3, passes: vec![pass] };
        let mut recipe = Recipe { tool: "test".into(), seed, ..Recipe::default() };
        recipe.parameters.insert("atoms".into(), 8.into());
        recipe.photos.push(Photo { file: "a.jpg".into(), sha256: "00".into() });
        Dictionary { recipe, storage: Storage::F32, models: vec![model] }
    }

    #[test]
    fn invalid_dictionaries_are_named() {
        assert!(validate(&small(1)).is_ok());
        let mut bad = small(1);
        bad.models[0].passes[0].low[[0, 0]] += 1.0;
        assert!(validate(&bad).unwrap_err().to_string().contains("unit norm"));
        let mut bad = small(1);
        bad.models[0].passes[0].high[[0, 0]] = f32::NAN;
        assert!(validate(&bad).unwrap_err().to_string().contains("not finite"));
        let mut bad = small(1);
        bad.models[0].passes[0].patch = 9;
        assert!(validate(&bad).is_err());
        let mut bad = small(1);
        bad.models.clear();
        assert!(validate(&bad).is_err());
    }
}
