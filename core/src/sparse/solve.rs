//! One call for all solvers: checks, blocks of signals over the rayon pool, D y as one product per block, codes in
//! order.

use ndarray::ArrayView2;
use rayon::prelude::*;

use super::codes::Codes;
use super::error::Error;
use super::kernel::active_set_f32::{LassoBlock, Settings};
use super::kernel::active_set_f64::{self, Observation, ObservedProblem};
use super::kernel::active_set_mixed::{MixedProblem, SolveMixed};
use super::kernel::product::Correlate;
use super::kernel::pursuit_f32::{MAX_PURSUIT_NONZEROS, PursuitBlock};
use super::kernel::scratch::Scratch;
use super::kernel::simd::{Chunk, dispatch, flat};
use super::options::Options;
use super::prepared::Prepared;
use super::problem::{Problem, Work};
use super::solver::{Reference, Solver};

/// Signals per job; fixed, so that results do not depend on the number of threads.
///
/// Source: chosen; ten times [`PART`].
const BLOCK: usize = 240;
/// Signals whose correlations are computed and held at once.
///
/// Source: measured; 12 and 48 within 1 % (docs/sparse-coding.md).
const PART: usize = 24;

/// Solves min ½‖y − Dᵀφ‖² + λ‖φ‖₁ for every row y of `signals` (N×m, N may be 0) on the current rayon pool.
///
/// Every code comes with its duality gap; [`Codes::ended`] records whether its solve reached the tolerance.
/// With [`Penalty::NonZeros`](super::Penalty::NonZeros) the objective is ½‖y − Dᵀφ‖² under that number of non-zeros.
///
/// # Errors
/// Non-finite signals, shapes that do not fit, parameters out of range.
///
/// # Examples
/// With orthonormal atoms the LASSO shrinks each correlation by λ:
/// ```
/// use lenslet_core::sparse::{self, Options, Penalty};
/// use ndarray::array;
///
/// let atoms = array![[1.0f32, 0.0], [0.0, 1.0]];
/// let dictionary = sparse::prepare(atoms.view())?;
/// let options = Options { penalty: Penalty::Lambda(0.25), ..Options::default() };
/// let codes = sparse::solve(&dictionary, array![[1.0, -0.5], [0.2, 0.1]].view(), &options)?;
/// assert_eq!(codes.to_dense(2)?, array![[0.75, -0.25], [0.0, 0.0]]);
/// assert!(codes.all_converged() && codes.max_gap() < 1e-6);
/// # Ok::<(), sparse::Error>(())
/// ```
/// Orthogonal matching pursuit takes a number of non-zeros instead:
/// ```
/// use lenslet_core::sparse::{self, Options, Penalty, Solver};
/// use ndarray::array;
///
/// let dictionary = sparse::prepare(array![[1.0f32, 0.0], [0.6, 0.8], [0.0, 1.0]].view())?;
/// let options = Options { solver: Solver::Omp, penalty: Penalty::NonZeros(1), ..Options::default() };
/// let codes = sparse::solve(&dictionary, array![[1.2, 1.6]].view(), &options)?;
/// let entries: Vec<(usize, f32)> = codes.signal(0).collect();
/// assert!(entries.len() == 1 && entries[0].0 == 1 && (entries[0].1 - 2.0).abs() < 1e-6);
/// # Ok::<(), sparse::Error>(())
/// ```
pub fn solve(dictionary: &Prepared, signals: ArrayView2<'_, f32>, options: &Options) -> Result<Codes, Error> {
    if signals.ncols() != dictionary.signal_len() {
        return Err(Error::Shape(format!(
            "signals of {} values for atoms of {}",
            signals.ncols(),
            dictionary.signal_len()
        )));
    }
    options.check()?;
    let signals = signals.as_standard_layout();
    let Some(flat) = signals.as_slice() else {
        return Err(Error::Shape("the signals are not contiguous in memory".into()));
    };
    let m = dictionary.signal_len();
    let blocks: Vec<Result<Codes, usize>> = flat
        .par_chunks(BLOCK * m)
        .map_init(
            || (Scratch::new(dictionary, PART), Work::new(dictionary)),
            |(scratch, work), block| match first_not_finite(block, m) {
                None => Ok(solve_block(dictionary, block, options, scratch, work)),
                Some(row) => Err(row),
            },
        )
        .collect();
    let bad = blocks.iter().enumerate().find_map(|(n, block)| block.as_ref().err().map(|row| n * BLOCK + row));
    if let Some(row) = bad {
        return Err(Error::NotFinite { what: "the signals", row });
    }
    let blocks: Vec<Codes> = blocks.into_iter().flatten().collect();
    Ok(Codes::concatenate(&blocks))
}

/// The first row of `m` values with one that is not finite.
fn first_not_finite(signals: &[f32], m: usize) -> Option<usize> {
    // Without looking for where, several values at a time.
    let bad = |values: &[f32]| values.iter().fold(false, |bad, v| bad | !v.is_finite());
    if !bad(signals) {
        return None;
    }
    signals.chunks(m).position(bad)
}

fn solve_block(
    dictionary: &Prepared,
    signals: &[f32],
    options: &Options,
    scratch: &mut Scratch,
    work: &mut Work,
) -> Codes {
    let (m, atom_count) = (dictionary.signal_len(), dictionary.atom_count());
    let mut codes = Codes::with_room(signals.len() / m, signals.len() / m * 8);
    let nonzeros = options.penalty.nonzeros();
    let solver = options.solver.resolved(nonzeros.is_some());
    let settings = Settings {
        penalty: options.penalty,
        tolerance: options.tolerance,
        max_rounds: options.max_rounds(),
        nonnegative: options.nonnegative,
    };
    for part in signals.chunks(PART * m) {
        let Some(reference) = solver.reference() else {
            dispatch(dictionary.simd(), LassoBlock { dictionary, signals: part, settings, scratch });
            codes.redone_in_f64 += scratch.unfinished.len();
            finish(dictionary, settings, scratch);
            for solved in &scratch.solved[..part.len() / m] {
                codes.push_sorted(&solved.entries, &solved.finished);
            }
            continue;
        };
        let mut plainly = |n: usize, correlations: &[Chunk], codes: &mut Codes| {
            let (signal, correlations) = (&part[n * m..(n + 1) * m], &flat(correlations)[..atom_count]);
            solve_plainly(dictionary, signal, correlations, options, reference, work, codes);
        };
        if let Some(most) = nonzeros
            && solver == Solver::Omp
            && most <= MAX_PURSUIT_NONZEROS
            && !options.nonnegative
        {
            let otherwise = &mut plainly;
            let block = PursuitBlock { dictionary, signals: part, most, scratch, otherwise, codes: &mut codes };
            dispatch(dictionary.simd(), block);
            continue;
        }
        let out = &mut scratch.correlations;
        dispatch(dictionary.simd(), Correlate { panels: dictionary.panels(), signals: part, stride: m, out });
        let rows = scratch.correlations.chunks_exact(dictionary.width());
        for (n, correlations) in rows.take(part.len() / m).enumerate() {
            plainly(n, correlations, &mut codes);
        }
    }
    codes
}

/// Solves what f32 left, in mixed precision from where it stopped; what that leaves, in f64 from nothing.
fn finish(dictionary: &Prepared, settings: Settings, scratch: &mut Scratch) {
    let Scratch { padded, solved, unfinished, mixed, .. } = scratch;
    let chunks = dictionary.signal_len().div_ceil(16);
    for left in unfinished.iter() {
        let (signal, solved) = (&padded[left.signal * chunks..][..chunks], &mut solved[left.signal]);
        let problem = MixedProblem {
            dictionary,
            signal,
            lambda: f64::from(left.lambda),
            first_lambda: left.first_lambda,
            goal: left.goal,
            rounds: left.rounds,
            max_rounds: settings.max_rounds,
            nonnegative: settings.nonnegative,
            start: &solved.entries,
        };
        if left.lambda == 0.0 && mixed.span.is_empty() {
            mixed.span = active_set_f64::orthonormal_basis(dictionary, Observation::Full, dictionary.signal_len());
        }
        let finished = dispatch(dictionary.simd(), SolveMixed { problem, scratch: mixed });
        solved.entries.clear();
        if let Some(finished) = finished {
            let members = mixed.support.members();
            solved.entries.extend(members.map(|(k, v)| (dictionary.outside(k), v as f32)));
            solved.finished = finished;
        } else {
            let signal: Vec<f64> = flat(signal)[..dictionary.signal_len()].iter().map(|&v| f64::from(v)).collect();
            let solution = active_set_f64::solve(&ObservedProblem {
                dictionary,
                observation: Observation::Full,
                signal: &signal,
                lambda: f64::from(left.lambda),
                goal: left.goal,
                max_rounds: settings.max_rounds,
                nonnegative: settings.nonnegative,
            });
            let members = solution.support.iter().zip(&solution.values);
            solved.entries.extend(members.map(|(&k, &v)| (dictionary.outside(k), v as f32)));
            solved.finished = solution.finished;
        }
        solved.entries.sort_unstable_by_key(|e| e.0);
    }
}

/// One signal by a plain solver.
fn solve_plainly(
    dictionary: &Prepared,
    signal: &[f32],
    correlations: &[f32],
    options: &Options,
    reference: Reference,
    work: &mut Work,
    codes: &mut Codes,
) {
    let lambda_max = correlations.iter().fold(0.0f32, |m, &c| m.max(if options.nonnegative { c } else { c.abs() }));
    let energy = 0.5 * signal.iter().map(|&v| f64::from(v) * f64::from(v)).sum::<f64>();
    let problem = Problem {
        dictionary,
        signal,
        correlations,
        lambda_max,
        lambda: options.penalty.lambda(f64::from(lambda_max)),
        goal: options.tolerance * energy,
        max_iterations: options.max_rounds(),
        nonnegative: options.nonnegative,
        max_nonzeros: options.penalty.nonzeros().unwrap_or(usize::MAX),
    };
    let finished = reference(&problem, work);
    let mut entries: Vec<(u32, f32)> = work.support.iter().map(|&j| (j, work.code[j as usize])).collect();
    codes.push_unsorted(dictionary, &mut entries, &finished);
}
