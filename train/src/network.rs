//! Fitting of the network of [`lenslet_core::dictionary::Network`]: min Σ w·½‖o(x) − t‖² over pairs, x and t as
//! [`lenslet_core::dictionary::network_inputs`] gives and divides them, by Adam (Kingma 2015) on shuffled batches, the step falling as
//! half a cosine. Rectified layers begin as He (2015) has it.

use lenslet_core::dictionary::{Layer, Network, network_inputs};
use lenslet_core::interpolation::Interpolation;
use lenslet_core::linalg::{Par, product};
use lenslet_data_gen::pairs::{self, Crop, PatchOptions};
use ndarray::{Array1, Array2, Axis, concatenate};
use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::Error;
use super::online::shuffled;

/// Parameters of a network and of its fitting.
///
/// | name | default | purpose | range |
/// |---|---|---|---|
/// | `beside` | none | images of the view beside the low one: barycentric, cubic; only where the caller makes them | |
/// | `features` | \[60\] | principal components kept of the low image, then of each image beside it | 2 … (window+4)² − 1 |
/// | `window` | 9 | side of the window whose gradients are features | odd, 3 … 25 |
/// | `patch` | 5 | side of a residual patch | odd, 3 … window + 4 |
/// | `hidden` | \[256, 128\] | outputs of each hidden layer | one to four of 1 … 4096 |
/// | `epochs` | 14 | passes over the pairs | 1 … 1000 |
/// | `batch` | 512 | pairs a step | 16 … 65536 |
/// | `rate` | 0.001 | first step | 0 … 1 |
/// | `pairs` | 400 000 | training pairs | 100 … 20 000 000 |
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)] // the table above says it
pub struct NetworkParameters {
    pub beside: Vec<Interpolation>,
    pub features: Vec<usize>,
    pub window: usize,
    pub patch: usize,
    pub hidden: Vec<usize>,
    pub epochs: usize,
    pub batch: usize,
    pub rate: f32,
    pub pairs: usize,
}

impl Default for NetworkParameters {
    fn default() -> Self {
        NetworkParameters {
            beside: Vec::new(),
            features: vec![60],
            window: 9,
            patch: 5,
            hidden: vec![256, 128],
            epochs: 14,
            batch: 512,
            rate: 0.001,
            pairs: 400_000,
        }
    }
}

impl NetworkParameters {
    /// Checks every range of the table.
    ///
    /// # Errors
    /// [`Error::Parameter`] with the name and the value.
    pub fn check(&self) -> Result<(), Error> {
        let wrong = |what: String| Err(Error::Parameter(format!("network: {what}")));
        let odd = |n: usize, least: usize, most: usize| n % 2 == 1 && (least..=most).contains(&n);
        if !odd(self.window, 3, 25) || !odd(self.patch, 3, self.window + 4) {
            return wrong(format!("window {} or patch {} is out of range", self.window, self.patch));
        }
        if self.features.len() != self.beside.len() + 1 {
            return wrong(format!("features {:?} of {} images", self.features, self.beside.len() + 1));
        }
        if self.features.iter().any(|f| !(2..(self.window + 4).pow(2)).contains(f)) {
            return wrong(format!("features {:?} are out of range", self.features));
        }
        if !(1..=4).contains(&self.hidden.len()) || self.hidden.iter().any(|h| !(1..=4096).contains(h)) {
            return wrong(format!("hidden layers {:?} are out of range", self.hidden));
        }
        if !(1..=1000).contains(&self.epochs) || !(16..=65_536).contains(&self.batch) {
            return wrong(format!("epochs {} or batch {} is out of range", self.epochs, self.batch));
        }
        if !(0.0..=1.0).contains(&self.rate) || !(100..=20_000_000).contains(&self.pairs) {
            return wrong(format!("rate {} or pairs {} is out of range", self.rate, self.pairs));
        }
        Ok(())
    }
}

/// Smallest norm that features are divided by; flatter patches do not train.
const FLOOR: f32 = 0.02;

/// Pairs whose gradients are summed together; fixed, so that results do not depend on threads.
const CHUNK: usize = 128;

/// Learns a network on crops: filters, then layers. `emphasis` as in [`super::Parameters`]; at most `most` pairs; `step` hears of every
/// batch.
///
/// # Errors
/// Too few textured patches, crops without the images wanted beside the low one, what `step` returns.
pub fn learn(
    crops: &[Crop],
    parameters: &NetworkParameters,
    emphasis: f32,
    most: usize,
    seed: u64,
    rng: &mut ChaCha8Rng,
    step: &mut dyn FnMut(usize) -> Result<(), Error>,
) -> Result<Network, Error> {
    let p = parameters;
    if crops.iter().any(|c| c.beside.len() < p.beside.len()) {
        return Err(Error::Parameter("network: only captures of one's own have images beside the low one".into()));
    }
    let support = p.window + 4;
    let mut filters = vec![pairs::learn_filters(crops, p.window, p.features[0])?.0];
    for (which, &count) in p.features[1..].iter().enumerate() {
        filters.push(pairs::learn_beside(crops, which, support, count)?.0);
    }
    let filters: Vec<_> = filters.iter().map(|f| f.view()).collect();
    let filters = concatenate(Axis(0), &filters).map_err(|e| Error::Parameter(e.to_string()))?;
    let options = PatchOptions {
        patch: p.patch,
        window: p.window,
        per_crop: p.pairs.min(most).div_ceil(crops.len().max(1)),
        flat: FLOOR,
        twins: true,
        seed,
        ..PatchOptions::default()
    };
    let pairs::Pairs { features, mut residuals, .. } = pairs::pairs_beside(crops, &filters, &p.features, &options)?;
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
    let layers = fit(x, residuals, &weights, p, rng, step)?;
    let (side_inputs, filters_per_input) = (p.beside.clone(), p.features.clone());
    Ok(Network { support, side_inputs, filters_per_input, filters, floor: FLOOR, layers })
}

/// Layers fitted to inputs (N×(m+1)) and targets (N×patch²).
///
/// # Errors
/// What `step` returns.
pub fn fit(
    mut x: Array2<f32>,
    mut t: Array2<f32>,
    weights: &[f32],
    parameters: &NetworkParameters,
    rng: &mut ChaCha8Rng,
    step: &mut dyn FnMut(usize) -> Result<(), Error>,
) -> Result<Vec<Layer>, Error> {
    // Inputs and targets of one size; the layers take it over at the end.
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
    let mut state: Vec<Stepped> = sizes.windows(2).map(|s| Stepped::new(s[1], s[0], rng)).collect();
    let batches = x.nrows().div_ceil(parameters.batch);
    let total = (parameters.epochs * batches) as f32;
    let mut done = 0;
    for _ in 0..parameters.epochs {
        for part in shuffled(x.nrows(), rng).chunks(parameters.batch) {
            let gradient = gradient(&state, &x, &t, weights, part);
            let fall = 0.02 + 0.98 * 0.5 * (1.0 + (std::f32::consts::PI * done as f32 / total).cos());
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
struct Stepped {
    layer: Layer,
    weights: [Array2<f32>; 2],
    bias: [Array1<f32>; 2],
}

impl Stepped {
    fn new(outputs: usize, inputs: usize, rng: &mut ChaCha8Rng) -> Self {
        let size = (2.0 / inputs as f64).sqrt();
        let weights = Array2::from_shape_fn((outputs, inputs), |_| (size * normal(rng)) as f32);
        let zero = Array2::zeros(weights.dim());
        let bias = Array1::zeros(outputs);
        Stepped { weights: [zero.clone(), zero], bias: [bias.clone(), bias.clone()], layer: Layer { weights, bias } }
    }

    fn step(&mut self, weights: &Array2<f32>, bias: &Array1<f32>, rate: f32, step: usize) {
        let step = step.min(100_000) as i32;
        let fix = [1.0 - 0.9f32.powi(step), 1.0 - 0.999f32.powi(step)];
        let one = |p: &mut f32, m: &mut f32, v: &mut f32, &g: &f32| {
            *m = 0.9 * *m + 0.1 * g;
            *v = 0.999 * *v + 0.001 * g * g;
            *p -= rate * (*m / fix[0]) / ((*v / fix[1]).sqrt() + 1e-8);
        };
        let [m, v] = &mut self.weights;
        ndarray::Zip::from(&mut self.layer.weights).and(m).and(v).and(weights).for_each(one);
        let [m, v] = &mut self.bias;
        ndarray::Zip::from(&mut self.layer.bias).and(m).and(v).and(bias).for_each(one);
    }
}

/// Standard normal deviate (Box and Muller's way).
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (u, v) = (1.0 - rng.random::<f64>(), rng.random::<f64>());
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

type Gradient = Vec<(Array2<f32>, Array1<f32>)>;

/// Mean gradient of the weighted error over the pairs of a batch.
fn gradient(state: &[Stepped], x: &Array2<f32>, t: &Array2<f32>, weights: &[f32], batch: &[usize]) -> Gradient {
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
    use rand::SeedableRng;

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
        let mut state: Vec<Stepped> = [(5, 3), (4, 5), (2, 4)].map(|(o, i)| Stepped::new(o, i, &mut rng)).into();
        let batch: Vec<usize> = (0..40).collect();
        let error = |state: &[Stepped]| -> f64 {
            let layers: Vec<Layer> = state.iter().map(|s| s.layer.clone()).collect();
            let e = output(&layers, &x) - &t;
            e.rows().into_iter().zip(&weights).map(|(r, &w)| 0.5 * f64::from(w * r.dot(&r))).sum::<f64>() / 40.0
        };
        let found = gradient(&state, &x, &t, &weights, &batch);
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
            pool.install(|| fit(x.clone(), t.clone(), &weights, &parameters(), &mut rng, &mut |_| Ok(())).unwrap())
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
        let stopped = fit(x, t, &weights, &parameters(), &mut rng, &mut |_| Err(Error::Interrupted));
        assert!(matches!(stopped, Err(Error::Interrupted)));
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
