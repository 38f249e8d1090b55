//! Coordinate descent on the Gram matrix: min ½‖y − Dᵀφ‖² + λ‖φ‖₁, one coordinate at a time, mostly over the support.
//!
//! The gradient c = D y − G φ is kept up to date; a full sweep alternates with sweeps over the support until those settle.

use super::solve::{Finished, Problem, Work};
use super::{Ended, gap};

/// Solves one signal; leaves its code in `work.code` (dense over atoms, zero elsewhere) and its support in `work.support`.
pub(super) fn solve(problem: &Problem<'_>, work: &mut Work) -> Finished {
    let k = problem.dictionary.atom_count();
    let lambda = problem.lambda;
    let goal = problem.goal;
    work.clear_code();
    work.gradient.copy_from_slice(problem.correlations);
    let mut iterations = 0;
    let mut last = f64::INFINITY;
    let mut settled = 1e-4f32 * problem.largest;
    loop {
        iterations += 1;
        for j in 0..k {
            step(problem, work, j, lambda);
        }
        // Sweeps over the support, until they move nothing by more than `settled`.
        for _ in 0..200 {
            iterations += 1;
            let mut moved = 0.0f32;
            for i in 0..work.support.len() {
                let j = work.support[i] as usize;
                moved = moved.max(step(problem, work, j, lambda));
            }
            if moved <= settled || iterations >= problem.max_iterations {
                break;
            }
        }
        let gap = full_gap(problem, work);
        if gap <= goal {
            return Finished { gap, iterations, ended: Ended::Converged };
        }
        if iterations >= problem.max_iterations {
            return Finished { gap, iterations, ended: Ended::IterationCap };
        }
        let floor = 1e-8 * problem.largest;
        if settled <= floor && gap >= 0.999 * last {
            return Finished { gap, iterations, ended: Ended::Stalled };
        }
        if settled <= floor {
            refresh(problem, work);
        }
        settled = (settled * 0.1).max(floor);
        last = gap;
    }
}

/// One coordinate to its minimum; the change made.
fn step(problem: &Problem<'_>, work: &mut Work, j: usize, lambda: f32) -> f32 {
    let row = problem.dictionary.gram_row(j);
    let old = work.code[j];
    let pull = work.gradient[j] + row[j] * old;
    let new = if pull > lambda {
        (pull - lambda) / row[j]
    } else if pull < -lambda && !problem.nonnegative {
        (pull + lambda) / row[j]
    } else {
        0.0
    };
    let change = new - old;
    if change != 0.0 {
        work.code[j] = new;
        if old == 0.0 && !work.support.contains(&(j as u32)) {
            work.support.push(j as u32);
        }
        for (c, &g) in work.gradient.iter_mut().zip(row) {
            *c -= change * g;
        }
    }
    change.abs()
}

/// The gap in f64 with all correlations computed anew.
fn full_gap(problem: &Problem<'_>, work: &mut Work) -> f64 {
    let norm1 = work.residual(problem);
    let mut largest = 0.0f64;
    for j in 0..problem.dictionary.atom_count() {
        let c = gap::dot(problem.dictionary.atom(j), &work.residual);
        largest = largest.max(if problem.nonnegative { c } else { c.abs() });
    }
    let signal = problem.signal.iter().map(|&v| f64::from(v));
    gap::certify(signal, &work.residual, norm1, f64::from(problem.lambda), largest).gap
}

/// The gradient anew from the f64 residual, against drift.
fn refresh(problem: &Problem<'_>, work: &mut Work) {
    for j in 0..problem.dictionary.atom_count() {
        work.gradient[j] = gap::dot(problem.dictionary.atom(j), &work.residual) as f32;
    }
}
