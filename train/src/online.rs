//! Online dictionary learning (Mairal 2009) and its batch twin: min over D, α of Σ ½‖x − Dᵀα‖² + λ‖α‖₁ with unit atoms.
//!
//! Only the statistics A = Σ ααᵀ (K×K) and B = Σ αxᵀ (K×m) are kept, so more data does not mean more memory.

use lenslet_core::sparse::{self, Codes, Penalty, Solver};
use ndarray::{Array2, ArrayView2, s};
use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use rayon::prelude::*;

use crate::atoms::{atoms_to_replace, replace_atom};
use crate::error::Error;
use crate::statistics::{accumulate_statistics, update_atoms};
use crate::trace::EpochSummary;
use lenslet_core::random::shuffled_indices;

/// Atoms and their statistics.
#[derive(Debug, Clone)]
pub struct OnlineState {
    /// K×m, unit rows.
    pub atoms: Array2<f32>,
    /// Σ ααᵀ, K×K, older batches fading.
    pub a: Array2<f64>,
    /// Σ αxᵀ, K×m, older batches fading.
    pub b: Array2<f64>,
    /// Batches seen.
    pub batches: u64,
}

impl OnlineState {
    /// Starts from given unit atoms.
    #[must_use]
    pub fn new(atoms: Array2<f32>) -> Self {
        let (k, m) = atoms.dim();
        OnlineState { atoms, a: Array2::zeros((k, k)), b: Array2::zeros((k, m)), batches: 0 }
    }
}

/// How fast old batches fade: batch t multiplies the statistics by (1 − 1/t)^FADE, so that about the last eighth of all
/// batches counts (ρ of Mairal 2010, section 3.4.2). Codes of early atoms are poor.
/// Source: chosen; on natural patches results are insensitive between 6 and 12, far worse at 1 to 2.
const FADE: i32 = 8;

/// Signals coded at once by the batch method; bounds the memory of dense work.
/// Source: chosen.
const CODED_AT_ONCE: usize = 8192;

/// Sweeps over the atoms on the statistics of one epoch of the batch method.
/// Source: chosen.
const SWEEPS: usize = 5;

/// Stopping tolerance of the codes, relative to the objective.
/// Source: chosen; atoms move by far more from batch to batch.
const TOLERANCE: f64 = 1e-4;

/// The codes of signals (N×m) by K unit atoms, min over α of ½‖x − Dᵀα‖² + λ‖α‖₁, and their mean objective.
///
/// # Errors
/// Errors of the solver.
pub fn sparse_code(
    atoms: &Array2<f32>,
    signals: ArrayView2<'_, f32>,
    lambda: f32,
    solver: Solver,
) -> Result<(Codes, f64), Error> {
    let prepared = sparse::prepare(atoms.view())?;
    let options = sparse::Options {
        solver,
        penalty: Penalty::Lambda(lambda),
        tolerance: TOLERANCE,
        ..sparse::Options::default()
    };
    let codes = sparse::solve(&prepared, signals, &options)?;
    let objectives = objectives(&codes, atoms, signals, lambda);
    let mean = objectives.iter().sum::<f64>() / objectives.len().max(1) as f64;
    Ok((codes, mean))
}

/// ½‖x − Dᵀα‖² + λ‖α‖₁ of every signal, residuals in f32: [`Codes::objectives`] at half the time.
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

/// One epoch over signals (N×m) in random order: after each batch of `batch` signals the atoms are updated on the faded
/// statistics. `step` is called with the size of each batch.
///
/// # Errors
/// Errors of the solver, errors of `step`.
///
/// ```
/// use lenslet_train::online::{OnlineState, online_epoch};
/// use ndarray::Array2;
/// use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};
/// let mut rng = ChaCha8Rng::seed_from_u64(1);
/// // Multiples of the two axes; the first atoms lie between them.
/// let signals = Array2::from_shape_fn((400, 2), |(n, j)| if n % 2 == j { 0.5 + rng.random::<f32>() } else { 0.0 });
/// let mut state = OnlineState::new(ndarray::array![[0.8, 0.6], [0.6, 0.8]]);
/// for _ in 0..3 {
///     online_epoch(&mut state, signals.view(), 0.1, 50, &mut rng, &mut |_| Ok(()))?;
/// }
/// assert!(state.atoms[[0, 0]] > 0.99 && state.atoms[[1, 1]] > 0.99);
/// # Ok::<(), lenslet_train::Error>(())
/// ```
pub fn online_epoch(
    state: &mut OnlineState,
    signals: ArrayView2<'_, f32>,
    lambda: f32,
    batch: usize,
    rng: &mut ChaCha8Rng,
    step: &mut dyn FnMut(usize) -> Result<(), Error>,
) -> Result<EpochSummary, Error> {
    let order = shuffled_indices(signals.nrows(), rng);
    let mut summary = EpochSummary::default();
    let mut uses = vec![0u64; state.atoms.nrows()];
    for part in order.chunks(batch.max(1)) {
        let chosen = signals.select(ndarray::Axis(0), part);
        let (codes, objective) = sparse_code(&state.atoms, chosen.view(), lambda, Solver::Auto)?;
        summary.objective += objective * part.len() as f64 / order.len() as f64;
        summary.nonzeros += codes.nonzeros() as f64 / order.len() as f64;
        state.batches += 1;
        let fade = (1.0 - 1.0 / state.batches as f64).powi(FADE);
        accumulate_statistics(&codes, chosen.view(), fade, &mut state.a, &mut state.b, &mut uses);
        update_atoms(&mut state.atoms, &state.a, &state.b);
        step(part.len())?;
    }
    summary.replaced = replace_atoms(state, &uses, signals, rng);
    Ok(summary)
}

/// One epoch of the batch method (`ista`): proximal gradient codes of all signals, then sweeps over the atoms on
/// exactly their statistics. The mean objective never rises from one epoch to the next, but for replaced coherent
/// atoms.
///
/// # Errors
/// Errors of the solver.
pub fn batch_epoch(
    state: &mut OnlineState,
    signals: ArrayView2<'_, f32>,
    lambda: f32,
    rng: &mut ChaCha8Rng,
    step: &mut dyn FnMut(usize) -> Result<(), Error>,
) -> Result<EpochSummary, Error> {
    let n = signals.nrows();
    let mut summary = EpochSummary::default();
    let mut uses = vec![0u64; state.atoms.nrows()];
    state.a.fill(0.0);
    state.b.fill(0.0);
    for first in (0..n).step_by(CODED_AT_ONCE) {
        let part = signals.slice(s![first..(first + CODED_AT_ONCE).min(n), ..]);
        let (codes, objective) = sparse_code(&state.atoms, part, lambda, Solver::Ista)?;
        summary.objective += objective * part.nrows() as f64 / n as f64;
        summary.nonzeros += codes.nonzeros() as f64 / n as f64;
        accumulate_statistics(&codes, part, 1.0, &mut state.a, &mut state.b, &mut uses);
        step(part.nrows())?;
    }
    for _ in 0..SWEEPS {
        update_atoms(&mut state.atoms, &state.a, &state.b);
    }
    state.batches += 1;
    summary.replaced = replace_atoms(state, &uses, signals, rng);
    Ok(summary)
}

/// Replaces unused and coherent atoms by random signals, and sets their statistics to zero.
fn replace_atoms(state: &mut OnlineState, uses: &[u64], signals: ArrayView2<'_, f32>, rng: &mut ChaCha8Rng) -> usize {
    let chosen = atoms_to_replace(&state.atoms, uses, 1);
    for &k in &chosen {
        let row = signals.row(rng.random_range(0..signals.nrows()));
        if replace_atom(&mut state.atoms, k, row) {
            state.a.row_mut(k).fill(0.0);
            state.a.column_mut(k).fill(0.0);
            state.b.row_mut(k).fill(0.0);
        }
    }
    chosen.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atoms::initial_atoms;
    use crate::planted::{found_share, planted_signals};
    use rand::SeedableRng;

    #[test]
    fn planted_atoms_are_recovered_online() {
        let (signals, truth) = planted_signals(6000, 24, 16, 2, 5);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut state = OnlineState::new(initial_atoms(&signals, 24, &mut rng).unwrap());
        let before = found_share(&state.atoms, &truth);
        let first = online_epoch(&mut state, signals.view(), 0.15, 200, &mut rng, &mut |_| Ok(())).unwrap();
        for _ in 0..12 {
            online_epoch(&mut state, signals.view(), 0.15, 200, &mut rng, &mut |_| Ok(())).unwrap();
        }
        let last = online_epoch(&mut state, signals.view(), 0.15, 200, &mut rng, &mut |_| Ok(())).unwrap();
        assert!(last.objective < 0.95 * first.objective, "{} {}", last.objective, first.objective);
        let part = found_share(&state.atoms, &truth);
        assert!(part >= 0.85 && before <= 0.5, "{part} after {before}");
    }

    #[test]
    fn batch_objective_never_rises() {
        let (signals, _) = planted_signals(1500, 20, 12, 3, 8);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut state = OnlineState::new(initial_atoms(&signals, 20, &mut rng).unwrap());
        let (mut first, mut last) = (None, f64::INFINITY);
        for _ in 0..12 {
            let now = batch_epoch(&mut state, signals.view(), 0.1, &mut rng, &mut |_| Ok(())).unwrap();
            assert!(now.objective <= last * (1.0 + 1e-4) || now.replaced > 0, "{} after {last}", now.objective);
            last = now.objective;
            first.get_or_insert(last);
        }
        assert!(last < 0.95 * first.unwrap(), "{last} after {first:?}");
    }

    #[test]
    fn an_epoch_is_the_same_on_any_number_of_threads() {
        let (signals, _) = planted_signals(1200, 20, 12, 3, 8);
        let run = |threads| {
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
                let mut rng = ChaCha8Rng::seed_from_u64(1);
                let mut state = OnlineState::new(initial_atoms(&signals, 20, &mut rng).unwrap());
                online_epoch(&mut state, signals.view(), 0.1, 300, &mut rng, &mut |_| Ok(())).unwrap();
                state.atoms
            })
        };
        assert_eq!(run(1), run(3));
    }
}
