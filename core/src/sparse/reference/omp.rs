//! Orthogonal matching pursuit (Batch-OMP, Rubinstein et al. 2008): greedy min ½‖y − Dᵀφ‖² with at most T non-zeros.
//!
//! The plain reference, in f64, of [`crate::sparse::kernel::pursuit_f32`]. Each step takes the atom most correlated
//! with the residual, then refits all of them by least squares, through a Cholesky factor of the support's Gram matrix
//! that grows by one row per step. Correlations are updated, not residuals.

use crate::sparse::problem::{Ended, Finished, Problem, Work};

/// Codes one signal with at most `problem.max_nonzeros` atoms.
pub(crate) fn solve(problem: &Problem<'_>, work: &mut Work) -> Finished {
    work.clear_code();
    let dictionary = problem.dictionary;
    let most = problem.max_nonzeros.min(dictionary.signal_len()).min(dictionary.atom_count());
    work.gradient.copy_from_slice(problem.correlations);
    let energy: f64 = problem.signal.iter().map(|&v| f64::from(v) * f64::from(v)).sum();
    let stop = (1e-6 * energy.sqrt()) as f32;
    let (mut factor, mut rhs) = (vec![0.0f64; most * most], vec![0.0f64; most]);
    let mut iterations = 0;
    while work.support.len() < most {
        let mut best = (stop, usize::MAX);
        for (j, &c) in work.gradient.iter().enumerate() {
            let size = if problem.nonnegative { c } else { c.abs() };
            if size > best.0 && !work.support.contains(&(j as u32)) {
                best = (size, j);
            }
        }
        let Some(row) = (best.1 != usize::MAX).then(|| dictionary.gram_row(best.1)) else { break };
        iterations += 1;
        // A row of the Cholesky factor for the new atom.
        let n = work.support.len();
        for i in 0..n {
            let mut v = f64::from(row[work.support[i] as usize]);
            for l in 0..i {
                v -= factor[i * most + l] * factor[n * most + l];
            }
            factor[n * most + i] = v / factor[i * most + i];
        }
        let left: f64 = f64::from(row[best.1]) - (0..n).map(|l| factor[n * most + l].powi(2)).sum::<f64>();
        if left <= 1e-7 {
            break; // The atom adds nothing to the span so far.
        }
        factor[n * most + n] = left.sqrt();
        work.support.push(best.1 as u32);
        // Refit: forward, then backward.
        let n = n + 1;
        for i in 0..n {
            let mut v = f64::from(problem.correlations[work.support[i] as usize]);
            for l in 0..i {
                v -= factor[i * most + l] * rhs[l];
            }
            rhs[i] = v / factor[i * most + i];
        }
        for i in (0..n).rev() {
            for l in i + 1..n {
                rhs[i] -= factor[l * most + i] * rhs[l];
            }
            rhs[i] /= factor[i * most + i];
        }
        if problem.nonnegative && rhs[..n].iter().any(|&v| v < 0.0) {
            work.support.pop();
            break; // The next refit has a negative coefficient.
        }
        work.gradient.copy_from_slice(problem.correlations);
        for (i, &v) in rhs[..n].iter().enumerate() {
            let j = work.support[i] as usize;
            work.code[j] = v as f32;
            for (c, &g) in work.gradient.iter_mut().zip(dictionary.gram_row(j)) {
                *c -= v as f32 * g;
            }
        }
    }
    Finished { gap: f64::NAN, lambda: 0.0, iterations, ended: Ended::Converged }
}
