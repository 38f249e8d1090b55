//! What a dictionary holds: models of residual patches, one per footprint.

use serde::{Deserialize, Serialize};

use super::patch_model::PatchModel;
use super::recipe::Recipe;
use crate::interpolation::Interpolation;

/// What a sample of the low image measured: the scene at a point, or its mean over the lenslet.
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

/// What was trained for one footprint.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// What a sample measured.
    pub footprint: Footprint,
    /// Which interpolation made the low image.
    pub base: Interpolation,
    /// Output pixels between neighbouring samples of a row.
    pub pitch: f64,
    /// The learned map.
    pub patch_model: PatchModel,
}

/// What a model was trained for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelKind {
    /// What a sample measured.
    pub footprint: Footprint,
    /// Which interpolation made the low image.
    pub base: Interpolation,
    /// Output pixels between neighbouring samples of a row; for [`Footprint::Grid`] the factor of enlargement.
    pub pitch: f64,
}

impl Model {
    /// What the model was trained for.
    #[must_use]
    pub fn kind(&self) -> ModelKind {
        ModelKind { footprint: self.footprint, base: self.base, pitch: self.pitch }
    }
}

/// How values of the file's anchored maps are stored; everything else is f32.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(rename_all = "lowercase")]
pub enum Storage {
    /// As they are.
    #[default]
    F32,
    /// Signed bytes with one f32 scale per row (patch² values).
    I8,
}

/// Learned models and how they were trained.
#[derive(Debug, Clone, PartialEq)]
pub struct Dictionary {
    /// How it was made.
    pub recipe: Recipe,
    /// How the anchored maps are stored.
    pub storage: Storage,
    /// One model per footprint.
    pub models: Vec<Model>,
}

impl Dictionary {
    /// The model for a footprint, or the first model where that footprint has none. `None` only for a dictionary
    /// without models, which [`super::validate`] refuses.
    #[must_use]
    pub fn model(&self, footprint: Footprint) -> Option<&Model> {
        self.models.iter().find(|m| m.footprint == footprint).or_else(|| self.models.first())
    }
}

#[cfg(test)]
mod tests {
    use super::super::validate::tests::small_dictionary;
    use super::*;

    #[test]
    fn a_footprint_without_a_model_takes_the_first() {
        let mut dictionary = small_dictionary(1);
        dictionary.models.extend(small_dictionary(2).models);
        dictionary.models[1].footprint = Footprint::Lenslet;
        let [first, second] = [0, 1].map(|k| &dictionary.models[k]);
        assert_eq!(dictionary.model(Footprint::Point), Some(first));
        assert_eq!(dictionary.model(Footprint::Lenslet), Some(second));
        assert_eq!(dictionary.model(Footprint::Grid), Some(first));
    }
}
