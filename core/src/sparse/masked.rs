//! Sparse coding of signals that are weighted, masked or sampled, each differently: min over φ of ½‖S(y − Dᵀφ)‖² +
//! λ‖φ‖₁, S a diagonal √W (weights, masks) or any matrix.
//!
//! With S differing from signal to signal no Gram matrix can be shared; the f64 active set works from residuals. The
//! certificates are those of [`super::solve`], for this objective.

use ndarray::{ArrayView2, ArrayView3, Axis};
use rayon::prelude::*;

use super::codes::Codes;
use super::error::Error;
use super::kernel::active_set_f64::{self, Observation, ObservedProblem};
use super::options::Options;
use super::penalty::Penalty;
use super::prepared::Prepared;
use super::solver::Solver;

/// Signals per job; fixed, so that results do not depend on the number of threads.
///
/// Source: chosen.
const BLOCK: usize = 64;

/// Solves min ½ Σ_i w_i (y − Dᵀφ)_i² + λ‖φ‖₁ for every row y of `signals` and w of `weights` (both N×m, weights at
/// least 0; a value of weight 0 is ignored, but must be finite). In f64.
///
/// # Errors
/// Non-finite signals or weights, negative weights, shapes that do not fit, parameters out of range, a solver other
/// than `Auto` or `ActiveSet`, a penalty that is a number of non-zeros.
///
/// ```
/// use lenslet_core::sparse::{self, Options, Penalty};
/// use ndarray::array;
///
/// let dictionary = sparse::prepare(array![[0.6f32, 0.8], [0.8, -0.6]].view())?;
/// let options = Options { penalty: Penalty::Lambda(0.01), ..Options::default() };
/// // The second value is hidden; the first is 0.6 φ₀ + 0.8 φ₁, and φ₁ costs less.
/// let codes = sparse::solve_weighted(&dictionary, array![[1.0, 99.0]].view(), array![[1.0, 0.0]].view(), &options)?;
/// assert_eq!(codes.signal(0).map(|(atom, _)| atom).collect::<Vec<_>>(), [1]);
/// # Ok::<(), sparse::Error>(())
/// ```
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
    check_finite("the weights", &weights)?;
    if weights.iter().any(|&w| w < 0.0) {
        return Err(Error::Parameter("weights must be at least 0".into()));
    }
    Ok(solve_in_blocks(signals.nrows(), |n, codes| {
        let root: Vec<f64> = weights.row(n).iter().map(|&w| f64::from(w).sqrt()).collect();
        let signal: Vec<f64> = signals.row(n).iter().zip(&root).map(|(&y, w)| f64::from(y) * w).collect();
        solve_observed(dictionary, Observation::Weighted(&root), &signal, options, codes);
    }))
}

/// Solves min ½‖y − S Dᵀφ‖² + λ‖φ‖₁ for every row y of `signals` (N×p), each with its own matrix S of `samplings`
/// (N×p×m). In f64.
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
        check_finite("the samplings", &sampling).map_err(|_| Error::NotFinite { what: "the samplings", row })?;
    }
    Ok(solve_in_blocks(n, |n, codes| {
        let signal: Vec<f64> = signals.row(n).iter().map(|&y| f64::from(y)).collect();
        solve_observed(dictionary, Observation::Sampled(samplings.index_axis(Axis(0), n)), &signal, options, codes);
    }))
}

fn solve_in_blocks(count: usize, each: impl Fn(usize, &mut Codes) + Sync) -> Codes {
    let blocks: Vec<Codes> = (0..count.div_ceil(BLOCK))
        .into_par_iter()
        .map(|block| {
            let mut codes = Codes::with_room(0, 0);
            for n in block * BLOCK..count.min((block + 1) * BLOCK) {
                each(n, &mut codes);
            }
            codes
        })
        .collect();
    Codes::concatenate(&blocks)
}

fn solve_observed<'a>(
    dictionary: &'a Prepared,
    observation: Observation<'a>,
    signal: &'a [f64],
    options: &Options,
    codes: &mut Codes,
) {
    let lambda_max = match options.penalty {
        Penalty::FractionOfMax(_) => active_set_f64::lambda_max(dictionary, observation, signal, options.nonnegative),
        _ => 0.0,
    };
    let solution = active_set_f64::solve(&ObservedProblem {
        dictionary,
        observation,
        signal,
        lambda: f64::from(options.penalty.lambda(lambda_max)),
        goal: options.tolerance * 0.5 * signal.iter().map(|v| v * v).sum::<f64>(),
        max_rounds: options.max_rounds(),
        nonnegative: options.nonnegative,
    });
    let mut entries: Vec<(u32, f32)> =
        solution.support.iter().zip(&solution.values).map(|(&k, &v)| (k, v as f32)).collect();
    codes.push_unsorted(dictionary, &mut entries, &solution.finished);
}

fn check(
    dictionary: &Prepared,
    signals: &ArrayView2<'_, f32>,
    expected: usize,
    options: &Options,
) -> Result<(), Error> {
    options.check()?;
    if !matches!(options.solver, Solver::Auto | Solver::ActiveSet) || options.penalty.nonzeros().is_some() {
        return Err(Error::Parameter(
            "weighted or sampled signals are solved by the active set only, with a penalty λ".into(),
        ));
    }
    if signals.ncols() != expected || dictionary.atom_count() == 0 {
        return Err(Error::Shape(format!("signals of {} values, expected {expected}", signals.ncols())));
    }
    check_finite("the signals", signals)
}

fn check_finite(what: &'static str, values: &ArrayView2<'_, f32>) -> Result<(), Error> {
    match values.rows().into_iter().position(|row| row.iter().any(|v| !v.is_finite())) {
        Some(row) => Err(Error::NotFinite { what, row }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sparse::prepare;
    use ndarray::{Array2, Array3};

    #[test]
    fn every_shape_must_fit() {
        let eye = Array2::from_shape_fn((4, 4), |(i, j)| f32::from(u8::from(i == j)));
        let dictionary = prepare(eye.view()).unwrap();
        let solved = |n: usize, p: usize, samplings: (usize, usize, usize)| {
            let signals = Array2::ones((n, p));
            solve_sampled(&dictionary, signals.view(), Array3::ones(samplings).view(), &Options::default()).is_ok()
        };
        assert!(solved(2, 3, (2, 3, 4)));
        assert!(!solved(2, 3, (2, 3, 5)) && !solved(2, 3, (2, 2, 4)) && !solved(3, 3, (2, 3, 4)));
        let weighted = |weights: (usize, usize), value: f32| {
            let signals = Array2::ones((2, 4));
            let weights = Array2::from_elem(weights, value);
            solve_weighted(&dictionary, signals.view(), weights.view(), &Options::default()).is_ok()
        };
        assert!(weighted((2, 4), 0.0) && weighted((2, 4), 2.0));
        assert!(!weighted((2, 3), 1.0) && !weighted((1, 4), 1.0) && !weighted((2, 4), -1.0));
    }
}
