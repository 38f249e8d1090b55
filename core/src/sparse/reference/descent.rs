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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sparse::prepared::prepare;

    #[test]
    fn descent_ends_at_once_with_nothing_to_do_and_where_rounding_stops_it() {
        let h = 0.75f32.sqrt();
        let dictionary = prepare(ndarray::arr2(&[[1.0, 0.0], [-0.5, h]]).view()).unwrap();
        let solve_for = |signal: [f32; 2], goal: f64| {
            let atoms = [0, 1].map(|k| dictionary.atom(k));
            let correlations = atoms.map(|a| a[0] * signal[0] + a[1] * signal[1]);
            let lambda_max = correlations.iter().fold(0.0f32, |m, c| m.max(c.abs()));
            let problem = Problem {
                dictionary: &dictionary,
                signal: &signal,
                correlations: &correlations,
                lambda_max,
                lambda: 0.1 * lambda_max,
                goal,
                max_iterations: 100_000,
                nonnegative: false,
                max_nonzeros: usize::MAX,
            };
            let mut work = Work::new(&dictionary);
            let finished = solve(&problem, &mut work);
            // The gap computed the gradient anew, whatever it held.
            work.gradient.fill(9.0);
            work.gap(&problem);
            for (k, &g) in work.gradient.iter().enumerate() {
                let atom = dictionary.atom(k).iter();
                let exact: f64 = atom.zip(&work.residual).map(|(&a, r)| f64::from(a) * r).sum();
                assert!((f64::from(g) - exact).abs() < 1e-6, "{k}: {g} {exact}");
            }
            finished
        };
        let nothing = solve_for([0.0; 2], 0.0);
        assert_eq!((nothing.ended, nothing.iterations), (Ended::Converged, 2));
        let stopped = solve_for([1.0, 0.7], -1.0);
        assert_eq!(stopped.ended, Ended::Stalled);
        assert!(stopped.iterations < 200 && stopped.gap < 1e-6, "{stopped:?}");
    }
}
