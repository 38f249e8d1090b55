//! Coordinate descent on the Gram matrix: min ½‖y − Dᵀφ‖² + λ‖φ‖₁, one coordinate at a time, mostly over the support.
//!
//! The gradient c = D y − G φ is kept up to date and computed anew with every gap; a full sweep alternates with sweeps
//! over the support until those settle.

use crate::sparse::problem::{Ended, Finished, Problem, Work};

/// Solves one signal; leaves its code in `work.code` (dense over atoms, zero elsewhere) and its support in
/// `work.support`.
pub(crate) fn solve(problem: &Problem<'_>, work: &mut Work) -> Finished {
    let k = problem.dictionary.atom_count();
    let lambda = problem.lambda;
    let goal = problem.goal;
    work.clear_code();
    work.gradient.copy_from_slice(problem.correlations);
    let mut iterations = 0;
    let mut last = f64::INFINITY;
    let mut settled = 1e-4f32 * problem.lambda_max;
    loop {
        iterations += 1;
        for j in 0..k {
            minimise_coordinate(problem, work, j, lambda);
        }
        // Sweeps over the support, until they move nothing by more than `settled`.
        for _ in 0..200 {
            iterations += 1;
            let mut moved = 0.0f32;
            for i in 0..work.support.len() {
                let j = work.support[i] as usize;
                moved = moved.max(minimise_coordinate(problem, work, j, lambda));
            }
            if moved <= settled || iterations >= problem.max_iterations {
                break;
            }
        }
        let gap = work.gap(problem);
        if gap <= goal {
            return problem.finished(gap, iterations, Ended::Converged);
        }
        if iterations >= problem.max_iterations {
            return problem.finished(gap, iterations, Ended::IterationCap);
        }
        let floor = 1e-8 * problem.lambda_max;
        if settled <= floor && gap >= 0.999 * last {
            return problem.finished(gap, iterations, Ended::Stalled);
        }
        settled = (settled * 0.1).max(floor);
        last = gap;
    }
}

/// Moves one coordinate to its minimum; returns the size of the change.
fn minimise_coordinate(problem: &Problem<'_>, work: &mut Work, j: usize, lambda: f32) -> f32 {
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
