//! Proximal gradient, min ½‖y − Dᵀφ‖² + λ‖φ‖₁: ISTA, φ ← soft(φ + (Dy − Gφ)/L, λ/L), and FISTA (Beck & Teboulle 2009).
//!
//! The textbook solvers, kept as oracles of the others. L is an upper bound of the largest eigenvalue of G.

use crate::sparse::prepared::Prepared;
use crate::sparse::problem::{Ended, Finished, Problem, Work};

/// Iterations between two computations of the gap.
///
/// Source: chosen.
const BETWEEN_GAPS: u32 = 10;

/// The largest eigenvalue of G by power iteration from a fixed start, and 1 % more, so that it is an upper bound.
fn largest_eigenvalue(dictionary: &Prepared) -> f32 {
    let k = dictionary.atom_count();
    let mut v: Vec<f64> = (0..k).map(|i| 1.0 + 0.5 * ((i * 7919 % 101) as f64 / 101.0 - 0.5)).collect();
    let mut value = 1.0;
    for _ in 0..200 {
        let product: Vec<f64> =
            (0..k).map(|i| dictionary.gram_row(i).iter().zip(&v).map(|(&g, &v)| f64::from(g) * v).sum()).collect();
        let norm = product.iter().map(|p| p * p).sum::<f64>().sqrt();
        if norm == 0.0 {
            break;
        }
        let done = (norm - value).abs() < 1e-9 * norm;
        value = norm;
        v = product.iter().map(|p| p / norm).collect();
        if done {
            break;
        }
    }
    (value * 1.01) as f32
}

/// Solves one signal by ISTA.
pub(crate) fn ista(problem: &Problem<'_>, work: &mut Work) -> Finished {
    descend(problem, work, false)
}

/// Solves one signal by FISTA.
pub(crate) fn fista(problem: &Problem<'_>, work: &mut Work) -> Finished {
    descend(problem, work, true)
}

fn descend(problem: &Problem<'_>, work: &mut Work, accelerated: bool) -> Finished {
    let k = problem.dictionary.atom_count();
    let eigenvalue = *work.eigenvalue.get_or_insert_with(|| largest_eigenvalue(problem.dictionary));
    work.clear_code();
    // FISTA steps from a point beyond the code; ISTA's point is the code.
    let mut point = vec![0.0f32; k];
    let (step, shrink) = (1.0 / eigenvalue, problem.lambda / eigenvalue);
    let mut momentum = 1.0f32;
    let mut iterations = 0;
    loop {
        if iterations % BETWEEN_GAPS == 0 || iterations >= problem.max_iterations {
            work.support = (0..k as u32).filter(|&j| work.code[j as usize] != 0.0).collect();
            let gap = work.gap(problem);
            if gap <= problem.goal {
                return problem.finished(gap, iterations, Ended::Converged);
            }
            if iterations >= problem.max_iterations {
                return problem.finished(gap, iterations, Ended::IterationCap);
            }
        }
        iterations += 1;
        work.gradient.copy_from_slice(problem.correlations);
        for (j, &value) in point.iter().enumerate().filter(|p| *p.1 != 0.0) {
            for (c, &g) in work.gradient.iter_mut().zip(problem.dictionary.gram_row(j)) {
                *c -= value * g;
            }
        }
        let next = 0.5 * (1.0 + (1.0 + 4.0 * momentum * momentum).sqrt());
        let beyond = if accelerated { (momentum - 1.0) / next } else { 0.0 };
        momentum = next;
        for ((code, point), &c) in work.code.iter_mut().zip(&mut point).zip(&work.gradient) {
            let moved = *point + step * c;
            let new = if moved > shrink {
                moved - shrink
            } else if moved < -shrink && !problem.nonnegative {
                moved + shrink
            } else {
                0.0
            };
            *point = new + beyond * (new - *code);
            *code = new;
        }
    }
}
