//! Linear regression on many rows: sums of products in fixed chunks, and ridge regression
//! min over W of Σ w·‖xᵀW − y‖² + ρ‖W‖².

use lenslet_core::linalg::{self, Par, gram, product};
use ndarray::{Array2, ArrayView2, s};
use rayon::prelude::*;

use crate::error::Error;

/// Rows summed in f32 before the sums are added up in f64; fixed, so that sums do not depend on threads.
/// Source: chosen; rounding stays below that of single features.
pub const CHUNK: usize = 4096;

/// Chunks in work at once: bounds the memory of their sums.
/// Source: chosen.
const CHUNKS_AT_ONCE: usize = 16;

/// Ridge of [`ridge_regressor`], as a share of the mean square of a feature summed over the rows.
/// Source: chosen; only keeps features that depend on each other apart.
const RIDGE: f64 = 1e-6;

/// xᵀ·diag(w)·y over N rows, N×m and N×p, in f64 (w = 1 when not given): m×p.
#[must_use]
pub fn weighted_product(x: ArrayView2<'_, f32>, y: ArrayView2<'_, f32>, weights: Option<&[f32]>) -> Array2<f64> {
    sum_over_chunks(x.nrows(), (x.ncols(), y.ncols()), |first, last| {
        let (x, y) = (x.slice(s![first..last, ..]), y.slice(s![first..last, ..]));
        match weights {
            None => product(x.t(), y, Par::Seq),
            Some(w) => product(scaled_rows(x, &w[first..last], |w| w).t(), y, Par::Seq),
        }
    })
}

/// xᵀ·diag(w)·x over N rows in f64 (w = 1 when not given, otherwise at least 0): m×m, symmetric.
#[must_use]
pub fn weighted_gram(x: ArrayView2<'_, f32>, weights: Option<&[f32]>) -> Array2<f64> {
    sum_over_chunks(x.nrows(), (x.ncols(), x.ncols()), |first, last| {
        let x = x.slice(s![first..last, ..]);
        match weights {
            None => gram(x, Par::Seq),
            Some(w) => gram(scaled_rows(x, &w[first..last], f32::sqrt).view(), Par::Seq),
        }
    })
}

fn scaled_rows(x: ArrayView2<'_, f32>, weights: &[f32], factor: fn(f32) -> f32) -> Array2<f32> {
    let mut x = x.to_owned();
    x.rows_mut().into_iter().zip(weights).for_each(|(mut row, &w)| row *= factor(w));
    x
}

/// Sum over chunks of rows, in order, of what `part` gives for rows first..last.
fn sum_over_chunks(
    rows: usize,
    shape: (usize, usize),
    part: impl Fn(usize, usize) -> Array2<f32> + Sync,
) -> Array2<f64> {
    let starts: Vec<usize> = (0..rows).step_by(CHUNK).collect();
    let mut total = Array2::<f64>::zeros(shape);
    for group in starts.chunks(CHUNKS_AT_ONCE) {
        let parts: Vec<Array2<f32>> = group.par_iter().map(|&i| part(i, (i + CHUNK).min(rows))).collect();
        for part in parts {
            total.zip_mut_with(&part, |t, p| *t += f64::from(*p));
        }
    }
    total
}

/// W of (gram + ρI)·W = right, for a symmetric positive definite `gram`.
///
/// # Errors
/// [`Error::TooLittle`] when the matrix is not positive definite even so.
pub fn solve_normal_equations(gram: &Array2<f64>, right: &Array2<f64>, ridge: f64) -> Result<Array2<f64>, Error> {
    linalg::solve_ridge(gram.view(), right.view(), ridge)
        .map_err(|_| Error::TooLittle("the training pairs do not determine a regressor: more photos are needed".into()))
}

/// One ridge regressor (m×p) from features (N×m) to residuals (N×p), pairs weighted.
///
/// # Errors
/// As [`solve_normal_equations`].
///
/// ```
/// use lenslet_train::regression::ridge_regressor;
/// use ndarray::{Array2, array};
/// let x = Array2::from_shape_fn((50, 2), |(i, j)| ((i * (j + 2)) % 7) as f32 - 3.0);
/// let w = array![[2.0f32], [-1.0]];
/// let found = ridge_regressor(x.view(), x.dot(&w).view(), None)?;
/// assert!((&found - &w).iter().all(|d| d.abs() < 1e-4));
/// # Ok::<(), lenslet_train::Error>(())
/// ```
pub fn ridge_regressor(
    features: ArrayView2<'_, f32>,
    residuals: ArrayView2<'_, f32>,
    weights: Option<&[f32]>,
) -> Result<Array2<f32>, Error> {
    let gram = weighted_gram(features, weights);
    let right = weighted_product(features, residuals, weights);
    let mean = gram.diag().sum() / gram.nrows() as f64;
    Ok(solve_normal_equations(&gram, &right, RIDGE * mean)?.mapv(|v| v as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn a_planted_regressor_is_found() {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(1);
        let x = Array2::from_shape_fn((9000, 6), |_| rng.random::<f32>() - 0.5);
        let w = Array2::from_shape_fn((6, 3), |_| rng.random::<f32>());
        let y = x.dot(&w);
        let found = ridge_regressor(x.view(), y.view(), None).unwrap();
        assert!((&found - &w).iter().all(|d| d.abs() < 1e-3));
        let weights: Vec<f32> = (0..9000).map(|i| if i % 2 == 0 { 1.0 } else { 0.0 }).collect();
        let mut spoilt = y.clone();
        spoilt.rows_mut().into_iter().skip(1).step_by(2).for_each(|mut r| r.fill(9.0));
        let found = ridge_regressor(x.view(), spoilt.view(), Some(&weights)).unwrap();
        assert!((&found - &w).iter().all(|d| d.abs() < 1e-3));
    }

    #[test]
    fn singular_systems_are_errors() {
        let a = Array2::from_elem((3, 3), 1.0);
        assert!(solve_normal_equations(&a, &Array2::zeros((3, 1)), 0.0).is_err());
        assert!(solve_normal_equations(&a, &Array2::zeros((3, 1)), 1e-3).is_ok());
        assert!(solve_normal_equations(&Array2::from_elem((2, 2), f64::NAN), &Array2::zeros((2, 1)), 0.0).is_err());
    }
}
