//! Online dictionary learning (Mairal 2009) and its batch twin: min over D, α of Σ ½‖x − Dᵀα‖² + λ‖α‖₁ with unit atoms.
//!
//! Only the statistics A = Σ ααᵀ (K×K) and B = Σ αxᵀ (K×m) are kept, so more data does not mean more memory.

use lenslet_core::sparse::{self, Codes, Penalty, Solver};
use ndarray::{Array2, ArrayView2, s};
use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use rayon::prelude::*;

use super::statistics::{gather, sweep};
use super::{Error, atoms};

/// Atoms and what was gathered about them.
#[derive(Debug, Clone)]
pub struct State {
    /// K×m, unit rows.
    pub atoms: Array2<f32>,
    /// Σ ααᵀ, K×K, older batches fading.
    pub a: Array2<f64>,
    /// Σ αxᵀ, K×m, older batches fading.
    pub b: Array2<f64>,
    /// Batches seen.
    pub batches: u64,
}

impl State {
    /// Starts from given unit atoms.
    #[must_use]
    pub fn new(atoms: Array2<f32>) -> Self {
        let (k, m) = atoms.dim();
        State { atoms, a: Array2::zeros((k, k)), b: Array2::zeros((k, m)), batches: 0 }
    }
}

/// What an epoch came to.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Summary {
    /// Mean objective a signal, codes and atoms as they were when each batch was coded.
    pub objective: f64,
    /// Mean number of non-zeros a signal.
    pub nonzeros: f64,
    /// Atoms replaced.
    pub replaced: usize,
}

/// How fast old batches fade: batch t multiplies what was there by (1 − 1/t)^FADE, so that about the last eighth of all
/// batches counts. Codes of early atoms are poor; on natural patches 6 to 12 do about equally well, 1 to 2 far worse.
const FADE: i32 = 8;

/// Codes signals and returns them with their mean objective.
///
/// # Errors
/// What the solver reports.
pub fn code(
    atoms: &Array2<f32>,
    signals: ArrayView2<'_, f32>,
    lambda: f32,
    solver: Solver,
) -> Result<(Codes, f64), Error> {
    let prepared = sparse::prepare(atoms.view())?;
    let options =
        sparse::Options { solver, penalty: Penalty::Lambda(lambda), tolerance: 1e-4, ..sparse::Options::default() };
    let codes = sparse::solve(&prepared, signals, &options)?;
    let objectives = objectives(&codes, atoms, signals, lambda);
    let mean = objectives.iter().sum::<f64>() / objectives.len().max(1) as f64;
    Ok((codes, mean))
}

/// ½‖x − Dᵀα‖² + λ‖α‖₁ of every signal, residuals in f32.
fn objectives(codes: &Codes, atoms: &Array2<f32>, signals: ArrayView2<'_, f32>, lambda: f32) -> Vec<f64> {
    let m = atoms.ncols();
    let (atoms, signals) = (atoms.as_standard_layout(), signals.as_standard_layout());
    let (Some(atoms), Some(signals)) = (atoms.as_slice(), signals.as_slice()) else { return Vec::new() };
    let one = |rest: &mut Vec<f32>, (n, signal): (usize, &[f32])| {
        rest.clear();
        rest.extend_from_slice(signal);
        let mut size = 0.0;
        for (k, v) in codes.signal(n) {
            rest.iter_mut().zip(&atoms[k * m..(k + 1) * m]).for_each(|(r, d)| *r -= v * d);
            size += f64::from(v.abs());
        }
        0.5 * f64::from(rest.iter().map(|r| r * r).sum::<f32>()) + f64::from(lambda) * size
    };
    signals.par_chunks(m).enumerate().with_min_len(64).map_init(Vec::new, one).collect()
}

/// One epoch in random order: batches of `batch` signals, after each the atoms follow the faded statistics.
///
/// # Errors
/// What the solver reports.
pub fn epoch(
    state: &mut State,
    signals: ArrayView2<'_, f32>,
    lambda: f32,
    batch: usize,
    rng: &mut ChaCha8Rng,
    step: &mut dyn FnMut(usize) -> Result<(), Error>,
) -> Result<Summary, Error> {
    let order = shuffled(signals.nrows(), rng);
    let mut summary = Summary::default();
    let mut uses = vec![0u64; state.atoms.nrows()];
    for part in order.chunks(batch.max(1)) {
        let chosen = signals.select(ndarray::Axis(0), part);
        let (codes, objective) = code(&state.atoms, chosen.view(), lambda, Solver::Auto)?;
        summary.objective += objective * part.len() as f64 / order.len() as f64;
        summary.nonzeros += codes.nonzeros() as f64 / order.len() as f64;
        state.batches += 1;
        let fade = (1.0 - 1.0 / state.batches as f64).powi(FADE);
        gather(&codes, chosen.view(), fade, &mut state.a, &mut state.b, &mut uses);
        sweep(&mut state.atoms, &state.a, &state.b);
        step(part.len())?;
    }
    summary.replaced = renew(state, &uses, signals, rng);
    Ok(summary)
}

/// One epoch of the batch method (`ista`): proximal gradient codes of all signals, then sweeps over the atoms on exactly
/// their statistics. The mean objective never rises from one epoch to the next, but for replaced coherent atoms.
///
/// # Errors
/// What the solver reports.
pub fn batch_epoch(
    state: &mut State,
    signals: ArrayView2<'_, f32>,
    lambda: f32,
    rng: &mut ChaCha8Rng,
    step: &mut dyn FnMut(usize) -> Result<(), Error>,
) -> Result<Summary, Error> {
    let n = signals.nrows();
    let mut summary = Summary::default();
    let mut uses = vec![0u64; state.atoms.nrows()];
    state.a.fill(0.0);
    state.b.fill(0.0);
    for first in (0..n).step_by(8192) {
        let part = signals.slice(s![first..(first + 8192).min(n), ..]);
        let (codes, objective) = code(&state.atoms, part, lambda, Solver::Ista)?;
        summary.objective += objective * part.nrows() as f64 / n as f64;
        summary.nonzeros += codes.nonzeros() as f64 / n as f64;
        gather(&codes, part, 1.0, &mut state.a, &mut state.b, &mut uses);
        step(part.nrows())?;
    }
    for _ in 0..5 {
        sweep(&mut state.atoms, &state.a, &state.b);
    }
    state.batches += 1;
    summary.replaced = renew(state, &uses, signals, rng);
    Ok(summary)
}

/// Replaces weak atoms by random signals and forgets what was known of them.
fn renew(state: &mut State, uses: &[u64], signals: ArrayView2<'_, f32>, rng: &mut ChaCha8Rng) -> usize {
    let weak = atoms::weak(&state.atoms, uses, 1);
    for &k in &weak {
        let row = signals.row(rng.random_range(0..signals.nrows()));
        if atoms::replace(&mut state.atoms, k, row) {
            state.a.row_mut(k).fill(0.0);
            state.a.column_mut(k).fill(0.0);
            state.b.row_mut(k).fill(0.0);
        }
    }
    weak.len()
}

/// 0..n in random order (Fisher and Yates).
#[must_use]
pub fn shuffled(n: usize, rng: &mut ChaCha8Rng) -> Vec<usize> {
    let mut order: Vec<usize> = (0..n).collect();
    for i in (1..n).rev() {
        order.swap(i, rng.random_range(0..=i));
    }
    order
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use rand::SeedableRng;

    /// Signals of `nonzeros` planted atoms each, and the atoms.
    pub(crate) fn planted(n: usize, k: usize, m: usize, nonzeros: usize, seed: u64) -> (Array2<f32>, Array2<f32>) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut truth = Array2::from_shape_fn((k, m), |_| rng.random::<f32>() - 0.5);
        atoms::normalise(&mut truth);
        let mut signals = Array2::zeros((n, m));
        for mut row in signals.rows_mut() {
            for _ in 0..nonzeros {
                let v = (0.5 + rng.random::<f32>()) * if rng.random::<bool>() { 1.0 } else { -1.0 };
                row.scaled_add(v, &truth.row(rng.random_range(0..k)));
            }
        }
        (signals, truth)
    }

    /// The part of the planted atoms that were found, |cosine| above 0.95.
    pub(crate) fn found(atoms: &Array2<f32>, truth: &Array2<f32>) -> f64 {
        let products = truth.dot(&atoms.t());
        let hits = products.rows().into_iter().filter(|r| r.iter().any(|v| v.abs() > 0.95)).count();
        hits as f64 / truth.nrows() as f64
    }

    #[test]
    fn planted_atoms_are_recovered_online() {
        let (signals, truth) = planted(6000, 24, 16, 2, 5);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut state = State::new(atoms::initial(&signals, 24, &mut rng).unwrap());
        let first = epoch(&mut state, signals.view(), 0.15, 200, &mut rng, &mut |_| Ok(())).unwrap();
        for _ in 0..12 {
            epoch(&mut state, signals.view(), 0.15, 200, &mut rng, &mut |_| Ok(())).unwrap();
        }
        let last = epoch(&mut state, signals.view(), 0.15, 200, &mut rng, &mut |_| Ok(())).unwrap();
        assert!(last.objective < 0.95 * first.objective, "{} {}", last.objective, first.objective);
        let part = found(&state.atoms, &truth);
        assert!(part >= 0.85, "{part}");
    }

    #[test]
    fn batch_objective_never_rises() {
        let (signals, _) = planted(1500, 20, 12, 3, 8);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut state = State::new(atoms::initial(&signals, 20, &mut rng).unwrap());
        let mut last = f64::INFINITY;
        for _ in 0..12 {
            let now = batch_epoch(&mut state, signals.view(), 0.1, &mut rng, &mut |_| Ok(())).unwrap();
            assert!(now.objective <= last * (1.0 + 1e-4) || now.replaced > 0, "{} after {last}", now.objective);
            last = now.objective;
        }
        let start =
            code(&atoms::initial(&signals, 20, &mut rng).unwrap(), signals.view(), 0.1, Solver::Auto).unwrap().1;
        assert!(last < 0.95 * start);
    }

    #[test]
    fn an_epoch_is_the_same_on_any_number_of_threads() {
        let (signals, _) = planted(1200, 20, 12, 3, 8);
        let run = |threads| {
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
                let mut rng = ChaCha8Rng::seed_from_u64(1);
                let mut state = State::new(atoms::initial(&signals, 20, &mut rng).unwrap());
                epoch(&mut state, signals.view(), 0.1, 300, &mut rng, &mut |_| Ok(())).unwrap();
                state.atoms
            })
        };
        assert_eq!(run(1), run(3));
    }
}
