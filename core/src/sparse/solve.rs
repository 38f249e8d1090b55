//! One call for all solvers: checks, blocks of signals over the rayon pool, D y as one product per block, codes in
//! order.

use ndarray::ArrayView2;
use rayon::prelude::*;

use super::codes::Codes;
use super::error::Error;
use super::kernel::active_set_f32::{LassoBlock, Settings};
use super::kernel::active_set_f64::{self, Observation, ObservedProblem};
use super::kernel::active_set_mixed::{MixedProblem, SolveMixed};
use super::kernel::continuation::Continuation;
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
        steps: Continuation::of(dictionary),
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
            factor: settings.steps.factor,
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

#[cfg(test)]
mod tests {
    use super::super::masked::solve_weighted;
    use super::super::options::Options;
    use super::super::penalty::Penalty;
    use super::super::prepared::prepare;
    use super::*;
    use ndarray::Array2;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    fn random(rows: usize, columns: usize, seed: u64) -> Array2<f32> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        Array2::from_shape_fn((rows, columns), |_| rng.random::<f32>() - 0.5)
    }

    fn atoms(k: usize, m: usize, seed: u64) -> Array2<f32> {
        let mut atoms = random(k, m, seed);
        atoms.rows_mut().into_iter().for_each(|mut r| r /= r.dot(&r).sqrt());
        atoms
    }

    /// Ordinary problems are solved in f32, in a few rounds for each atom, and the codes are those of the
    /// exact solver. What f32 cannot finish is done again in f64, which would hide whatever is wrong with it.
    #[test]
    fn f32_needs_no_help_with_ordinary_problems() {
        // Searched whole, with candidate chunks, and with supports beyond sixteen atoms.
        for (k, m, share, n) in [(40, 25, 0.2, 50), (200, 49, 0.15, 50), (600, 49, 0.15, 50)] {
            let dictionary = prepare(atoms(k, m, k as u64).view()).unwrap();
            let signals = random(n, m, m as u64);
            let ones = Array2::ones(signals.dim());
            for nonnegative in [false, true] {
                let options = Options { penalty: Penalty::FractionOfMax(share), nonnegative, ..Options::default() };
                let found = solve(&dictionary, signals.view(), &options).unwrap();
                let exact = Options { tolerance: 1e-12, ..options };
                let slow = solve_weighted(&dictionary, signals.view(), ones.view(), &exact).unwrap();
                let case = format!("{k} atoms of {m}, {nonnegative}");
                assert!(found.all_converged(), "{case}");
                assert!(found.redone_in_f64 * 10 <= n, "{case}: {} redone", found.redone_in_f64);
                let (a, b) = (found.to_dense(k).unwrap(), slow.to_dense(k).unwrap());
                let worst = (&a - &b).iter().fold(0.0f32, |m, v| m.max(v.abs()));
                assert!(worst < 1e-2, "{case}: {worst}");
                let rounds: u32 = found.iterations.iter().sum();
                let entries = found.nonzeros() as f64;
                assert!(
                    f64::from(rounds) < 2.5 * entries + 4.0 * n as f64,
                    "{case}: {rounds} rounds, {entries} entries"
                );
                for (l, s) in found.lambdas.iter().zip(&slow.lambdas) {
                    assert!((l - s).abs() < 1e-5 * s, "{case}: {l} {s}");
                }
            }
        }
    }

    #[test]
    fn the_first_row_that_is_not_finite_is_named() {
        let dictionary = prepare(atoms(20, 9, 1).view()).unwrap();
        let mut signals = random(2 * BLOCK + 7, 9, 2);
        assert!(solve(&dictionary, signals.view(), &Options::default()).is_ok());
        signals[[2 * BLOCK + 5, 8]] = f32::NAN;
        signals[[BLOCK + 3, 0]] = f32::INFINITY;
        let error = solve(&dictionary, signals.view(), &Options::default()).unwrap_err();
        assert!(matches!(error, Error::NotFinite { row, .. } if row == BLOCK + 3), "{error}");
        assert_eq!(first_not_finite(&[1.0, 2.0, f32::NAN, 3.0], 2), Some(1));
        assert_eq!(first_not_finite(&[1.0, 2.0], 2), None);
    }

    #[test]
    fn pursuit_stops_at_its_number_and_takes_the_largest() {
        let dictionary = prepare(atoms(90, 40, 3).view()).unwrap();
        let signals = random(60, 40, 4);
        let mut before = vec![f64::INFINITY; 60];
        for most in [1, 2, 8, 16, 17] {
            let options = Options { solver: Solver::Omp, penalty: Penalty::NonZeros(most), ..Options::default() };
            let codes = solve(&dictionary, signals.view(), &options).unwrap();
            let errors = codes.objectives(&dictionary, signals.view()).unwrap();
            for n in 0..60 {
                assert_eq!(codes.signal(n).len(), most);
                assert!(errors[n] < before[n]);
            }
            before = errors;
        }
        // A signal that one atom makes up needs no other.
        let one = &dictionary.atoms().row(7).to_owned() * 2.5;
        let options = Options { solver: Solver::Omp, penalty: Penalty::NonZeros(5), ..Options::default() };
        let codes = solve(&dictionary, one.view().insert_axis(ndarray::Axis(0)), &options).unwrap();
        let entries: Vec<(usize, f32)> = codes.signal(0).collect();
        assert!(entries.len() == 1 && entries[0].0 == 7 && (entries[0].1 - 2.5).abs() < 1e-5, "{entries:?}");
    }

    #[test]
    fn every_solver_gives_the_exact_codes_with_and_without_signs() {
        let dictionary = prepare(atoms(60, 30, 9).view()).unwrap();
        let signals = random(12, 30, 10);
        let ones = Array2::ones(signals.dim());
        for nonnegative in [false, true] {
            let penalty = Penalty::FractionOfMax(0.3);
            let exact = Options { penalty, nonnegative, tolerance: 1e-12, ..Options::default() };
            let truth = solve_weighted(&dictionary, signals.view(), ones.view(), &exact).unwrap().to_dense(60).unwrap();
            for solver in Solver::ALL.into_iter().filter(|s| *s != Solver::Omp) {
                let options = Options { solver, penalty, nonnegative, max_iterations: 100_000, ..Options::default() };
                let found = solve(&dictionary, signals.view(), &options).unwrap();
                assert!(found.all_converged(), "{solver:?} {nonnegative}");
                let worst = (&found.to_dense(60).unwrap() - &truth).iter().fold(0.0f32, |m, v| m.max(v.abs()));
                assert!(worst < 1e-2, "{solver:?} {nonnegative}: {worst}");
            }
        }
    }
}
