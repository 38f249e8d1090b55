//! Proximal gradient, min ½‖y − Dᵀφ‖² + λ‖φ‖₁: ISTA, φ ← soft(φ + (Dy − Gφ)/L, λ/L), and FISTA (Beck & Teboulle 2009).
//!
//! The textbook's way, kept as an oracle of the others. L bounds the largest eigenvalue of G.

use super::prepared::Prepared;
use super::solve::{Finished, Problem, Work};
use super::{Ended, Solver};

/// Iterations between two looks at the gap.
const BETWEEN_GAPS: u32 = 10;

/// The largest eigenvalue of G, from above by a hair: power iteration from a fixed start, 1 % on top.
pub(super) fn largest_eigenvalue(dictionary: &Prepared) -> f32 {
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

/// Solves one signal by ISTA, or FISTA where `solver` says so.
pub(super) fn solve(problem: &Problem<'_>, work: &mut Work, solver: Solver, eigenvalue: f32) -> Finished {
    let k = problem.dictionary.atom_count();
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
                return Finished { gap, iterations, ended: Ended::Converged };
            }
            if iterations >= problem.max_iterations {
                return Finished { gap, iterations, ended: Ended::IterationCap };
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
        let beyond = if solver == Solver::Fista { (momentum - 1.0) / next } else { 0.0 };
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
