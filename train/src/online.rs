//! Online dictionary learning (Mairal 2009) and its batch twin: min over D, α of Σ ½‖x − Dᵀα‖² + λ‖α‖₁ with unit atoms.
//!
//! Only the statistics A = Σ ααᵀ (K×K) and B = Σ αxᵀ (K×m) are kept, so more data does not mean more memory.

use lenslet_core::sparse::{self, Codes, Penalty, Solver};
use ndarray::{Array2, ArrayView2, s};
use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use rayon::prelude::*;

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

/// How fast old batches fade: batch t multiplies what was there by (1 − 1/t)^FADE.
const FADE: i32 = 2;
/// Signals whose statistics are summed together; fixed, so that results do not depend on threads.
const CHUNK: usize = 256;

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
    let objectives: Vec<f64> = (0..signals.nrows())
        .into_par_iter()
        .map(|n| {
            let mut rest = signals.row(n).to_owned();
            let mut size = 0.0;
            for (k, v) in codes.signal(n) {
                rest.scaled_add(-v, &atoms.row(k));
                size += f64::from(v.abs());
            }
            0.5 * f64::from(rest.dot(&rest)) + f64::from(lambda) * size
        })
        .collect();
    let mean = objectives.iter().sum::<f64>() / objectives.len().max(1) as f64;
    Ok((codes, mean))
}

/// Adds Σ ααᵀ, Σ αxᵀ and the uses of each atom over the coded signals.
fn gather(codes: &Codes, signals: ArrayView2<'_, f32>, a: &mut Array2<f64>, b: &mut Array2<f64>, uses: &mut [u64]) {
    let (k, m) = b.dim();
    let starts: Vec<usize> = (0..signals.nrows()).step_by(CHUNK).collect();
    for group in starts.chunks(8) {
        let parts: Vec<(Vec<f32>, Vec<f32>)> = group
            .par_iter()
            .map(|&first| {
                let (mut a, mut b) = (vec![0f32; k * k], vec![0f32; k * m]);
                for n in first..(first + CHUNK).min(signals.nrows()) {
                    let x = signals.row(n);
                    for (i, u) in codes.signal(n) {
                        for (j, v) in codes.signal(n) {
                            a[i * k + j] += u * v;
                        }
                        for (o, v) in b[i * m..(i + 1) * m].iter_mut().zip(x) {
                            *o += u * v;
                        }
                    }
                }
                (a, b)
            })
            .collect();
        for (pa, pb) in parts {
            a.iter_mut().zip(&pa).for_each(|(t, p)| *t += f64::from(*p));
            b.iter_mut().zip(&pb).for_each(|(t, p)| *t += f64::from(*p));
        }
    }
    for &k in &codes.atoms {
        uses[k as usize] += 1;
    }
}

/// One sweep of block coordinate descent on the atoms: each goes to its minimum within the unit ball, the others fixed.
/// Atoms without use stay. At the end all are made unit, which can only lower the objective once codes follow.
pub fn update(atoms: &mut Array2<f32>, a: &Array2<f64>, b: &Array2<f64>) {
    let k = atoms.nrows();
    let a32 = a.mapv(|v| v as f32);
    for j in 0..k {
        let weight = a[[j, j]];
        if !(weight > 1e-9) {
            continue;
        }
        let mut u = atoms.t().dot(&a32.row(j));
        let inverse = (1.0 / weight) as f32;
        for ((u, b), d) in u.iter_mut().zip(b.row(j)).zip(atoms.row(j)) {
            *u = (*b as f32 - *u) * inverse + d;
        }
        let norm = u.dot(&u).sqrt();
        if !(norm > 1e-12 && norm.is_finite()) {
            continue;
        }
        atoms.row_mut(j).assign(&u.mapv(|v| v / norm.max(1.0)));
    }
    atoms::normalise(atoms);
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
        state.a *= fade;
        state.b *= fade;
        gather(&codes, chosen.view(), &mut state.a, &mut state.b, &mut uses);
        update(&mut state.atoms, &state.a, &state.b);
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
        gather(&codes, part, &mut state.a, &mut state.b, &mut uses);
        step(part.nrows())?;
    }
    for _ in 0..5 {
        update(&mut state.atoms, &state.a, &state.b);
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
        assert!(last.objective < 0.9 * first.objective);
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
