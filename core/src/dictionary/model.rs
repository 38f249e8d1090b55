//! What a dictionary holds: models of residual patches, one per footprint, each with the matrices of all its
//! predictors.

use ndarray::{Array1, Array2, Array3};
use serde::{Deserialize, Serialize};

use super::error::Error;
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

/// How the residual of a patch is predicted from the features of its window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PatchPredictor {
    /// Not at all: every residual is zero. The opponent that shows what the dictionary itself is worth.
    NoCodes,
    /// One ridge regressor for all patches.
    Ridge,
    /// The regressor of the nearest anchor (A+).
    Anchored,
    /// LASSO code of eq. (4), then Dh.
    Lasso,
    /// The network.
    Network,
}

impl PatchPredictor {
    /// All of them, in the order of tables.
    pub const ALL: [PatchPredictor; 5] = [
        PatchPredictor::NoCodes,
        PatchPredictor::Ridge,
        PatchPredictor::Anchored,
        PatchPredictor::Lasso,
        PatchPredictor::Network,
    ];

    /// The name in tables, descriptions and messages.
    ///
    /// ```
    /// use lenslet_core::dictionary::PatchPredictor;
    ///
    /// let names = PatchPredictor::ALL.map(PatchPredictor::name);
    /// assert_eq!(names, ["no codes", "ridge", "anchored", "LASSO", "network"]);
    /// ```
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            PatchPredictor::NoCodes => "no codes",
            PatchPredictor::Ridge => "ridge",
            PatchPredictor::Anchored => "anchored",
            PatchPredictor::Lasso => "LASSO",
            PatchPredictor::Network => "network",
        }
    }
}

impl std::fmt::Display for PatchPredictor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// Regressors anchored at unit vectors of the feature space (A+, Timofte 2014).
#[derive(Debug, Clone, PartialEq)]
pub struct Anchored {
    /// Anchors, K'×m, unit rows; the nearest by |correlation| is used.
    pub anchors: Array2<f32>,
    /// One linear map per anchor, K'×m×patch²: residual = fᵀ·map.
    pub maps: Array3<f32>,
}

/// One layer of a [`Network`]: `weights`·x + `bias`; all but the last are rectified (negative values become 0).
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Outputs × inputs.
    pub weights: Array2<f32>,
    /// Outputs.
    pub bias: Array1<f32>,
}

/// A small feed-forward network that predicts residual patches.
///
/// Features `f`: of the low image's window as in [`PatchModel`]; of each side input, filters of its difference to the
/// low image. The first layer takes `f/n` and ln `n` with `n = max(‖f‖, floor)`; the outputs of the last times ‖f‖ are
/// the residual.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    /// Side of the windows (odd), pixels.
    pub support: usize,
    /// Interpolations of the view's own samples that are inputs besides the low image.
    pub side_inputs: Vec<Interpolation>,
    /// How many rows of `filters` belong to the low image, then to each side input.
    pub filters_per_input: Vec<usize>,
    /// Feature filters, m × support²; those of the low image sum to zero.
    pub filters: Array2<f32>,
    /// Smallest norm a feature vector is divided by.
    pub floor: f32,
    /// At least one; the first has m + 1 inputs, the last patch² outputs.
    pub layers: Vec<Layer>,
}

impl Network {
    /// Side of the residual patch, pixels.
    #[must_use]
    pub fn patch(&self) -> usize {
        self.layers.last().map_or(0, |l| l.bias.len()).isqrt()
    }
}

/// The learned map from the low image around a pixel to the residual patch there, for every [`PatchPredictor`].
#[derive(Debug, Clone, PartialEq)]
pub struct PatchModel {
    /// Side of the window of the low image that features are computed from (odd), pixels.
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
    pub ridge: Array2<f32>,
    /// Anchored regressors, the fast predictor.
    pub anchored: Option<Anchored>,
    /// A network; it has separate feature filters.
    pub network: Option<Network>,
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

impl PatchModel {
    /// Whether it holds what a predictor needs.
    #[must_use]
    pub fn has(&self, predictor: PatchPredictor) -> bool {
        match predictor {
            PatchPredictor::NoCodes | PatchPredictor::Ridge | PatchPredictor::Lasso => true,
            PatchPredictor::Anchored => self.anchored.is_some(),
            PatchPredictor::Network => self.network.is_some(),
        }
    }

    /// The predictors it holds, in the order of [`PatchPredictor::ALL`].
    pub fn predictors(&self) -> impl Iterator<Item = PatchPredictor> {
        PatchPredictor::ALL.into_iter().filter(|p| self.has(*p))
    }

    /// Checks that it holds what a predictor needs.
    ///
    /// # Errors
    /// [`Error::NoPredictor`], which names what there is.
    pub fn require(&self, wanted: PatchPredictor) -> Result<(), Error> {
        if self.has(wanted) {
            return Ok(());
        }
        let held: Vec<&str> = self.predictors().map(PatchPredictor::name).collect();
        let wanted = if wanted == PatchPredictor::Anchored { "anchored regressors" } else { wanted.name() };
        Err(Error::NoPredictor { wanted, held: held.join(", ") })
    }
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
