//! Dictionaries spoiled on purpose: what a check of dictionaries must notice.

use lenslet_core::dictionary::{Dictionary, PatchModel, PatchPredictor};
use lenslet_core::random::{shuffled_indices, standard_normal};
use ndarray::{Array2, Axis};
use rand::rngs::ChaCha8Rng;
use rand::{Rng, SeedableRng};

/// A way to spoil a model.
pub struct Spoiling {
    /// What is done.
    pub name: &'static str,
    /// The predictor that it spoils.
    pub predictor: PatchPredictor,
    apply: fn(&mut PatchModel, &mut ChaCha8Rng),
}

/// Every way.
pub const SPOILINGS: [Spoiling; 8] = [
    Spoiling { name: "codes zeroed", predictor: PatchPredictor::Lasso, apply: |m, _| m.high.fill(0.0) },
    Spoiling {
        name: "Dh columns permuted",
        predictor: PatchPredictor::Lasso,
        apply: |m, r| permute_columns(&mut m.high, r),
    },
    Spoiling { name: "Dl of noise", predictor: PatchPredictor::Lasso, apply: |m, r| fill_with_noise(&mut m.low, r) },
    Spoiling { name: "λ ten times too large", predictor: PatchPredictor::Lasso, apply: |m, _| m.lambda *= 10.0 },
    Spoiling { name: "ridge zero", predictor: PatchPredictor::Ridge, apply: |m, _| m.ridge.fill(0.0) },
    Spoiling {
        name: "ridge columns permuted",
        predictor: PatchPredictor::Ridge,
        apply: |m, r| permute_columns(&mut m.ridge, r),
    },
    Spoiling { name: "anchors' regressors permuted", predictor: PatchPredictor::Anchored, apply: permute_regressors },
    Spoiling { name: "network weights permuted", predictor: PatchPredictor::Network, apply: permute_weights },
];

impl Spoiling {
    /// A copy with every model spoiled; `None` where none has what would be.
    pub fn of(&self, dictionary: &Dictionary) -> Option<Dictionary> {
        let mut spoiled = dictionary.clone();
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        for model in &mut spoiled.models {
            (self.apply)(&mut model.patch_model, &mut rng);
        }
        dictionary.models.iter().all(|m| m.patch_model.has(self.predictor)).then_some(spoiled)
    }
}

fn permute_columns(matrix: &mut Array2<f32>, rng: &mut impl Rng) {
    *matrix = matrix.select(Axis(1), &shuffled_indices(matrix.ncols(), rng));
}

/// Rows of unit norm in directions that mean nothing.
fn fill_with_noise(matrix: &mut Array2<f32>, rng: &mut ChaCha8Rng) {
    matrix.mapv_inplace(|_| standard_normal(rng) as f32);
    for mut row in matrix.rows_mut() {
        let norm = row.dot(&row).sqrt();
        row /= norm;
    }
}

/// Every anchor gets another anchor's regressor.
fn permute_regressors(model: &mut PatchModel, rng: &mut ChaCha8Rng) {
    if let Some(anchored) = &mut model.anchored {
        let order = shuffled_indices(anchored.maps.len_of(Axis(0)), rng);
        anchored.maps = anchored.maps.select(Axis(0), &order);
    }
}

fn permute_weights(model: &mut PatchModel, rng: &mut ChaCha8Rng) {
    for layer in model.network.iter_mut().flat_map(|n| &mut n.layers) {
        let values: Vec<f32> = layer.weights.iter().copied().collect();
        let order = shuffled_indices(values.len(), rng);
        layer.weights.iter_mut().zip(order).for_each(|(w, k)| *w = values[k]);
    }
}
