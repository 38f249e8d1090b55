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

#[cfg(test)]
mod tests {
    use crate::linalg::gauss_with_back_substitution;
    use crate::sparse::{Options, Penalty, Solver, prepare, solve};
    use ndarray::{Array1, Array2};
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    /// Coefficients of the least squares fit of atoms to a signal, from the normal equations.
    fn fit(atoms: &Array2<f64>, support: &[usize], y: &Array1<f64>) -> Vec<f64> {
        let n = support.len();
        let mut system = vec![0.0; n * (n + 1)];
        for i in 0..n {
            for j in 0..n {
                system[i * (n + 1) + j] = atoms.row(support[i]).dot(&atoms.row(support[j]));
            }
            system[i * (n + 1) + n] = atoms.row(support[i]).dot(y);
        }
        gauss_with_back_substitution(&mut system, n, n + 1, 1e-12).unwrap();
        (0..n).map(|i| system[i * (n + 1) + n]).collect()
    }

    /// The definition: the atom most correlated with the residual, then the fit of all so far.
    fn plain(atoms: &Array2<f64>, y: &Array1<f64>, most: usize, nonnegative: bool) -> Vec<f64> {
        let (mut support, mut values): (Vec<usize>, Vec<f64>) = (Vec::new(), Vec::new());
        while support.len() < most {
            let mut fitted: Array1<f64> = Array1::zeros(y.len());
            for (&j, v) in support.iter().zip(&values) {
                fitted.scaled_add(*v, &atoms.row(j));
            }
            let c = atoms.dot(&(y - &fitted));
            let size = |j: usize| if nonnegative { c[j] } else { c[j].abs() };
            let free = (0..c.len()).filter(|j| !support.contains(j) && size(*j) > 1e-6 * y.dot(y).sqrt());
            let Some(best) = free.max_by(|&i, &j| size(i).total_cmp(&size(j))) else { break };
            support.push(best);
            let refit = fit(atoms, &support, y);
            if nonnegative && refit.iter().any(|v| *v < 0.0) {
                support.pop();
                break;
            }
            values = refit;
        }
        let mut code = vec![0.0; atoms.nrows()];
        support.iter().zip(values).for_each(|(&j, v)| code[j] = v);
        code
    }

    #[test]
    fn equals_the_definition_with_and_without_signs() {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let mut atoms = Array2::from_shape_fn((60, 40), |_| rng.random::<f32>() - 0.4);
        atoms.rows_mut().into_iter().for_each(|mut r| r /= r.dot(&r).sqrt());
        let signals = Array2::from_shape_fn((30, 40), |_| rng.random::<f32>() - 0.3);
        let dictionary = prepare(atoms.view()).unwrap();
        let exact = atoms.mapv(f64::from);
        // 36 are more than the blocked pursuit takes.
        for (most, nonnegative) in [(1, true), (4, true), (12, true), (36, false)] {
            let options =
                Options { solver: Solver::Omp, penalty: Penalty::NonZeros(most), nonnegative, ..Options::default() };
            let codes = solve(&dictionary, signals.view(), &options).unwrap().to_dense(60).unwrap();
            let mut used = 0;
            for (code, y) in codes.rows().into_iter().zip(signals.rows()) {
                let truth = plain(&exact, &y.mapv(f64::from), most, nonnegative);
                used = used.max(truth.iter().filter(|v| **v != 0.0).count());
                for (a, b) in code.iter().zip(&truth) {
                    assert!((f64::from(*a) - b).abs() < 1e-3 * (1.0 + b.abs()), "{most} {nonnegative}: {a} {b}");
                }
            }
            assert!(used > 1 || most == 1, "{used} atoms at most");
        }
    }
}
