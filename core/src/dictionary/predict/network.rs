//! Patches by a small feed-forward network in place of a sparse code: features of the low image and of its side inputs
//! to the residual patch. The network is fitted to the residual itself, and it can combine several images of the same
//! view.

use std::sync::Arc;

use ndarray::{Array2, s};

use super::super::error::Error;
use super::super::features::{extract_features, row_norms};
use super::super::limits;
use super::super::model::Model;
use super::super::patch_model::{Layer, Network, PatchModel};
use super::super::side_input::SideInput;
use super::predictor::PredictPatches;
use crate::linalg::{Par, product};

/// The model's network.
#[derive(Debug)]
pub(super) struct PatchNetwork {
    model: Arc<Model>,
    side_inputs: Vec<SideInput>,
    /// Sides of the windows and of the patch, pixels.
    support: usize,
    patch: usize,
}

impl PatchNetwork {
    pub(super) fn new(model: &Arc<Model>) -> Self {
        let network = model.patch_model.network.as_ref();
        PatchNetwork {
            model: Arc::clone(model),
            side_inputs: network.map_or_else(Vec::new, |n| n.side_inputs.clone()),
            support: network.map_or(1, |n| n.support),
            patch: network.map_or(1, Network::patch),
        }
    }
}

/// Checks the shapes of a network and that its numbers are finite.
///
/// # Errors
/// [`Error::Parameter`] that says what is wrong.
pub(in super::super) fn check_network(network: &Network) -> Result<(), Error> {
    let wrong = |what: String| Err(Error::Parameter(format!("network: {what}")));
    let m = network.filters.nrows();
    if network.support > limits::SIDE || network.support.is_multiple_of(2) {
        return wrong(format!("a window of {} pixels", network.support));
    }
    if m == 0 || m > limits::FEATURES || network.filters.ncols() != network.support * network.support {
        return wrong(format!("feature filters have shape {:?}", network.filters.dim()));
    }
    if network.filters_per_input.len() != network.side_inputs.len() + 1
        || network.filters_per_input.iter().sum::<usize>() != m
    {
        return wrong(format!(
            "{m} filters of {} inputs in groups of {:?}",
            network.side_inputs.len() + 1,
            network.filters_per_input
        ));
    }
    let patch = network.patch();
    let outputs = network.layers.last().map_or(0, |l| l.bias.len());
    if patch.is_multiple_of(2) || patch > network.support || patch * patch != outputs {
        return wrong(format!("{outputs} outputs do not fill a square patch of odd side"));
    }
    let mut inputs = m + 1;
    for layer in &network.layers {
        let rows = layer.bias.len();
        if layer.weights.dim() != (rows, inputs) || rows == 0 || rows > limits::ATOMS {
            return wrong(format!("a layer of shape {:?} for {inputs} inputs", layer.weights.dim()));
        }
        inputs = rows;
    }
    let mut values = network.layers.iter().flat_map(|l| l.weights.iter().chain(&l.bias)).chain(&network.filters);
    if !(values.all(|v| v.is_finite()) && network.floor > 0.0 && network.floor.is_finite()) {
        return wrong("a value is not finite".into());
    }
    Ok(())
}

impl PredictPatches for PatchNetwork {
    fn patch_model(&self) -> &PatchModel {
        &self.model.patch_model
    }

    fn support(&self) -> usize {
        self.support
    }

    fn patch(&self) -> usize {
        self.patch
    }

    fn side_inputs(&self) -> &[SideInput] {
        &self.side_inputs
    }

    fn predict(&self, padded: &[Array2<f32>], corners: &[(usize, usize)]) -> Result<Array2<f32>, Error> {
        match &self.model.patch_model.network {
            Some(network) => Ok(network.residuals(&network.features(padded, corners))),
            None => Err(Error::Parameter("the model has no network".into())),
        }
    }
}

impl Network {
    /// Features (n×m) of the windows whose top left corners are `corners` (y, x) of padded planes: the low image, then
    /// for each side input its difference to the low image.
    ///
    /// # Panics
    /// When a window leaves its plane.
    #[must_use]
    pub fn features(&self, padded: &[Array2<f32>], corners: &[(usize, usize)]) -> Array2<f32> {
        extract_features(padded, self.support, &self.filters, &self.filters_per_input, corners)
    }

    /// Residual patches (n×patch²) of features (n×m).
    #[must_use]
    pub fn residuals(&self, features: &Array2<f32>) -> Array2<f32> {
        let (mut x, norms) = network_inputs(features, self.floor);
        let last = self.layers.len().saturating_sub(1);
        for (k, layer) in self.layers.iter().enumerate() {
            x = layer.forward(&x, k < last);
        }
        for (mut row, n) in x.rows_mut().into_iter().zip(&norms) {
            row *= *n;
        }
        x
    }
}

/// The first layer's inputs (n×(m+1)) for features (n×m): each row f divided by d = max(‖f‖, `floor`), followed by ln
/// d; and the norms ‖f‖.
///
/// ```
/// use lenslet_core::dictionary::network_inputs;
/// use ndarray::array;
///
/// let (inputs, norms) = network_inputs(&array![[3.0f32, 4.0], [0.0, 0.5]], 1.0);
/// assert_eq!(inputs, array![[0.6, 0.8, 5.0f32.ln()], [0.0, 0.5, 0.0]]);
/// assert_eq!(norms, [5.0, 0.5]);
/// ```
#[must_use]
pub fn network_inputs(features: &Array2<f32>, floor: f32) -> (Array2<f32>, Vec<f32>) {
    let m = features.ncols();
    let norms = row_norms(features);
    let mut x = Array2::zeros((features.nrows(), m + 1));
    for ((mut x, f), norm) in x.rows_mut().into_iter().zip(features.rows()).zip(&norms) {
        let n = norm.max(floor);
        x.slice_mut(s![..m]).zip_mut_with(&f, |x, f| *x = f / n);
        x[m] = n.ln();
    }
    (x, norms)
}

impl Layer {
    /// The layer's outputs (n×outputs) for inputs `x` (n×inputs); negative ones become 0 where `rectified`.
    ///
    /// ```
    /// use lenslet_core::dictionary::Layer;
    /// use ndarray::array;
    ///
    /// let layer = Layer { weights: array![[1.0, 2.0], [-1.0, 0.0]], bias: array![0.5, 0.0] };
    /// assert_eq!(layer.forward(&array![[1.0, 1.0]], true), array![[3.5, 0.0]]);
    /// assert_eq!(layer.forward(&array![[1.0, 1.0]], false), array![[3.5, -1.0]]);
    /// ```
    #[must_use]
    pub fn forward(&self, x: &Array2<f32>, rectified: bool) -> Array2<f32> {
        let mut out = product(x.view(), self.weights.t(), Par::Seq);
        for mut row in out.rows_mut() {
            row += &self.bias;
            if rectified {
                row.mapv_inplace(|v| v.max(0.0));
            }
        }
        out
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::super::super::features::pad_mirrored;
    use super::*;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    /// A network of random numbers: these side inputs, one hidden layer.
    pub(crate) fn random_network(seed: u64, side_inputs: &[SideInput]) -> Network {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut random = |r, c| Array2::from_shape_fn((r, c), |_| rng.random::<f32>() - 0.5);
        let filters_per_input: Vec<usize> = (0..=side_inputs.len()).map(|i| 5 - i).collect();
        let m = filters_per_input.iter().sum();
        let mut filters = random(m, 49);
        filters.rows_mut().into_iter().take(filters_per_input[0]).for_each(|mut r| {
            let mean = r.sum() / 49.0;
            r -= mean;
        });
        let layer = |weights: Array2<f32>, bias: Array2<f32>| Layer { weights, bias: bias.row(0).to_owned() };
        let layers = vec![layer(random(7, m + 1), random(1, 7)), layer(random(9, 7), random(1, 9))];
        Network { support: 7, side_inputs: side_inputs.to_vec(), filters_per_input, filters, floor: 0.05, layers }
    }

    /// The definition for one place, in f64.
    fn plain(network: &Network, planes: &[Array2<f32>], corner: (usize, usize)) -> Vec<f64> {
        let mut f = Vec::new();
        let mut row = 0;
        for (plane, &count) in planes.iter().zip(&network.filters_per_input) {
            for r in row..row + count {
                let value = |j: usize| f64::from(plane[[corner.0 + j / 7, corner.1 + j % 7]]);
                f.push((0..49).map(|j| f64::from(network.filters[[r, j]]) * value(j)).sum::<f64>());
            }
            row += count;
        }
        let norm = f.iter().map(|v| v * v).sum::<f64>().sqrt();
        let n = norm.max(network.floor.into());
        let mut x: Vec<f64> = f.iter().map(|v| v / n).chain([n.ln()]).collect();
        for (k, layer) in network.layers.iter().enumerate() {
            let rows = layer.weights.rows().into_iter().zip(&layer.bias);
            x = rows
                .map(|(w, b)| w.iter().zip(&x).map(|(w, x)| f64::from(*w) * x).sum::<f64>() + f64::from(*b))
                .map(|v| if k + 1 < network.layers.len() { v.max(0.0) } else { v })
                .collect();
        }
        x.into_iter().map(|v| v * norm).collect()
    }

    #[test]
    fn the_network_equals_its_definition() {
        let plane = |k: usize| Array2::from_shape_fn((12, 15), |(y, x)| ((y * 31 + x * (17 + k)) % 23) as f32 / 23.0);
        for side_inputs in [&[][..], &[SideInput::Cubic], &[SideInput::Barycentric, SideInput::Cubic, SideInput::Noise]]
        {
            let network = random_network(3, side_inputs);
            check_network(&network).unwrap();
            let padded: Vec<Array2<f32>> = (0..=side_inputs.len()).map(|k| pad_mirrored(plane(k).view(), 3)).collect();
            let corners: Vec<_> = (0..12).flat_map(|y| (0..15).map(move |x| (y, x))).collect();
            let found = network.residuals(&network.features(&padded, &corners));
            for (row, &corner) in found.rows().into_iter().zip(&corners) {
                for (a, b) in row.iter().zip(plain(&network, &padded, corner)) {
                    assert!((f64::from(*a) - b).abs() < 1e-4 * (1.0 + b.abs()), "{a} {b}");
                }
            }
        }
    }
}
