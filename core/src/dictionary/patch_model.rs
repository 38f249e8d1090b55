//! What a patch model consists of: the predictors there are, and the matrices and numbers of each, listed once for every
//! file format.

use ndarray::{Array1, Array2, Array3, ArrayViewD};
use serde::{Deserialize, Serialize};

use super::error::Error;
use super::limits;
use super::side_input::SideInput;

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

    /// What is said of it everywhere.
    fn facts(self) -> Facts {
        match self {
            PatchPredictor::NoCodes => Facts {
                name: "no codes",
                word: "none",
                meaning: "Nothing learned: measured samples put back, colours guided by the luminance",
                spacing: 3,
            },
            PatchPredictor::Ridge => Facts {
                name: "ridge",
                word: "ridge",
                meaning: "One ridge regressor for all patches: a linear filter",
                spacing: 3,
            },
            PatchPredictor::Anchored => Facts {
                name: "anchored",
                word: "anchored",
                meaning: "The regressor of the nearest anchor (A+)",
                spacing: 3,
            },
            PatchPredictor::Lasso => Facts {
                name: "LASSO",
                word: "lasso",
                meaning: "LASSO codes over Dl, then Dh (eq. (4) of the paper)",
                spacing: 2,
            },
            PatchPredictor::Network => Facts {
                name: "network",
                word: "network",
                meaning: "The dictionary's feed-forward network (not in the paper)",
                spacing: 2,
            },
        }
    }

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
        self.facts().name
    }

    /// The word that options select it by.
    ///
    /// ```
    /// use lenslet_core::dictionary::PatchPredictor;
    ///
    /// let words = PatchPredictor::ALL.map(PatchPredictor::word);
    /// assert_eq!(words, ["none", "ridge", "anchored", "lasso", "network"]);
    /// ```
    #[must_use]
    pub fn word(self) -> &'static str {
        self.facts().word
    }

    /// One sentence about it, without a full stop.
    #[must_use]
    pub fn meaning(self) -> &'static str {
        self.facts().meaning
    }

    /// Pixels between neighbouring patches where nothing else is asked for; never more than a patch is wide.
    #[must_use]
    pub fn spacing(self) -> usize {
        self.facts().spacing
    }
}

/// What is said of a predictor: name in tables, word in options, one sentence, pixels between patches.
struct Facts {
    name: &'static str,
    word: &'static str,
    meaning: &'static str,
    spacing: usize,
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
    /// The inputs besides the low image.
    pub side_inputs: Vec<SideInput>,
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

impl PatchModel {
    /// One with features, and with empty matrices of every predictor.
    ///
    /// ```
    /// use lenslet_core::dictionary::{PatchModel, PatchPredictor};
    /// use ndarray::Array2;
    ///
    /// let model = PatchModel::of_features(7, 3, Array2::zeros((4, 49)), 0.05);
    /// assert_eq!(model.low.dim(), (0, 4));
    /// assert!(!model.has(PatchPredictor::Network));
    /// ```
    #[must_use]
    pub fn of_features(support: usize, patch: usize, filters: Array2<f32>, floor: f32) -> Self {
        let (m, values) = (filters.nrows(), patch * patch);
        PatchModel {
            support,
            patch,
            filters,
            floor,
            lambda: 0.0,
            low: Array2::zeros((0, m)),
            high: Array2::zeros((0, values)),
            ridge: Array2::zeros((m, values)),
            anchored: None,
            network: None,
        }
    }

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

/// Which matrix of a [`PatchModel`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Matrix {
    Filters,
    LowAtoms,
    HighAtoms,
    Ridge,
    Anchors,
    Maps,
    NetworkFilters,
    LayerWeights(usize),
    LayerBias(usize),
}

impl Matrix {
    /// The name of the tensor in a `.safetensors` file, after the model's; also that of the exported .npy file.
    pub(super) fn tensor_name(self) -> String {
        match self {
            Matrix::Filters => "features.filters".into(),
            Matrix::LowAtoms => "lasso.low_atoms".into(),
            Matrix::HighAtoms => "lasso.high_atoms".into(),
            Matrix::Ridge => "ridge.map".into(),
            Matrix::Anchors => "anchored.anchors".into(),
            Matrix::Maps => "anchored.maps".into(),
            Matrix::NetworkFilters => "network.filters".into(),
            Matrix::LayerWeights(k) => format!("network.layer_{k}.weights"),
            Matrix::LayerBias(k) => format!("network.layer_{k}.bias"),
        }
    }

    /// The name in the table of an `.lfd` file, after the numbers of the model and of its only pass.
    pub(super) fn lfd_name(self) -> String {
        match self {
            Matrix::Filters => "filters".into(),
            Matrix::LowAtoms => "low".into(),
            Matrix::HighAtoms => "high".into(),
            Matrix::Ridge => "linear".into(),
            Matrix::Anchors => "anchors".into(),
            Matrix::Maps => "maps".into(),
            Matrix::NetworkFilters => "network.filters".into(),
            Matrix::LayerWeights(k) => format!("network.{k}.weights"),
            Matrix::LayerBias(k) => format!("network.{k}.bias"),
        }
    }
}

/// Every matrix of a model, in the order of the `.lfd` file.
pub(super) fn matrices(parts: &PatchModel) -> Vec<(Matrix, ArrayViewD<'_, f32>)> {
    let mut all = vec![
        (Matrix::Filters, parts.filters.view().into_dyn()),
        (Matrix::LowAtoms, parts.low.view().into_dyn()),
        (Matrix::HighAtoms, parts.high.view().into_dyn()),
        (Matrix::Ridge, parts.ridge.view().into_dyn()),
    ];
    if let Some(a) = &parts.anchored {
        all.push((Matrix::Anchors, a.anchors.view().into_dyn()));
        all.push((Matrix::Maps, a.maps.view().into_dyn()));
    }
    if let Some(n) = &parts.network {
        all.push((Matrix::NetworkFilters, n.filters.view().into_dyn()));
        for (k, layer) in n.layers.iter().enumerate() {
            all.push((Matrix::LayerWeights(k), layer.weights.view().into_dyn()));
            all.push((Matrix::LayerBias(k), layer.bias.view().into_dyn()));
        }
    }
    all
}

/// What a [`PatchModel`] is besides its matrices.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PatchNumbers {
    pub(super) support: u32,
    pub(super) patch: u32,
    pub(super) floor: f32,
    pub(super) lambda: f32,
    pub(super) anchored: bool,
    pub(super) network: Option<NetworkNumbers>,
}

/// What a network is besides its matrices.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NetworkNumbers {
    pub(super) support: u32,
    pub(super) floor: f32,
    pub(super) side_inputs: Vec<SideInput>,
    pub(super) filters_per_input: Vec<u32>,
    pub(super) layers: u32,
}

impl PatchNumbers {
    pub(super) fn of(parts: &PatchModel) -> Self {
        PatchNumbers {
            support: parts.support as u32,
            patch: parts.patch as u32,
            floor: parts.floor,
            lambda: parts.lambda,
            anchored: parts.anchored.is_some(),
            network: parts.network.as_ref().map(|n| NetworkNumbers {
                support: n.support as u32,
                floor: n.floor,
                side_inputs: n.side_inputs.clone(),
                filters_per_input: n.filters_per_input.iter().map(|&c| c as u32).collect(),
                layers: n.layers.len() as u32,
            }),
        }
    }
}

/// Shape and values of a matrix, or what is wrong with it.
pub(super) type Values = Result<(Vec<usize>, Vec<f32>), String>;

/// A patch model from its numbers and the matrices that `read` returns. Shapes are checked by [`super::validate`], not
/// here.
///
/// # Errors
/// Numbers beyond [`limits`]; errors of `read`; matrices with a wrong number of dimensions.
pub(super) fn assemble(numbers: &PatchNumbers, read: &dyn Fn(Matrix) -> Values) -> Result<PatchModel, String> {
    let matrix = |which| two_dimensional(which, read(which)?);
    let anchored = if numbers.anchored {
        Some(Anchored {
            anchors: matrix(Matrix::Anchors)?,
            maps: three_dimensional(Matrix::Maps, read(Matrix::Maps)?)?,
        })
    } else {
        None
    };
    let network = numbers.network.as_ref().map(|n| assemble_network(n, read)).transpose()?;
    Ok(PatchModel {
        support: side(numbers.support)?,
        patch: side(numbers.patch)?,
        filters: matrix(Matrix::Filters)?,
        floor: numbers.floor,
        lambda: numbers.lambda,
        low: matrix(Matrix::LowAtoms)?,
        high: matrix(Matrix::HighAtoms)?,
        ridge: matrix(Matrix::Ridge)?,
        anchored,
        network,
    })
}

fn assemble_network(numbers: &NetworkNumbers, read: &dyn Fn(Matrix) -> Values) -> Result<Network, String> {
    if numbers.layers as usize > limits::PARTS {
        return Err(format!("a network of {} layers", numbers.layers));
    }
    let mut layers = Vec::new();
    for k in 0..numbers.layers as usize {
        let (weights, bias) = (Matrix::LayerWeights(k), Matrix::LayerBias(k));
        layers
            .push(Layer { weights: two_dimensional(weights, read(weights)?)?, bias: Array1::from_vec(read(bias)?.1) });
    }
    Ok(Network {
        support: side(numbers.support)?,
        side_inputs: numbers.side_inputs.clone(),
        filters_per_input: numbers.filters_per_input.iter().map(|&c| c as usize).collect(),
        filters: two_dimensional(Matrix::NetworkFilters, read(Matrix::NetworkFilters)?)?,
        floor: numbers.floor,
        layers,
    })
}

fn side(pixels: u32) -> Result<usize, String> {
    if pixels as usize > limits::SIDE { Err(format!("a side of {pixels} pixels")) } else { Ok(pixels as usize) }
}

fn two_dimensional(which: Matrix, (shape, values): (Vec<usize>, Vec<f32>)) -> Result<Array2<f32>, String> {
    let &[rows, columns] = shape.as_slice() else {
        return Err(format!("matrix {} does not have two dimensions", which.tensor_name()));
    };
    Array2::from_shape_vec((rows, columns), values).map_err(|e| e.to_string())
}

fn three_dimensional(which: Matrix, (shape, values): (Vec<usize>, Vec<f32>)) -> Result<Array3<f32>, String> {
    let &[k, m, p] = shape.as_slice() else {
        return Err(format!("matrix {} does not have three dimensions", which.tensor_name()));
    };
    Array3::from_shape_vec((k, m, p), values).map_err(|e| e.to_string())
}
