//! Joint refinement of Dl and Dh (bilevel, after Yang 2012 and Mairal 2012): min over Dl, Dh of Σ w·½‖Dhᵀφ − t‖², where
//! φ = argmin ½‖y − Dlᵀφ‖² + λ‖φ‖₁ is what eq. (4) will give in use; the gradient goes through φ's active set.
//!
//! On the active set A with G = Dl_A Dl_Aᵀ, e = Dhᵀφ − t, β = G⁻¹ Dh_A e and r = y − Dlᵀφ:
//! ∂/∂Dh = φ eᵀ and ∂/∂Dl_A = β rᵀ − φ_A (Dl_Aᵀβ)ᵀ. Steps are Adam's, with atoms kept unit.

use lenslet_core::sparse::{self, Codes, Penalty};
use ndarray::{Array2, ArrayView2};
use rand::rngs::ChaCha8Rng;
use rayon::prelude::*;

use super::linear::moments;
use super::online::shuffled;
use super::{Error, atoms};

/// Both dictionaries and the state of their steps.
#[derive(Debug, Clone)]
pub struct State {
    /// Dl, K×m, unit rows.
    pub low: Array2<f32>,
    /// Dh, K×p.
    pub high: Array2<f32>,
    /// First and second moments of the gradients of Dl and Dh.
    pub moments: [Array2<f32>; 4],
    /// Steps made.
    pub steps: u64,
}

impl State {
    /// Starts from given dictionaries.
    #[must_use]
    pub fn new(low: Array2<f32>, high: Array2<f32>) -> Self {
        let zero = |a: &Array2<f32>| Array2::zeros(a.dim());
        State { moments: [zero(&low), zero(&low), zero(&high), zero(&high)], low, high, steps: 0 }
    }
}

/// Pairs as training sees them: unit features y, targets t in the same scale, weights.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// N×m.
    pub signals: ArrayView2<'a, f32>,
    /// N×p.
    pub targets: ArrayView2<'a, f32>,
    /// N.
    pub weights: &'a [f32],
    /// λ of the codes.
    pub lambda: f32,
}

/// Pairs whose gradients are summed together; fixed, so that results do not depend on threads.
const CHUNK: usize = 128;

/// Gradient of the weighted error by Dl and Dh, and the error (sum over pairs of w·½‖e‖²), given codes.
#[must_use]
pub fn gradient(
    low: &Array2<f32>,
    high: &Array2<f32>,
    signals: ArrayView2<'_, f32>,
    targets: ArrayView2<'_, f32>,
    weights: &[f32],
    codes: &Codes,
) -> (Array2<f32>, Array2<f32>, f64) {
    let starts: Vec<usize> = (0..signals.nrows()).step_by(CHUNK).collect();
    let mut total = (Array2::<f32>::zeros(low.dim()), Array2::<f32>::zeros(high.dim()), 0.0);
    for group in starts.chunks(8) {
        let parts: Vec<(Array2<f32>, Array2<f32>, f64)> = group
            .par_iter()
            .map(|&first| {
                let mut part = (Array2::zeros(low.dim()), Array2::zeros(high.dim()), 0.0);
                for n in first..(first + CHUNK).min(signals.nrows()) {
                    one(low, high, &signals, &targets, weights[n], codes, n, &mut part);
                }
                part
            })
            .collect();
        for part in parts {
            total.0 += &part.0;
            total.1 += &part.1;
            total.2 += part.2;
        }
    }
    total
}

#[allow(clippy::too_many_arguments)] // the inner loop's own
fn one(
    low: &Array2<f32>,
    high: &Array2<f32>,
    signals: &ArrayView2<'_, f32>,
    targets: &ArrayView2<'_, f32>,
    weight: f32,
    codes: &Codes,
    n: usize,
    part: &mut (Array2<f32>, Array2<f32>, f64),
) {
    let active: Vec<(usize, f32)> = codes.signal(n).collect();
    let mut e = targets.row(n).mapv(|v| -v);
    let mut r = signals.row(n).to_owned();
    for &(k, v) in &active {
        e.scaled_add(v, &high.row(k));
        r.scaled_add(-v, &low.row(k));
    }
    part.2 += 0.5 * f64::from(weight) * f64::from(e.dot(&e));
    let s = active.len();
    if s == 0 || weight == 0.0 {
        return;
    }
    // β by Cholesky with a trace of ridge: nearly parallel atoms must not blow the step up.
    let mut l = vec![0f32; s * s];
    let mut beta: Vec<f32> = active.iter().map(|&(k, _)| high.row(k).dot(&e)).collect();
    for i in 0..s {
        for j in 0..=i {
            let g = low.row(active[i].0).dot(&low.row(active[j].0)) + if i == j { 1e-3 } else { 0.0 };
            let head: f32 = (0..j).map(|q| l[i * s + q] * l[j * s + q]).sum();
            l[i * s + j] = if i == j { (g - head).max(1e-6).sqrt() } else { (g - head) / l[j * s + j] };
        }
    }
    for i in 0..s {
        let head: f32 = (0..i).map(|q| l[i * s + q] * beta[q]).sum();
        beta[i] = (beta[i] - head) / l[i * s + i];
    }
    for i in (0..s).rev() {
        let tail: f32 = (i + 1..s).map(|q| l[q * s + i] * beta[q]).sum();
        beta[i] = (beta[i] - tail) / l[i * s + i];
    }
    let mut back = ndarray::Array1::<f32>::zeros(low.ncols());
    for (&(k, _), &b) in active.iter().zip(&beta) {
        back.scaled_add(b, &low.row(k));
    }
    for (&(k, v), &b) in active.iter().zip(&beta) {
        part.1.row_mut(k).scaled_add(weight * v, &e);
        let mut row = part.0.row_mut(k);
        row.scaled_add(weight * b, &r);
        row.scaled_add(-weight * v, &back);
    }
}

fn codes(low: &Array2<f32>, signals: ArrayView2<'_, f32>, lambda: f32) -> Result<Codes, Error> {
    let prepared = sparse::prepare(low.view())?;
    let options = sparse::Options { penalty: Penalty::Lambda(lambda), tolerance: 1e-4, ..sparse::Options::default() };
    Ok(sparse::solve(&prepared, signals, &options)?)
}

/// One Adam step of size `rate`, relative to the size of the parameter.
fn adam(parameter: &mut Array2<f32>, m: &mut Array2<f32>, v: &mut Array2<f32>, g: &Array2<f32>, rate: f32, step: u64) {
    let size = (parameter.iter().map(|p| p * p).sum::<f32>() / parameter.len() as f32).sqrt();
    let step = step.min(100_000) as i32;
    let (fix1, fix2) = (1.0 - 0.9f32.powi(step), 1.0 - 0.999f32.powi(step));
    ndarray::Zip::from(parameter).and(m).and(v).and(g).for_each(|p, m, v, &g| {
        *m = 0.9 * *m + 0.1 * g;
        *v = 0.999 * *v + 0.001 * g * g;
        *p -= rate * size * (*m / fix1) / ((*v / fix2).sqrt() + 1e-12);
    });
}

/// One epoch over the pairs in random order; the step falls from `rates.0` to `rates.1`. Returns the mean weighted error
/// of the batches as they were met, and the mean number of non-zeros.
///
/// # Errors
/// What the solver reports.
pub fn epoch(
    state: &mut State,
    problem: &Problem<'_>,
    batch: usize,
    rates: (f32, f32),
    rng: &mut ChaCha8Rng,
    step: &mut dyn FnMut(usize) -> Result<(), Error>,
) -> Result<(f64, f64), Error> {
    let order = shuffled(problem.signals.nrows(), rng);
    let count = order.len().div_ceil(batch.max(1));
    let (mut error, mut weight, mut nonzeros) = (0.0, 0.0, 0.0);
    for (i, part) in order.chunks(batch.max(1)).enumerate() {
        let signals = problem.signals.select(ndarray::Axis(0), part);
        let targets = problem.targets.select(ndarray::Axis(0), part);
        let weights: Vec<f32> = part.iter().map(|&n| problem.weights[n]).collect();
        let codes = codes(&state.low, signals.view(), problem.lambda)?;
        nonzeros += codes.nonzeros() as f64 / order.len() as f64;
        let (dl, dh, e) = gradient(&state.low, &state.high, signals.view(), targets.view(), &weights, &codes);
        error += e;
        weight += weights.iter().map(|w| f64::from(*w)).sum::<f64>();
        state.steps += 1;
        let rate = rates.0 + (rates.1 - rates.0) * i as f32 / count as f32;
        let [ml, vl, mh, vh] = &mut state.moments;
        adam(&mut state.low, ml, vl, &dl, rate, state.steps);
        adam(&mut state.high, mh, vh, &dh, rate, state.steps);
        atoms::normalise(&mut state.low);
        step(part.len())?;
    }
    Ok((error / weight.max(1e-30), nonzeros))
}

/// Dh by weighted least squares on the codes that Dl gives (Zeyde 2010): the best Dh for this Dl on these pairs.
///
/// # Errors
/// What the solver reports.
pub fn fit_high(
    low: &Array2<f32>,
    problem: &Problem<'_>,
    step: &mut dyn FnMut(usize) -> Result<(), Error>,
) -> Result<Array2<f32>, Error> {
    const BLOCK: usize = 16_384;
    let (n, k, p) = (problem.signals.nrows(), low.nrows(), problem.targets.ncols());
    let (mut gram, mut right) = (Array2::<f64>::zeros((k, k)), Array2::<f64>::zeros((k, p)));
    for first in (0..n).step_by(BLOCK) {
        let rows = ndarray::s![first..(first + BLOCK).min(n), ..];
        let codes = codes(low, problem.signals.slice(rows), problem.lambda)?;
        let mut dense = Array2::<f32>::zeros((codes.len(), k));
        for i in 0..codes.len() {
            codes.signal(i).for_each(|(j, v)| dense[[i, j]] = v);
        }
        let weights = &problem.weights[first..first + codes.len()];
        gram += &moments(dense.view(), dense.view(), Some(weights));
        right += &moments(dense.view(), problem.targets.slice(rows), Some(weights));
        step(codes.len())?;
    }
    let mean = gram.diag().sum() / k as f64;
    Ok(super::linear::solve(&gram, &right, 1e-3 * mean.max(1e-12))?.mapv(|v| v as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::online::tests::planted;
    use rand::{RngExt, SeedableRng};

    fn error(low: &Array2<f32>, high: &Array2<f32>, p: &Problem<'_>) -> f64 {
        let c = codes(low, p.signals, p.lambda).unwrap();
        gradient(low, high, p.signals, p.targets, p.weights, &c).2
    }

    #[test]
    fn the_gradient_is_the_difference_quotient() {
        let (signals, _) = planted(40, 10, 8, 2, 3);
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut low = atoms::initial(&signals, 10, &mut rng).unwrap();
        low.mapv_inplace(|v| v + 0.2 * (rng.random::<f32>() - 0.5));
        atoms::normalise(&mut low);
        let high = Array2::from_shape_fn((10, 5), |_| rng.random::<f32>() - 0.5);
        let targets = Array2::from_shape_fn((40, 5), |_| rng.random::<f32>() - 0.5);
        let weights = vec![1.0f32; 40];
        let p = Problem { signals: signals.view(), targets: targets.view(), weights: &weights, lambda: 0.2 };
        let c = codes(&low, p.signals, p.lambda).unwrap();
        let (dl, dh, _) = gradient(&low, &high, p.signals, p.targets, p.weights, &c);
        // Along the gradient itself, by Dh and by Dl (tangential, so that atoms stay unit to first order).
        let h = 2e-3 / dh.iter().map(|v| v * v).sum::<f32>().sqrt();
        let quotient =
            (error(&low, &(&high + &(h * &dh)), &p) - error(&low, &(&high - &(h * &dh)), &p)) / f64::from(2.0 * h);
        let square = f64::from(dh.iter().map(|v| v * v).sum::<f32>());
        assert!((quotient / square - 1.0).abs() < 0.02, "{quotient} {square}");
        let mut tangent = dl.clone();
        for (mut t, d) in tangent.rows_mut().into_iter().zip(low.rows()) {
            let along = t.dot(&d);
            t.scaled_add(-along, &d);
        }
        let h = 1e-3 / tangent.iter().map(|v| v * v).sum::<f32>().sqrt();
        let at = |s: f32| {
            let mut moved = &low + &(s * &tangent);
            atoms::normalise(&mut moved);
            error(&moved, &high, &p)
        };
        let quotient = (at(h) - at(-h)) / f64::from(2.0 * h);
        let square = f64::from((&dl * &tangent).sum());
        assert!((quotient / square - 1.0).abs() < 0.1, "{quotient} {square}");
    }

    #[test]
    fn refinement_lowers_the_error() {
        let (signals, _) = planted(3000, 16, 10, 2, 3);
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let map = Array2::from_shape_fn((10, 4), |_| rng.random::<f32>() - 0.5);
        let targets = signals.dot(&map).mapv(|v| v * v.abs());
        let weights = vec![1.0f32; 3000];
        let p = Problem { signals: signals.view(), targets: targets.view(), weights: &weights, lambda: 0.15 };
        let low = atoms::initial(&signals, 16, &mut rng).unwrap();
        let high = fit_high(&low, &p, &mut |_| Ok(())).unwrap();
        let before = error(&low, &high, &p);
        let worse = error(&low, &high.mapv(|v| 1.05 * v), &p);
        assert!(worse > before);
        let mut state = State::new(low, high);
        for _ in 0..6 {
            epoch(&mut state, &p, 100, (0.02, 0.005), &mut rng, &mut |_| Ok(())).unwrap();
        }
        let after = error(&state.low, &state.high, &p);
        assert!(after < 0.8 * before, "{after} {before}");
    }
}
