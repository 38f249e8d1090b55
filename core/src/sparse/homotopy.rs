//! Homotopy (LARS-lasso, Osborne et al. 2000, Efron et al. 2004): the minimisers of ½‖y − Dᵀφ‖² + λ‖φ‖₁ for all λ downwards.
//!
//! Between two knots φ_S moves along G_SS⁻¹θ and all correlations of the support shrink alike; a knot is where an atom
//! outside reaches them, a coefficient reaches zero, or the wanted λ or number of non-zeros is met. In f64, from residuals.

use super::exact::{self, Member, Seen};
use super::prepared::Prepared;
use super::solve::Finished;
use super::{Ended, Error};
use ndarray::ArrayView1;

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

/// Where the path ends.
#[derive(Clone, Copy)]
pub(super) struct Until {
    pub lambda: f64,
    pub nonzeros: usize,
    pub max_steps: u32,
    pub nonnegative: bool,
}

/// What [`follow`] arrives at.
pub(super) struct Arrived {
    pub members: Vec<Member>,
    pub lambda: f64,
    pub steps: u32,
    pub ended: Ended,
}

/// The path of one signal (m values) from λ_max down to `lambda`, with at most `max_steps` knots. Between two knots the
/// minimisers are linear in λ.
///
/// # Errors
/// A signal that is not finite or does not fit, a negative λ.
pub fn path(
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
    if !(lambda.is_finite() && lambda >= 0.0) {
        return Err(Error::Parameter(format!("λ must be a number of at least 0, not {lambda}")));
    }
    let signal: Vec<f64> = signal.iter().map(|&v| f64::from(v)).collect();
    let max_steps = u32::try_from(max_steps).unwrap_or(u32::MAX);
    let until = Until { lambda, nonzeros: usize::MAX, max_steps, nonnegative };
    let mut knots = Vec::new();
    follow(dictionary, &signal, until, |lambda, members| {
        let shown = || members.iter().filter(|m| m.value != 0.0);
        knots.push(Knot {
            lambda,
            atoms: shown().map(|m| dictionary.outside(m.atom as u32)).collect(),
            values: shown().map(|m| m.value).collect(),
        });
    });
    Ok(knots)
}

/// Follows the path; tells every knot.
pub(super) fn follow(
    dictionary: &Prepared,
    signal: &[f64],
    until: Until,
    mut knot: impl FnMut(f64, &[Member]),
) -> Arrived {
    let k = dictionary.atom_count();
    let mut c = vec![0.0f64; k];
    exact::correlate_whole(dictionary, signal, &mut c);
    let size = |c: f64| if until.nonnegative { c } else { c.abs() };
    let (start, mut lambda) =
        c.iter().enumerate().fold((0, 0.0f64), |best, (j, &c)| if size(c) > best.1 { (j, size(c)) } else { best });
    let scale = lambda;
    let mut members: Vec<Member> = Vec::new();
    let mut direction = vec![0.0f64; k];
    let mut joining = (lambda > until.lambda && until.nonzeros > 0).then_some(start);
    // Atoms that depend on the support, and the one that just left.
    let mut barred: Vec<usize> = Vec::new();
    let mut left = usize::MAX;
    // Atoms that touch the bound but move inwards (copies of one that left), until the next step of some length.
    let mut waiting: Vec<usize> = Vec::new();
    let mut steps = 0;
    knot(lambda, &members);
    loop {
        if let Some(atom) = joining.take() {
            let column = exact::seen_atom(dictionary, Seen::Whole, atom);
            if exact::depends(&members, &column) {
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
        let Some(w) = exact::solve_gram(&members, &signs) else {
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
        exact::correlate_whole(dictionary, &along, &mut direction);
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

/// Solves one signal: (atoms of the order inside, values), λ where it ended, and how.
pub(super) fn solve(
    dictionary: &Prepared,
    signal: &[f32],
    until: Until,
    goal: f64,
) -> (Vec<(u32, f32)>, f32, Finished) {
    let signal: Vec<f64> = signal.iter().map(|&v| f64::from(v)).collect();
    let mut arrived = follow(dictionary, &signal, until, |_, _| {});
    if arrived.ended == Ended::IterationCap {
        // Not there yet: judged by the λ that was wanted.
        arrived.lambda = until.lambda;
    }
    let task = exact::Task {
        dictionary,
        seen: Seen::Whole,
        signal: &signal,
        lambda: arrived.lambda,
        goal,
        max_rounds: 1,
        nonnegative: until.nonnegative,
    };
    let gap = exact::gap_of(&task, &arrived.members);
    let ended = match arrived.ended {
        Ended::Converged if gap > goal => Ended::Stalled,
        other => other,
    };
    let entries = arrived.members.iter().map(|m| (m.atom as u32, m.value as f32)).collect();
    (entries, arrived.lambda as f32, Finished { gap, iterations: arrived.steps, ended })
}
