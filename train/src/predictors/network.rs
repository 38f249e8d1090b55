//! Fitting of the network of [`lenslet_core::dictionary::Network`]: min Σ w·½‖o(x) − t‖² over pairs, x and t
//! normalised by [`lenslet_core::dictionary::network_inputs`], by Adam (Kingma and Ba 2015) on shuffled batches, with a
//! cosine-annealed learning rate (Loshchilov and Hutter 2017). Rectified layers begin as in He (2015).

use lenslet_core::dictionary::{Layer, Network, network_inputs};
use lenslet_core::linalg::{Par, product};
use lenslet_data_gen::pairs::{self, Crop, PatchOptions};
use ndarray::{Array1, Array2, Axis, Ix1, Ix2, concatenate};
use rand::rngs::ChaCha8Rng;
use rayon::prelude::*;

use super::fitting::Fitting;
use crate::error::Error;
use crate::normalised_pairs::crop_bytes;
use crate::observed::advance;
use crate::optimiser::{Adam, cosine_annealed};
use crate::parameters::NetworkParameters;
use lenslet_core::random::{shuffled_indices, standard_normal};

/// Smallest norm that features are divided by; flatter patches do not train.
/// Source: chosen.
const FLOOR: f32 = 0.02;

/// Pairs whose gradients are summed together; fixed, so that results do not depend on threads.
/// Source: chosen.
const CHUNK: usize = 128;

/// Added to the root of Adam's second moment.
/// Source: Kingma and Ba 2015, algorithm 1.
const EPSILON: f32 = 1e-8;

/// The random stream of the network.
const STREAM: u64 = 0x4000;

/// Learns the network of a model; `None` where the parameters want none.
///
/// # Errors
/// As [`learn_network`].
pub(super) fn fit_network(crops: &[Crop], with: &Fitting<'_>) -> Result<Option<Network>, Error> {
    let p = with.parameters;
    let Some(wanted) = &p.network else { return Ok(None) };
    let most = p.network_pairs_within(wanted, crop_bytes(crops));
    if most < wanted.pairs {
        let (pairs, memory) = (wanted.pairs, p.pairs.memory);
        with.observer.note(&format!("network: {most} pairs instead of {pairs}: more do not fit into {memory} GiB"));
    }
    with.observer.begin(&format!("{}: network", with.footprint), (wanted.epochs * most.min(wanted.pairs)) as u64);
    let (emphasis, mut rng) = (p.refinement.emphasis, (with.random_stream)(STREAM));
    learn_network(crops, wanted, emphasis, most, p.seed, &mut rng, &mut |n| advance(with.observer, n)).map(Some)
}

/// Learns a network on crops: filters, then layers. `emphasis` as in [`crate::RefinementParameters`]; at most `most`
/// pairs; `step` is called with the size of every batch.
///
/// # Errors
/// Too few textured patches, crops without the side inputs, errors of `step`.
pub fn learn_network(
    crops: &[Crop],
    parameters: &NetworkParameters,
    emphasis: f32,
    most: usize,
    seed: u64,
    rng: &mut ChaCha8Rng,
    step: &mut dyn FnMut(usize) -> Result<(), Error>,
) -> Result<Network, Error> {
    let p = parameters;
    if crops.iter().any(|c| c.side_inputs.len() < p.side_inputs.len()) {
        return Err(Error::Parameter(
            "network: these crops have no side inputs, which only simulated captures have".into(),
        ));
    }
    let support = p.window + 4;
    let mut filters = vec![pairs::learn_filters(crops, p.window, p.features[0])?.0];
    for (which, &count) in p.features[1..].iter().enumerate() {
        filters.push(pairs::learn_difference_filters(crops, which, support, count)?.0);
    }
    let filters: Vec<_> = filters.iter().map(|f| f.view()).collect();
    let filters = concatenate(Axis(0), &filters).map_err(|e| Error::Parameter(e.to_string()))?;
    let options = PatchOptions {
        patch: p.patch,
        window: p.window,
        per_crop: p.pairs.min(most).div_ceil(crops.len().max(1)),
        min_norm: FLOOR,
        keep_near_duplicates: true,
        seed,
        ..PatchOptions::default()
    };
    let pairs::Pairs { features, mut residuals, .. } = pairs::extract_pairs(crops, &filters, &p.features, &options)?;
    if features.nrows() < p.batch.max(100) {
        let found = features.nrows();
        return Err(Error::TooLittle(format!("{found} textured patches are too few for a network: give more photos")));
    }
    let (x, norms) = network_inputs(&features, FLOOR);
    drop(features);
    let mut weights = Vec::with_capacity(norms.len());
    for (mut row, &n) in residuals.rows_mut().into_iter().zip(&norms) {
        row /= n.max(FLOOR);
        weights.push(n.max(FLOOR).powf(emphasis));
    }
    let mean = weights.iter().map(|w| f64::from(*w)).sum::<f64>() / weights.len() as f64;
    weights.iter_mut().for_each(|w| *w /= mean as f32);
    let layers = fit_layers(x, residuals, &weights, p, rng, step)?;
    let (side_inputs, filters_per_input) = (p.side_inputs.clone(), p.features.clone());
    Ok(Network { support, side_inputs, filters_per_input, filters, floor: FLOOR, layers })
}

/// Layers fitted to inputs (N×(m+1)) and targets (N×patch²).
///
/// # Errors
/// Errors of `step`.
pub fn fit_layers(
    mut x: Array2<f32>,
    mut t: Array2<f32>,
    weights: &[f32],
    parameters: &NetworkParameters,
    rng: &mut ChaCha8Rng,
    step: &mut dyn FnMut(usize) -> Result<(), Error>,
) -> Result<Vec<Layer>, Error> {
    // Inputs and targets are standardised; the layers absorb means and scales at the end.
    let n = x.nrows() as f64;
    let (mut mean, mut size) = (vec![0f64; x.ncols()], vec![0f64; x.ncols()]);
    for row in x.rows() {
        for ((m, s), &v) in mean.iter_mut().zip(&mut size).zip(row) {
            *m += f64::from(v) / n;
            *s += f64::from(v).powi(2) / n;
        }
    }
    let mean = Array1::from_iter(mean.iter().map(|&m| m as f32));
    let variance = size.iter().zip(&mean).map(|(s, &m)| s - f64::from(m).powi(2));
    let size: Array1<f32> = variance.map(|v| v.max(0.0).sqrt() as f32 + 1e-6).collect();
    for mut row in x.rows_mut() {
        row -= &mean;
        row /= &size;
    }
    let energy: f64 = t.rows().into_iter().zip(weights).map(|(t, &w)| f64::from(w * t.dot(&t))).sum();
    let scale = (energy / t.len() as f64).sqrt().max(1e-9) as f32;
    t /= scale;

    let sizes: Vec<usize> = [x.ncols()].iter().chain(&parameters.hidden).chain([&t.ncols()]).copied().collect();
    let mut state: Vec<AdamLayer> = sizes.windows(2).map(|s| AdamLayer::new(s[1], s[0], rng)).collect();
    let batches = x.nrows().div_ceil(parameters.batch);
    let total = (parameters.epochs * batches) as f32;
    let mut done = 0u64;
    for _ in 0..parameters.epochs {
        for part in shuffled_indices(x.nrows(), rng).chunks(parameters.batch) {
            let gradient = network_gradient(&state, &x, &t, weights, part);
            let fall = cosine_annealed(done as f32 / total);
            done += 1;
            for (layer, (w, b)) in state.iter_mut().zip(&gradient) {
                layer.step(w, b, parameters.rate * fall, done);
            }
            step(part.len())?;
        }
    }
    let mut layers: Vec<Layer> = state.into_iter().map(|s| s.layer).collect();
    if let Some(first) = layers.first_mut() {
        first.weights /= &size;
        first.bias -= &first.weights.dot(&mean);
    }
    if let Some(last) = layers.last_mut() {
        last.weights *= scale;
        last.bias *= scale;
    }
    Ok(layers)
}

/// A layer and the moments of its gradients.
struct AdamLayer {
    layer: Layer,
    weights: Adam<Ix2>,
    bias: Adam<Ix1>,
}

impl AdamLayer {
    fn new(outputs: usize, inputs: usize, rng: &mut ChaCha8Rng) -> Self {
        let size = (2.0 / inputs as f64).sqrt();
        let weights = Array2::from_shape_fn((outputs, inputs), |_| (size * standard_normal(rng)) as f32);
        let bias = Array1::zeros(outputs);
        AdamLayer { weights: Adam::new(weights.dim()), bias: Adam::new(outputs), layer: Layer { weights, bias } }
    }

    fn step(&mut self, weights: &Array2<f32>, bias: &Array1<f32>, rate: f32, step: u64) {
        self.weights.step(&mut self.layer.weights, weights, rate, EPSILON, step);
        self.bias.step(&mut self.layer.bias, bias, rate, EPSILON, step);
    }
}

/// Gradients by weights and bias of every layer.
type Gradient = Vec<(Array2<f32>, Array1<f32>)>;

/// Mean gradient of the weighted error over the pairs of a batch.
fn network_gradient(
    state: &[AdamLayer],
    x: &Array2<f32>,
    t: &Array2<f32>,
    weights: &[f32],
    batch: &[usize],
) -> Gradient {
    let chunks: Vec<&[usize]> = batch.chunks(CHUNK).collect();
    let parts: Vec<Gradient> = chunks
        .par_iter()
        .map(|part| {
            let last = state.len() - 1;
            let mut values = vec![x.select(Axis(0), part)];
            for (k, s) in state.iter().enumerate() {
                values.push(s.layer.forward(&values[k], k < last));
            }
            let mut delta = values.pop().unwrap_or_default();
            delta -= &t.select(Axis(0), part);
            for (mut row, &n) in delta.rows_mut().into_iter().zip(*part) {
                row *= weights[n] / batch.len() as f32;
            }
            let mut gradient = Vec::new();
            for (k, s) in state.iter().enumerate().rev() {
                gradient.push((product(delta.t(), values[k].view(), Par::Seq), delta.sum_axis(Axis(0))));
                if k > 0 {
                    delta = product(delta.view(), s.layer.weights.view(), Par::Seq);
                    delta.zip_mut_with(&values[k], |d, &v| *d = if v > 0.0 { *d } else { 0.0 });
                }
            }
            gradient.reverse();
            gradient
        })
        .collect();
    let mut parts = parts.into_iter();
    let mut sum = parts.next().unwrap_or_default();
    for part in parts {
        for ((w, b), (dw, db)) in sum.iter_mut().zip(&part) {
            *w += dw;
            *b += db;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    fn planted(n: usize) -> (Array2<f32>, Array2<f32>, Vec<f32>) {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let x = Array2::from_shape_fn((n, 3), |_| rng.random::<f32>() * 4.0 - 1.0);
        let t = Array2::from_shape_fn((n, 2), |(i, k)| {
            let (a, b, c) = (x[[i, 0]], x[[i, 1]], x[[i, 2]]);
            if k == 0 { 0.01 * (a - b).abs() } else { 0.02 * (a * c).max(0.5) }
        });
        let weights = (0..n).map(|i| 0.5 + (i % 3) as f32 * 0.5).collect();
        (x, t, weights)
    }

    fn output(layers: &[Layer], x: &Array2<f32>) -> Array2<f32> {
        let mut x = x.clone();
        for (k, layer) in layers.iter().enumerate() {
            x = layer.forward(&x, k + 1 < layers.len());
        }
        x
    }

    fn parameters() -> NetworkParameters {
        NetworkParameters { hidden: vec![24, 16], epochs: 60, batch: 64, rate: 0.01, ..NetworkParameters::default() }
    }

    #[test]
    fn gradients_are_those_of_the_error() {
        let (x, t, weights) = planted(40);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut state: Vec<AdamLayer> = [(5, 3), (4, 5), (2, 4)].map(|(o, i)| AdamLayer::new(o, i, &mut rng)).into();
        let batch: Vec<usize> = (0..40).collect();
        let error = |state: &[AdamLayer]| -> f64 {
            let layers: Vec<Layer> = state.iter().map(|s| s.layer.clone()).collect();
            let e = output(&layers, &x) - &t;
            e.rows().into_iter().zip(&weights).map(|(r, &w)| 0.5 * f64::from(w * r.dot(&r))).sum::<f64>() / 40.0
        };
        let found = network_gradient(&state, &x, &t, &weights, &batch);
        for k in 0..3 {
            for (i, j) in [(0, 0), (1, 2), (1, 1)] {
                let before = state[k].layer.weights[[i, j]];
                let mut at = |v: f32| {
                    state[k].layer.weights[[i, j]] = v;
                    error(&state)
                };
                let slope = (at(before + 1e-2) - at(before - 1e-2)) / 2e-2;
                at(before);
                let got = f64::from(found[k].0[[i, j]]);
                assert!((slope - got).abs() < 2e-2 * (0.05 + slope.abs()), "layer {k}: {slope} {got}");
            }
        }
    }

    #[test]
    fn it_learns_what_no_linear_map_can_and_threads_do_not_matter() {
        let (x, t, weights) = planted(2000);
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut rng = ChaCha8Rng::seed_from_u64(1);
            pool.install(|| {
                fit_layers(x.clone(), t.clone(), &weights, &parameters(), &mut rng, &mut |_| Ok(())).unwrap()
            })
        };
        let layers = run(1);
        let e = output(&layers, &x) - &t;
        let energy = |a: &Array2<f32>| a.iter().map(|v| v * v).sum::<f32>();
        let centred = &t - &t.mean_axis(Axis(0)).unwrap();
        assert!(energy(&e) < 0.02 * energy(&centred), "{} of {}", energy(&e), energy(&centred));
        assert_eq!(layers, run(3));
    }

    #[test]
    fn it_can_be_stopped_and_parameters_are_checked() {
        let (x, t, weights) = planted(200);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let stopped = fit_layers(x, t, &weights, &parameters(), &mut rng, &mut |_| {
            Err(lenslet_core::progress::Interrupted.into())
        });
        assert!(matches!(stopped, Err(Error::Interrupted(_))));
        assert!(parameters().check().is_ok());
        for bad in [
            NetworkParameters { features: vec![60, 3], ..parameters() },
            NetworkParameters { patch: 4, ..parameters() },
            NetworkParameters { hidden: vec![], ..parameters() },
            NetworkParameters { rate: f32::NAN, ..parameters() },
            NetworkParameters { features: vec![1], ..parameters() },
        ] {
            assert!(bad.check().is_err(), "{bad:?}");
        }
    }
}
