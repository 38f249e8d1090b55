//! Homotopy (LARS-lasso, Osborne et al. 2000, Efron et al. 2004): the minimisers of ½‖y − Dᵀφ‖² + λ‖φ‖₁ for all λ
//! downwards.
//!
//! Between two knots φ_S moves along G_SS⁻¹θ and all correlations of the support shrink alike; a knot is where an atom
//! outside reaches them, a coefficient reaches zero, or the wanted λ or number of non-zeros is met. In f64, from
//! residuals.

use ndarray::ArrayView1;

use crate::sparse::error::Error;
use crate::sparse::kernel::active_set_f64::{self, Member, Observation, ObservedProblem};
use crate::sparse::penalty::check_lambda;
use crate::sparse::prepared::Prepared;
use crate::sparse::problem::{Ended, Finished, Problem, Work};

/// A point of the path where the support changes.
#[derive(Debug, Clone, PartialEq)]
pub struct Knot {
    /// λ there.
    pub lambda: f64,
    /// Atoms of the support, in order of entry.
    pub atoms: Vec<u32>,
    /// Their values.
    pub values: Vec<f64>,
}

/// Where the path is to end.
#[derive(Clone, Copy)]
struct Until {
    pub lambda: f64,
    pub nonzeros: usize,
    pub max_steps: u32,
    pub nonnegative: bool,
}

/// Where [`follow_path`] ends.
struct Arrived {
    pub members: Vec<Member>,
    pub lambda: f64,
    pub steps: u32,
    pub ended: Ended,
}

/// The minimisers of ½‖y − Dᵀφ‖² + λ‖φ‖₁ for one signal y (m values), from λ_max = max |D y| down to `lambda` (at
/// least 0), with at most `max_steps` knots. Between two knots they are linear in λ.
///
/// # Errors
/// A signal that is not finite or does not fit, a negative λ.
///
/// ```
/// use lenslet_core::sparse;
/// use ndarray::array;
///
/// let dictionary = sparse::prepare(array![[1.0f32, 0.0], [0.0, 1.0]].view())?;
/// let knots = sparse::homotopy_path(&dictionary, array![2.0, -1.0].view(), 0.0, 100, false)?;
/// // Nothing above λ_max = 2, the second atom from λ = 1, least squares at 0.
/// assert_eq!(knots.iter().map(|knot| knot.lambda).collect::<Vec<_>>(), [2.0, 1.0, 0.0]);
/// assert_eq!(knots[2].values, [2.0, -1.0]);
/// # Ok::<(), sparse::Error>(())
/// ```
pub fn homotopy_path(
    dictionary: &Prepared,
    signal: ArrayView1<'_, f32>,
    lambda: f64,
    max_steps: usize,
    nonnegative: bool,
) -> Result<Vec<Knot>, Error> {
    if signal.len() != dictionary.signal_len() {
        return Err(Error::Shape(format!(
            "a signal of {} values for atoms of {}",
            signal.len(),
            dictionary.signal_len()
        )));
    }
    if signal.iter().any(|v| !v.is_finite()) {
        return Err(Error::NotFinite { what: "the signal", row: 0 });
    }
    check_lambda(lambda)?;
    let signal: Vec<f64> = signal.iter().map(|&v| f64::from(v)).collect();
    let max_steps = u32::try_from(max_steps).unwrap_or(u32::MAX);
    let until = Until { lambda, nonzeros: usize::MAX, max_steps, nonnegative };
    let mut knots = Vec::new();
    follow_path(dictionary, &signal, until, |lambda, members| {
        let shown = || members.iter().filter(|m| m.value != 0.0);
        knots.push(Knot {
            lambda,
            atoms: shown().map(|m| dictionary.outside(m.atom as u32)).collect(),
            values: shown().map(|m| m.value).collect(),
        });
    });
    Ok(knots)
}

/// Follows the path, calling `knot` with λ and the support at each knot.
fn follow_path(dictionary: &Prepared, signal: &[f64], until: Until, mut knot: impl FnMut(f64, &[Member])) -> Arrived {
    let k = dictionary.atom_count();
    let mut c = vec![0.0f64; k];
    dictionary.correlate_f64(signal, &mut c);
    let size = |c: f64| if until.nonnegative { c } else { c.abs() };
    let (start, mut lambda) =
        c.iter().enumerate().fold((0, 0.0f64), |best, (j, &c)| if size(c) > best.1 { (j, size(c)) } else { best });
    let scale = lambda;
    let mut members: Vec<Member> = Vec::new();
    let mut direction = vec![0.0f64; k];
    let mut joining = (lambda > until.lambda && until.nonzeros > 0).then_some(start);
    // Atoms that depend linearly on the support, and the one that just left.
    let mut barred: Vec<usize> = Vec::new();
    let mut left = usize::MAX;
    // Atoms at the bound that move inwards (copies of one that left): not to enter before a step of non-zero length.
    let mut waiting: Vec<usize> = Vec::new();
    let mut steps = 0;
    knot(lambda, &members);
    loop {
        if let Some(atom) = joining.take() {
            let column = active_set_f64::observed_atom(dictionary, Observation::Full, atom);
            if active_set_f64::is_dependent(&members, &column) {
                barred.push(atom);
            } else {
                members.push(Member { atom, value: 0.0, sign: c[atom].signum(), column });
            }
        }
        let ended = if lambda <= until.lambda || members.is_empty() {
            Some(Ended::Converged)
        } else if steps >= until.max_steps {
            Some(Ended::IterationCap)
        } else {
            None
        };
        if let Some(ended) = ended {
            return Arrived { members, lambda, steps, ended };
        }
        steps += 1;
        let signs: Vec<f64> = members.iter().map(|m| m.sign).collect();
        let Some(w) = active_set_f64::solve_gram(&members, &signs) else {
            return Arrived { members, lambda, steps, ended: Ended::Stalled };
        };
        if let (Some(last), Some(w)) = (members.last(), w.last())
            && last.value == 0.0
            && members.len() > 1
            && w * last.sign <= 0.0
        {
            waiting.push(last.atom);
            members.pop();
            continue;
        }
        let mut along = vec![0.0f64; signal.len()];
        for (m, w) in members.iter().zip(&w) {
            for (a, d) in along.iter_mut().zip(&m.column) {
                *a += w * d;
            }
        }
        dictionary.correlate_f64(&along, &mut direction);
        // The first event on the way down.
        let mut step = lambda - until.lambda;
        let (mut joins, mut leaves) = (None, None);
        let mut outside = vec![true; k];
        members.iter().for_each(|m| outside[m.atom] = false);
        barred.iter().chain(&waiting).for_each(|&b| outside[b] = false);
        for j in (0..k).filter(|&j| outside[j]) {
            let up = (lambda - c[j]) / (1.0 - direction[j]);
            let down = if until.nonnegative { f64::INFINITY } else { (lambda + c[j]) / (1.0 + direction[j]) };
            for reached in [up, down] {
                // The one that just left touches the bound now and moves inwards.
                let soonest = if j == left { 1e-9 * scale } else { -1e-12 * scale };
                if reached > soonest && reached.max(0.0) < step {
                    (step, joins) = (reached.max(0.0), Some(j));
                }
            }
        }
        for (i, (m, w)) in members.iter().zip(&w).enumerate() {
            let zero = -m.value / w;
            if zero > 1e-14 * scale && zero < step {
                (step, joins, leaves) = (zero, None, Some(i));
            }
        }
        if step > 1e-9 * scale {
            waiting.clear();
        }
        for (m, w) in members.iter_mut().zip(&w) {
            m.value += step * w;
        }
        for (c, d) in c.iter_mut().zip(&direction) {
            *c -= step * d;
        }
        lambda = if joins.is_none() && leaves.is_none() { until.lambda } else { lambda - step };
        left = usize::MAX;
        if let Some(i) = leaves {
            left = members.swap_remove(i).atom;
            barred.clear();
        }
        knot(lambda, &members);
        if joins.is_some() && members.len() >= until.nonzeros {
            return Arrived { members, lambda, steps, ended: Ended::Converged };
        }
        joining = joins;
    }
}

/// Solves one signal for its λ, or down to the λ where the next atom would be one too many. In f64.
pub(crate) fn solve(problem: &Problem<'_>, work: &mut Work) -> Finished {
    let dictionary = problem.dictionary;
    let until = Until {
        lambda: f64::from(problem.lambda),
        nonzeros: problem.max_nonzeros,
        max_steps: problem.max_iterations,
        nonnegative: problem.nonnegative,
    };
    let signal: Vec<f64> = problem.signal.iter().map(|&v| f64::from(v)).collect();
    let mut arrived = follow_path(dictionary, &signal, until, |_, _| {});
    if arrived.ended == Ended::IterationCap {
        // Stopped early: the gap is that for the requested λ.
        arrived.lambda = until.lambda;
    }
    let observed = ObservedProblem {
        dictionary,
        observation: Observation::Full,
        signal: &signal,
        lambda: arrived.lambda,
        goal: problem.goal,
        max_rounds: 1,
        nonnegative: until.nonnegative,
    };
    let gap = active_set_f64::gap_of_members(&observed, &arrived.members);
    let ended = match arrived.ended {
        Ended::Converged if gap > problem.goal => Ended::Stalled,
        other => other,
    };
    work.clear_code();
    for member in &arrived.members {
        work.code[member.atom] = member.value as f32;
        work.support.push(member.atom as u32);
    }
    Finished { gap, lambda: arrived.lambda as f32, iterations: arrived.steps, ended }
}
