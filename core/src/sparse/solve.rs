//! One call for all solvers: checks, blocks of signals over the rayon pool, D y as one product a block, codes in order.

use super::{Codes, Ended, Error, Options, Penalty, Prepared, Solver, descent, omp};
use ndarray::{ArrayView2, Axis};
use rayon::prelude::*;

/// Signals solved together; fixed, so that nothing depends on threads.
const BLOCK: usize = 128;

/// One signal's problem.
pub(super) struct Problem<'a> {
    pub dictionary: &'a Prepared,
    pub signal: &'a [f32],
    /// D y.
    pub correlations: &'a [f32],
    /// max |D y|.
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

/// Scratch of one thread.
pub(super) struct Work {
    /// Dense code; zero outside `support`.
    pub code: Vec<f32>,
    pub support: Vec<u32>,
    pub gradient: Vec<f32>,
    pub residual: Vec<f64>,
}

impl Work {
    fn new(dictionary: &Prepared) -> Work {
        Work {
            code: vec![0.0; dictionary.atom_count()],
            support: Vec::with_capacity(dictionary.signal_len()),
            gradient: vec![0.0; dictionary.atom_count()],
            residual: vec![0.0; dictionary.signal_len()],
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
}

/// Solves min ½‖y − Dᵀφ‖² + λ‖φ‖₁ for every row of `signals` (N×m) on the current rayon pool.
///
/// # Errors
/// Non-finite signals, shapes that do not fit, parameters out of range.
pub fn solve(dictionary: &Prepared, signals: ArrayView2<'_, f32>, options: &Options) -> Result<Codes, Error> {
    check(dictionary, &signals, options)?;
    let signals = signals.as_standard_layout();
    let blocks: Result<Vec<Codes>, Error> = (0..signals.nrows().div_ceil(BLOCK))
        .into_par_iter()
        .map_init(
            || Work::new(dictionary),
            |work, block| {
                let from = block * BLOCK;
                let to = (from + BLOCK).min(signals.nrows());
                let part = signals.view().split_at(Axis(0), to).0.split_at(Axis(0), from).1;
                solve_block(dictionary, part, options, work)
            },
        )
        .collect();
    Ok(join(&blocks?))
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
    match options.penalty {
        Penalty::Lambda(v) | Penalty::FractionOfMax(v) if !(v.is_finite() && v >= 0.0) => {
            return Err(Error::Parameter(format!("λ must be a number of at least 0, not {v}")));
        }
        _ => {}
    }
    if !(options.tolerance.is_finite() && options.tolerance >= 0.0) {
        return Err(Error::Parameter(format!("the tolerance must be at least 0, not {}", options.tolerance)));
    }
    if matches!(options.penalty, Penalty::NonZeros(_)) != (options.solver == Solver::Omp) {
        return Err(Error::Parameter("a number of non-zeros and the solver OMP go together".into()));
    }
    if options.max_iterations == 0 {
        return Err(Error::Parameter("at least one iteration is needed".into()));
    }
    let bad = signals.axis_iter(Axis(0)).into_par_iter().position_first(|row| row.iter().any(|v| !v.is_finite()));
    match bad {
        Some(row) => Err(Error::NotFinite { what: "the signals", row }),
        None => Ok(()),
    }
}

fn solve_block(
    dictionary: &Prepared,
    signals: ArrayView2<'_, f32>,
    options: &Options,
    work: &mut Work,
) -> Result<Codes, Error> {
    let correlations = signals.dot(&dictionary.atoms().t());
    let mut codes = Codes { indptr: vec![0], ..Codes::default() };
    for (signal, correlations) in signals.rows().into_iter().zip(correlations.rows()) {
        let (Some(signal), Some(correlations)) = (signal.as_slice(), correlations.as_slice()) else { continue };
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
        let finished = match options.solver {
            Solver::CoordinateDescent | Solver::Auto => descent::solve(&problem, work),
            Solver::Omp => omp::solve(&problem, work),
            _ => return Err(Error::Parameter(format!("solver {:?} is not there yet", options.solver))),
        };
        push(&mut codes, work, lambda, &finished);
    }
    Ok(codes)
}

/// Appends one signal's code, atoms ascending.
fn push(codes: &mut Codes, work: &mut Work, lambda: f32, finished: &Finished) {
    work.support.sort_unstable();
    for &j in &work.support {
        let v = work.code[j as usize];
        if v != 0.0 {
            codes.atoms.push(j);
            codes.values.push(v);
        }
    }
    codes.indptr.push(codes.atoms.len());
    codes.gaps.push(finished.gap);
    codes.lambdas.push(lambda);
    codes.iterations.push(finished.iterations);
    codes.ended.push(finished.ended);
}

/// Blocks one after the other.
fn join(blocks: &[Codes]) -> Codes {
    let mut all = Codes { indptr: vec![0], ..Codes::default() };
    for block in blocks {
        let base = all.atoms.len();
        all.indptr.extend(block.indptr.iter().skip(1).map(|&p| p + base));
        all.atoms.extend_from_slice(&block.atoms);
        all.values.extend_from_slice(&block.values);
        all.gaps.extend_from_slice(&block.gaps);
        all.lambdas.extend_from_slice(&block.lambdas);
        all.iterations.extend_from_slice(&block.iterations);
        all.ended.extend_from_slice(&block.ended);
    }
    all
}
