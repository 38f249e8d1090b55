//! Joint refinement of Dl and Dh (bilevel, after Yang 2012 and Mairal 2012): min over Dl, Dh of Σ w·½‖Dhᵀφ − t‖², where
//! φ = argmin ½‖y − Dlᵀφ‖² + λ‖φ‖₁ is the code of eq. (4); the gradient is taken through φ's active set.
//!
//! On the active set A with G = Dl_A Dl_Aᵀ, e = Dhᵀφ − t, β = G⁻¹ Dh_A e and r = y − Dlᵀφ:
//! ∂/∂Dh = φ eᵀ and ∂/∂Dl_A = β rᵀ − φ_A (Dl_Aᵀβ)ᵀ. Steps are Adam's, with atoms kept unit.

use lenslet_core::linalg::{Cholesky, Par, gram};
use lenslet_core::sparse::{self, Codes, Penalty};
use ndarray::{Array2, ArrayView1, ArrayView2, Axis, Ix2};
use rand::rngs::ChaCha8Rng;
use rayon::prelude::*;

use crate::atoms::normalise_atoms;
use crate::error::Error;
use crate::optimiser::Adam;
use crate::regression::{solve_normal_equations, weighted_gram, weighted_product};
use lenslet_core::random::shuffled_indices;

/// Both dictionaries and the state of their steps.
#[derive(Debug, Clone)]
pub struct RefinementState {
    /// Dl, K×m, unit rows.
    pub low: Array2<f32>,
    /// Dh, K×p.
    pub high: Array2<f32>,
    /// Moments of the gradients of Dl.
    pub low_moments: Adam<Ix2>,
    /// Moments of the gradients of Dh.
    pub high_moments: Adam<Ix2>,
    /// Steps made.
    pub steps: u64,
}

impl RefinementState {
    /// Starts from given dictionaries.
    #[must_use]
    pub fn new(low: Array2<f32>, high: Array2<f32>) -> Self {
        let (low_moments, high_moments) = (Adam::new(low.dim()), Adam::new(high.dim()));
        RefinementState { low, high, low_moments, high_moments, steps: 0 }
    }
}

/// Pairs to fit: unit features y, targets t in the same scale, weights.
#[derive(Debug, Clone, Copy)]
pub struct RefinementProblem<'a> {
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
/// Source: chosen.
const CHUNK: usize = 128;

/// Chunks in work at once: bounds the memory of their gradients.
/// Source: chosen.
const CHUNKS_AT_ONCE: usize = 8;

/// Added to the diagonal of G: nearly parallel atoms would make β arbitrarily large.
/// Source: chosen.
const GRAM_RIDGE: f32 = 1e-3;

/// Ridge of the least squares of Dh, as a share of the mean diagonal of Σ w·φφᵀ.
/// Source: chosen; holds atoms that are hardly used.
const HIGH_RIDGE: f64 = 1e-3;

/// Signals coded at once in the least squares of Dh; bounds the memory of dense codes.
/// Source: chosen.
const CODED_AT_ONCE: usize = 16_384;

/// Added to the root of Adam's second moment.
/// Source: chosen, far below any gradient of a used atom.
const EPSILON: f32 = 1e-12;

/// Stopping tolerance of the codes, relative to the objective.
/// Source: chosen.
const TOLERANCE: f64 = 1e-4;

/// Gradient of the weighted error by Dl and Dh, and the error (sum over pairs of w·½‖e‖²), given codes.
#[must_use]
pub fn bilevel_gradient(
    low: &Array2<f32>,
    high: &Array2<f32>,
    signals: ArrayView2<'_, f32>,
    targets: ArrayView2<'_, f32>,
    weights: &[f32],
    codes: &Codes,
) -> (Array2<f32>, Array2<f32>, f64) {
    let starts: Vec<usize> = (0..signals.nrows()).step_by(CHUNK).collect();
    let mut total = (Array2::<f32>::zeros(low.dim()), Array2::<f32>::zeros(high.dim()), 0.0);
    for group in starts.chunks(CHUNKS_AT_ONCE) {
        let parts: Vec<(Array2<f32>, Array2<f32>, f64)> = group
            .par_iter()
            .map(|&first| {
                let mut part = (Array2::zeros(low.dim()), Array2::zeros(high.dim()), 0.0);
                for n in first..(first + CHUNK).min(signals.nrows()) {
                    add_gradient(low, high, &signals, &targets, weights[n], codes, n, &mut part);
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

/// Adds the gradient and the error of pair `n` to `part`.
#[allow(clippy::too_many_arguments)] // the inner loop
fn add_gradient(
    low: &Array2<f32>,
    high: &Array2<f32>,
    signals: &ArrayView2<'_, f32>,
    targets: &ArrayView2<'_, f32>,
    weight: f32,
    codes: &Codes,
    n: usize,
    part: &mut (Array2<f32>, Array2<f32>, f64),
) {
    let (active, values): (Vec<usize>, Vec<f32>) = codes.signal(n).unzip();
    let (low_active, high_active) = (low.select(Axis(0), &active), high.select(Axis(0), &active));
    let phi = ArrayView1::from(&values);
    let e = high_active.t().dot(&phi) - targets.row(n);
    let r = &signals.row(n) - &low_active.t().dot(&phi);
    part.2 += 0.5 * f64::from(weight) * f64::from(e.dot(&e));
    if active.is_empty() || weight == 0.0 {
        return;
    }
    let mut gram = gram(low_active.t(), Par::Seq);
    gram.diag_mut().mapv_inplace(|v| v + GRAM_RIDGE);
    // A Gram matrix with a ridge is positive definite unless an atom is not finite; such a pair moves nothing.
    let Ok(factor) = Cholesky::new(gram.view()) else { return };
    let beta = factor.solve(high_active.dot(&e).insert_axis(Axis(1)).view()).remove_axis(Axis(1));
    let back = low_active.t().dot(&beta);
    for ((&k, &v), &b) in active.iter().zip(&values).zip(&beta) {
        part.1.row_mut(k).scaled_add(weight * v, &e);
        let mut row = part.0.row_mut(k);
        row.scaled_add(weight * b, &r);
        row.scaled_add(-weight * v, &back);
    }
}

/// The codes of eq. (4).
fn codes_of(low: &Array2<f32>, signals: ArrayView2<'_, f32>, lambda: f32) -> Result<Codes, Error> {
    let prepared = sparse::prepare(low.view())?;
    let options =
        sparse::Options { penalty: Penalty::Lambda(lambda), tolerance: TOLERANCE, ..sparse::Options::default() };
    Ok(sparse::solve(&prepared, signals, &options)?)
}

fn root_mean_square(a: &Array2<f32>) -> f32 {
    (a.iter().map(|p| p * p).sum::<f32>() / a.len() as f32).sqrt()
}

/// One epoch over the pairs in random order; the step falls from `rates.0` to `rates.1`. Returns the mean weighted
/// error of the batches as they were met, and the mean number of non-zeros.
///
/// # Errors
/// Errors of the solver.
pub fn refinement_epoch(
    state: &mut RefinementState,
    problem: &RefinementProblem<'_>,
    batch: usize,
    rates: (f32, f32),
    rng: &mut ChaCha8Rng,
    step: &mut dyn FnMut(usize) -> Result<(), Error>,
) -> Result<(f64, f64), Error> {
    let order = shuffled_indices(problem.signals.nrows(), rng);
    let count = order.len().div_ceil(batch.max(1));
    let (mut error, mut weight, mut nonzeros) = (0.0, 0.0, 0.0);
    for (i, part) in order.chunks(batch.max(1)).enumerate() {
        let signals = problem.signals.select(Axis(0), part);
        let targets = problem.targets.select(Axis(0), part);
        let weights: Vec<f32> = part.iter().map(|&n| problem.weights[n]).collect();
        let codes = codes_of(&state.low, signals.view(), problem.lambda)?;
        nonzeros += codes.nonzeros() as f64 / order.len() as f64;
        let (dl, dh, e) = bilevel_gradient(&state.low, &state.high, signals.view(), targets.view(), &weights, &codes);
        error += e;
        weight += weights.iter().map(|w| f64::from(*w)).sum::<f64>();
        state.steps += 1;
        let rate = rates.0 + (rates.1 - rates.0) * i as f32 / count as f32;
        // Learning rates are relative to the root mean square of the atoms.
        let (low_rate, high_rate) = (rate * root_mean_square(&state.low), rate * root_mean_square(&state.high));
        state.low_moments.step(&mut state.low, &dl, low_rate, EPSILON, state.steps);
        state.high_moments.step(&mut state.high, &dh, high_rate, EPSILON, state.steps);
        normalise_atoms(&mut state.low);
        step(part.len())?;
    }
    Ok((error / weight.max(1e-30), nonzeros))
}

/// Dh by weighted least squares on the codes that Dl gives (Zeyde 2010): the best Dh for this Dl on these pairs.
///
/// # Errors
/// Errors of the solver.
pub fn least_squares_high(
    low: &Array2<f32>,
    problem: &RefinementProblem<'_>,
    step: &mut dyn FnMut(usize) -> Result<(), Error>,
) -> Result<Array2<f32>, Error> {
    let (n, k, p) = (problem.signals.nrows(), low.nrows(), problem.targets.ncols());
    let (mut gram, mut right) = (Array2::<f64>::zeros((k, k)), Array2::<f64>::zeros((k, p)));
    for first in (0..n).step_by(CODED_AT_ONCE) {
        let rows = ndarray::s![first..(first + CODED_AT_ONCE).min(n), ..];
        let codes = codes_of(low, problem.signals.slice(rows), problem.lambda)?;
        let mut dense = Array2::<f32>::zeros((codes.len(), k));
        for i in 0..codes.len() {
            codes.signal(i).for_each(|(j, v)| dense[[i, j]] = v);
        }
        let weights = &problem.weights[first..first + codes.len()];
        gram += &weighted_gram(dense.view(), Some(weights));
        right += &weighted_product(dense.view(), problem.targets.slice(rows), Some(weights));
        step(codes.len())?;
    }
    let mean = gram.diag().sum() / k as f64;
    Ok(solve_normal_equations(&gram, &right, HIGH_RIDGE * mean.max(1e-12))?.mapv(|v| v as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atoms::initial_atoms;
    use crate::planted::planted_signals;
    use rand::{RngExt, SeedableRng};

    fn error(low: &Array2<f32>, high: &Array2<f32>, p: &RefinementProblem<'_>) -> f64 {
        let c = codes_of(low, p.signals, p.lambda).unwrap();
        bilevel_gradient(low, high, p.signals, p.targets, p.weights, &c).2
    }

    #[test]
    fn the_gradient_is_the_difference_quotient() {
        let (signals, _) = planted_signals(40, 10, 8, 2, 3);
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut low = initial_atoms(&signals, 10, &mut rng).unwrap();
        low.mapv_inplace(|v| v + 0.2 * (rng.random::<f32>() - 0.5));
        normalise_atoms(&mut low);
        let high = Array2::from_shape_fn((10, 5), |_| rng.random::<f32>() - 0.5);
        let targets = Array2::from_shape_fn((40, 5), |_| rng.random::<f32>() - 0.5);
        let weights = vec![1.0f32; 40];
        let p = RefinementProblem { signals: signals.view(), targets: targets.view(), weights: &weights, lambda: 0.2 };
        let c = codes_of(&low, p.signals, p.lambda).unwrap();
        let (dl, dh, _) = bilevel_gradient(&low, &high, p.signals, p.targets, p.weights, &c);
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
            normalise_atoms(&mut moved);
            error(&moved, &high, &p)
        };
        let quotient = (at(h) - at(-h)) / f64::from(2.0 * h);
        let square = f64::from((&dl * &tangent).sum());
        assert!((quotient / square - 1.0).abs() < 0.1, "{quotient} {square}");
    }

    #[test]
    fn refinement_lowers_the_error() {
        let (signals, _) = planted_signals(3000, 16, 10, 2, 3);
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let map = Array2::from_shape_fn((10, 4), |_| rng.random::<f32>() - 0.5);
        let targets = signals.dot(&map).mapv(|v| v * v.abs());
        let weights = vec![1.0f32; 3000];
        let p = RefinementProblem { signals: signals.view(), targets: targets.view(), weights: &weights, lambda: 0.15 };
        let low = initial_atoms(&signals, 16, &mut rng).unwrap();
        let high = least_squares_high(&low, &p, &mut |_| Ok(())).unwrap();
        let before = error(&low, &high, &p);
        let worse = error(&low, &high.mapv(|v| 1.05 * v), &p);
        assert!(worse > before);
        let mut state = RefinementState::new(low, high);
        for _ in 0..6 {
            refinement_epoch(&mut state, &p, 100, (0.02, 0.005), &mut rng, &mut |_| Ok(())).unwrap();
        }
        let after = error(&state.low, &state.high, &p);
        assert!(after < 0.8 * before, "{after} {before}");
    }
}
