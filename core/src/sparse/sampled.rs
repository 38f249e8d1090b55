//! Each signal with its own data term: min over φ of ½‖y − S Dᵀφ‖² + λ‖φ‖₁, S a diagonal √W (weights, masks) or any matrix.
//!
//! With S differing from signal to signal no Gram matrix can be shared; the f64 active set works from residuals. The
//! certificates are those of [`super::solve`], for this objective.

use super::exact::{self, Seen};
use super::solve::{join, push};
use super::{Codes, Error, Options, Penalty, Prepared, Solver};
use ndarray::{ArrayView2, ArrayView3, Axis};
use rayon::prelude::*;

/// Signals a thread takes at a time.
const BLOCK: usize = 64;

/// Solves min ½ Σ_i w_i (y − Dᵀφ)_i² + λ‖φ‖₁ for every row of `signals` and `weights` (both N×m, weights at least 0; 0 hides
/// a value, whatever finite number stands there).
///
/// # Errors
/// Non-finite signals or weights, negative weights, shapes that do not fit, parameters out of range, a solver other than
/// `Auto` or `ActiveSet`.
pub fn solve_weighted(
    dictionary: &Prepared,
    signals: ArrayView2<'_, f32>,
    weights: ArrayView2<'_, f32>,
    options: &Options,
) -> Result<Codes, Error> {
    if weights.dim() != signals.dim() {
        return Err(Error::Shape(format!("weights {:?} for signals {:?}", weights.dim(), signals.dim())));
    }
    check(dictionary, &signals, dictionary.signal_len(), options)?;
    finite("the weights", &weights)?;
    if weights.iter().any(|&w| w < 0.0) {
        return Err(Error::Parameter("weights must be at least 0".into()));
    }
    Ok(blocks(signals.nrows(), |n, codes| {
        let root: Vec<f64> = weights.row(n).iter().map(|&w| f64::from(w).sqrt()).collect();
        let signal: Vec<f64> = signals.row(n).iter().zip(&root).map(|(&y, w)| f64::from(y) * w).collect();
        one(dictionary, Seen::RootWeights(&root), &signal, options, codes);
    }))
}

/// Solves min ½‖y − S Dᵀφ‖² + λ‖φ‖₁ for every row of `signals` (N×p), each with its own matrix of `samplings` (N×p×m).
///
/// # Errors
/// As [`solve_weighted`].
pub fn solve_sampled(
    dictionary: &Prepared,
    signals: ArrayView2<'_, f32>,
    samplings: ArrayView3<'_, f32>,
    options: &Options,
) -> Result<Codes, Error> {
    let (n, p, m) = samplings.dim();
    if (n, p) != signals.dim() || m != dictionary.signal_len() {
        return Err(Error::Shape(format!(
            "samplings {:?} for signals {:?} and atoms of {}",
            samplings.dim(),
            signals.dim(),
            dictionary.signal_len()
        )));
    }
    check(dictionary, &signals, p, options)?;
    for (row, sampling) in samplings.outer_iter().enumerate() {
        finite("the samplings", &sampling).map_err(|_| Error::NotFinite { what: "the samplings", row })?;
    }
    Ok(blocks(n, |n, codes| {
        let signal: Vec<f64> = signals.row(n).iter().map(|&y| f64::from(y)).collect();
        one(dictionary, Seen::Through(samplings.index_axis(Axis(0), n)), &signal, options, codes);
    }))
}

fn blocks(count: usize, each: impl Fn(usize, &mut Codes) + Sync) -> Codes {
    let blocks: Vec<Codes> = (0..count.div_ceil(BLOCK))
        .into_par_iter()
        .map(|block| {
            let mut codes = Codes { indptr: vec![0], ..Codes::default() };
            for n in block * BLOCK..count.min((block + 1) * BLOCK) {
                each(n, &mut codes);
            }
            codes
        })
        .collect();
    join(&blocks)
}

fn one<'a>(dictionary: &'a Prepared, seen: Seen<'a>, signal: &'a [f64], options: &Options, codes: &mut Codes) {
    let lambda = match options.penalty {
        Penalty::Lambda(lambda) => lambda,
        Penalty::FractionOfMax(fraction) => {
            (f64::from(fraction) * exact::largest(dictionary, seen, signal, options.nonnegative)) as f32
        }
        Penalty::NonZeros(_) => 0.0,
    };
    let answer = exact::solve(&exact::Task {
        dictionary,
        seen,
        signal,
        lambda: f64::from(lambda),
        goal: options.tolerance * 0.5 * signal.iter().map(|v| v * v).sum::<f64>(),
        max_rounds: u32::try_from(options.max_iterations).unwrap_or(u32::MAX),
        nonnegative: options.nonnegative,
    });
    let mut entries: Vec<(u32, f32)> =
        answer.support.iter().zip(&answer.values).map(|(&k, &v)| (k, v as f32)).collect();
    push(codes, dictionary, &mut entries, lambda, &answer.finished);
}

fn check(
    dictionary: &Prepared,
    signals: &ArrayView2<'_, f32>,
    expected: usize,
    options: &Options,
) -> Result<(), Error> {
    super::solve::check_options(options)?;
    if !matches!(options.solver, Solver::Auto | Solver::ActiveSet) || matches!(options.penalty, Penalty::NonZeros(_)) {
        return Err(Error::Parameter("signals with their own data terms are solved by the active set, for a λ".into()));
    }
    if signals.ncols() != expected || dictionary.atom_count() == 0 {
        return Err(Error::Shape(format!("signals of {} values, expected {expected}", signals.ncols())));
    }
    finite("the signals", signals)
}

fn finite(what: &'static str, values: &ArrayView2<'_, f32>) -> Result<(), Error> {
    match values.rows().into_iter().position(|row| row.iter().any(|v| !v.is_finite())) {
        Some(row) => Err(Error::NotFinite { what, row }),
        None => Ok(()),
    }
}
