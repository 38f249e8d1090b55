//! One call for all solvers: checks, blocks of signals over the rayon pool, D y as one product a block, codes in order.

use super::fast::{Fast, Greedy, MOST_GREEDY, Scratch};
use super::simd::{Chunk, dispatch, flat};
use super::{Codes, Ended, Error, Options, Penalty, Prepared, Solver, descent, gap, homotopy, omp, prepared, proximal};
use ndarray::ArrayView2;
use rayon::prelude::*;

/// Signals a thread takes at a time; fixed, so that nothing depends on threads.
const BLOCK: usize = 240;
/// Signals whose correlations are held together.
const PART: usize = 24;

/// One signal's problem.
pub(super) struct Problem<'a> {
    pub dictionary: &'a Prepared,
    pub signal: &'a [f32],
    /// D y.
    pub correlations: &'a [f32],
    /// max |D y| (max D y with non-negative codes).
    pub largest: f32,
    pub lambda: f32,
    /// The gap that ends the solve.
    pub goal: f64,
    pub max_iterations: u32,
    pub nonnegative: bool,
    /// With [`Penalty::NonZeros`], how many.
    pub most: usize,
}

/// How a solve ended.
pub(super) struct Finished {
    pub gap: f64,
    pub iterations: u32,
    pub ended: Ended,
}

/// Scratch of one thread for the plain solvers.
pub(super) struct Work {
    /// Dense code; zero outside `support`.
    pub code: Vec<f32>,
    pub support: Vec<u32>,
    pub gradient: Vec<f32>,
    pub residual: Vec<f64>,
    /// Of the Gram matrix; only for proximal gradient.
    pub eigenvalue: f32,
}

impl Work {
    fn new(dictionary: &Prepared, eigenvalue: f32) -> Work {
        Work {
            code: vec![0.0; dictionary.atom_count()],
            support: Vec::with_capacity(dictionary.signal_len()),
            gradient: vec![0.0; dictionary.atom_count()],
            residual: vec![0.0; dictionary.signal_len()],
            eigenvalue,
        }
    }

    pub fn clear_code(&mut self) {
        for &j in &self.support {
            self.code[j as usize] = 0.0;
        }
        self.support.clear();
    }

    /// Puts y − Dᵀφ in f64 into `residual`; gives ‖φ‖₁.
    pub fn residual(&mut self, problem: &Problem<'_>) -> f64 {
        for (r, &y) in self.residual.iter_mut().zip(problem.signal) {
            *r = f64::from(y);
        }
        let mut norm1 = 0.0;
        for &j in &self.support {
            let v = f64::from(self.code[j as usize]);
            if v != 0.0 {
                norm1 += v.abs();
                for (r, &d) in self.residual.iter_mut().zip(problem.dictionary.atom(j as usize)) {
                    *r -= v * f64::from(d);
                }
            }
        }
        norm1
    }

    /// The gap in f64, all correlations computed anew into `gradient`.
    pub fn gap(&mut self, problem: &Problem<'_>) -> f64 {
        let norm1 = self.residual(problem);
        let mut correlations = vec![0.0; problem.dictionary.atom_count()];
        super::exact::correlate_whole(problem.dictionary, &self.residual, &mut correlations);
        let mut largest = 0.0f64;
        for (g, &c) in self.gradient.iter_mut().zip(&correlations) {
            *g = c as f32;
            largest = largest.max(if problem.nonnegative { c } else { c.abs() });
        }
        let (mut yr, mut rr) = (0.0, 0.0);
        for (&y, &r) in problem.signal.iter().zip(&self.residual) {
            yr += f64::from(y) * r;
            rr += r * r;
        }
        gap::certify(yr, rr, norm1, f64::from(problem.lambda), largest)
    }
}

/// Solves min ½‖y − Dᵀφ‖² + λ‖φ‖₁ for every row of `signals` (N×m) on the current rayon pool.
///
/// # Errors
/// Non-finite signals, shapes that do not fit, parameters out of range.
pub fn solve(dictionary: &Prepared, signals: ArrayView2<'_, f32>, options: &Options) -> Result<Codes, Error> {
    check(dictionary, &signals, options)?;
    let signals = signals.as_standard_layout();
    let Some(flat) = signals.as_slice() else { return Err(Error::Shape("signals without a layout".into())) };
    let proximal = matches!(options.solver, Solver::Ista | Solver::Fista);
    let eigenvalue = if proximal { proximal::largest_eigenvalue(dictionary) } else { 0.0 };
    let m = dictionary.signal_len();
    let blocks: Vec<Result<Codes, usize>> = flat
        .par_chunks(BLOCK * m)
        .map_init(
            || (Scratch::new(dictionary, PART), Work::new(dictionary, eigenvalue)),
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
    Ok(join(&blocks))
}

/// Refuses what cannot be solved.
fn check(dictionary: &Prepared, signals: &ArrayView2<'_, f32>, options: &Options) -> Result<(), Error> {
    if signals.ncols() != dictionary.signal_len() {
        return Err(Error::Shape(format!(
            "signals of {} values for atoms of {}",
            signals.ncols(),
            dictionary.signal_len()
        )));
    }
    check_options(options)?;
    let counted = matches!(options.penalty, Penalty::NonZeros(_));
    let counts = matches!(options.solver, Solver::Auto | Solver::Omp | Solver::Homotopy);
    if (counted && !counts) || (!counted && options.solver == Solver::Omp) {
        return Err(Error::Parameter(
            "a number of non-zeros is for OMP and homotopy, and OMP takes nothing else".into(),
        ));
    }
    Ok(())
}

/// The first row of `m` values with one that is not finite.
fn first_not_finite(signals: &[f32], m: usize) -> Option<usize> {
    // Without looking for where, several values a time.
    let bad = |values: &[f32]| values.iter().fold(false, |bad, v| bad | !v.is_finite());
    if !bad(signals) {
        return None;
    }
    signals.chunks(m).position(bad)
}

/// Refuses parameters out of range.
pub(super) fn check_options(options: &Options) -> Result<(), Error> {
    match options.penalty {
        Penalty::Lambda(v) | Penalty::FractionOfMax(v) if !(v.is_finite() && v >= 0.0) => {
            return Err(Error::Parameter(format!("λ must be a number of at least 0, not {v}")));
        }
        _ => {}
    }
    if !(options.tolerance.is_finite() && options.tolerance >= 0.0) {
        return Err(Error::Parameter(format!("the tolerance must be at least 0, not {}", options.tolerance)));
    }
    if options.max_iterations == 0 {
        return Err(Error::Parameter("at least one iteration is needed".into()));
    }
    Ok(())
}

fn solve_block(
    dictionary: &Prepared,
    signals: &[f32],
    options: &Options,
    scratch: &mut Scratch,
    work: &mut Work,
) -> Codes {
    let m = dictionary.signal_len();
    let mut codes = Codes::with_room(signals.len() / m, signals.len() / m * 8);
    let counted = matches!(options.penalty, Penalty::NonZeros(_));
    for part in signals.chunks(PART * m) {
        if matches!(options.solver, Solver::Auto | Solver::ActiveSet) && !counted {
            let fast = Fast { dictionary, signals: part, options, scratch, codes: &mut codes };
            dispatch(dictionary.simd(), fast);
            continue;
        }
        if let Penalty::NonZeros(most) = options.penalty
            && most <= MOST_GREEDY
            && !options.nonnegative
            && options.solver != Solver::Homotopy
        {
            let mut otherwise = |n: usize, correlations: &[Chunk], codes: &mut Codes| {
                let correlations = &flat(correlations)[..dictionary.atom_count()];
                solve_plainly(dictionary, &part[n * m..(n + 1) * m], correlations, options, work, codes);
            };
            let otherwise = &mut otherwise;
            let greedy = Greedy { dictionary, signals: part, most, scratch, otherwise, codes: &mut codes };
            dispatch(dictionary.simd(), greedy);
            continue;
        }
        let out = &mut scratch.correlations;
        dispatch(dictionary.simd(), prepared::Correlate { dictionary, signals: part, stride: m, out });
        for (signal, correlations) in part.chunks_exact(m).zip(scratch.correlations.chunks_exact(dictionary.width())) {
            let correlations = &flat(correlations)[..dictionary.atom_count()];
            solve_plainly(dictionary, signal, correlations, options, work, &mut codes);
        }
    }
    codes
}

fn solve_plainly(
    dictionary: &Prepared,
    signal: &[f32],
    correlations: &[f32],
    options: &Options,
    work: &mut Work,
    codes: &mut Codes,
) {
    let largest = correlations.iter().fold(0.0f32, |m, &c| m.max(if options.nonnegative { c } else { c.abs() }));
    let lambda = match options.penalty {
        Penalty::Lambda(v) => v,
        Penalty::FractionOfMax(f) => f * largest,
        Penalty::NonZeros(_) => 0.0,
    };
    let energy = 0.5 * signal.iter().map(|&v| f64::from(v) * f64::from(v)).sum::<f64>();
    let problem = Problem {
        dictionary,
        signal,
        correlations,
        largest,
        lambda,
        goal: options.tolerance * energy,
        max_iterations: u32::try_from(options.max_iterations).unwrap_or(u32::MAX),
        nonnegative: options.nonnegative,
        most: if let Penalty::NonZeros(most) = options.penalty { most } else { usize::MAX },
    };
    if options.solver == Solver::Homotopy {
        let lambda = f64::from(lambda);
        let (nonzeros, max_steps) = (problem.most, problem.max_iterations);
        let until = homotopy::Until { lambda, nonzeros, max_steps, nonnegative: options.nonnegative };
        let (mut entries, lambda, finished) = homotopy::solve(dictionary, signal, until, problem.goal);
        return push(codes, dictionary, &mut entries, lambda, &finished);
    }
    let finished = match options.solver {
        Solver::Ista | Solver::Fista => proximal::solve(&problem, work, options.solver, work.eigenvalue),
        Solver::Omp | Solver::Auto => omp::solve(&problem, work),
        _ => descent::solve(&problem, work),
    };
    let mut entries: Vec<(u32, f32)> = work.support.iter().map(|&j| (j, work.code[j as usize])).collect();
    push(codes, dictionary, &mut entries, lambda, &finished);
}

/// Appends one signal's code (atoms of the order inside), atoms ascending, zeros left out.
pub(super) fn push(
    codes: &mut Codes,
    dictionary: &Prepared,
    entries: &mut [(u32, f32)],
    lambda: f32,
    finished: &Finished,
) {
    for entry in entries.iter_mut() {
        entry.0 = dictionary.outside(entry.0);
    }
    entries.sort_unstable_by_key(|e| e.0);
    push_sorted(codes, entries, lambda, finished);
}

/// Appends one signal's code, atoms as known outside and ascending; zeros are left out.
pub(super) fn push_sorted(codes: &mut Codes, entries: &[(u32, f32)], lambda: f32, finished: &Finished) {
    if entries.iter().all(|e| e.1 != 0.0) {
        codes.atoms.extend(entries.iter().map(|e| e.0));
        codes.values.extend(entries.iter().map(|e| e.1));
    } else {
        codes.atoms.extend(entries.iter().filter(|e| e.1 != 0.0).map(|e| e.0));
        codes.values.extend(entries.iter().filter(|e| e.1 != 0.0).map(|e| e.1));
    }
    codes.indptr.push(codes.atoms.len());
    codes.gaps.push(finished.gap);
    codes.lambdas.push(lambda);
    codes.iterations.push(finished.iterations);
    codes.ended.push(finished.ended);
}

/// Blocks one after the other.
pub(super) fn join(blocks: &[Codes]) -> Codes {
    let signals = blocks.iter().map(Codes::len).sum();
    let entries = blocks.iter().map(Codes::nonzeros).sum();
    let mut all = Codes::with_room(signals, entries);
    for block in blocks {
        let base = all.atoms.len();
        all.indptr.extend(block.indptr.iter().skip(1).map(|&p| p + base));
        all.atoms.extend_from_slice(&block.atoms);
        all.values.extend_from_slice(&block.values);
        all.gaps.extend_from_slice(&block.gaps);
        all.lambdas.extend_from_slice(&block.lambdas);
        all.iterations.extend_from_slice(&block.iterations);
        all.ended.extend_from_slice(&block.ended);
        all.redone_in_f64 += block.redone_in_f64;
    }
    all
}
