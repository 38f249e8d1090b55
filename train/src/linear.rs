//! Linear algebra of training: products over many rows in fixed chunks, and least squares min ‖XW − Y‖² + ρ‖W‖².

use ndarray::{Array1, Array2, ArrayView2, s};
use rayon::prelude::*;

use super::Error;

/// Rows summed in f32 before they are added up in f64; fixed, so that sums do not depend on threads.
pub const CHUNK: usize = 4096;

/// aᵀ·diag(w)·b over N rows, in f64 (w = 1 when not given).
#[must_use]
pub fn moments(a: ArrayView2<'_, f32>, b: ArrayView2<'_, f32>, weights: Option<&[f32]>) -> Array2<f64> {
    let n = a.nrows();
    let starts: Vec<usize> = (0..n).step_by(CHUNK).collect();
    let mut total = Array2::<f64>::zeros((a.ncols(), b.ncols()));
    for group in starts.chunks(16) {
        let parts: Vec<Array2<f32>> = group
            .par_iter()
            .map(|&i| {
                let rows = i..(i + CHUNK).min(n);
                let (a, b) = (a.slice(s![rows.clone(), ..]), b.slice(s![rows.clone(), ..]));
                match weights {
                    None => a.t().dot(&b),
                    Some(w) => {
                        let mut a = a.to_owned();
                        a.rows_mut().into_iter().zip(&w[rows]).for_each(|(mut row, &w)| row *= w);
                        a.t().dot(&b)
                    }
                }
            })
            .collect();
        for part in parts {
            total.zip_mut_with(&part, |t, p| *t += f64::from(*p));
        }
    }
    total
}

/// Solves (gram + ρI)·W = right for symmetric positive gram.
///
/// # Errors
/// [`Error::TooLittle`] when the matrix is not positive definite even so.
pub fn solve(gram: &Array2<f64>, right: &Array2<f64>, ridge: f64) -> Result<Array2<f64>, Error> {
    let n = gram.nrows();
    let mut a = gram.clone();
    for i in 0..n {
        a[[i, i]] += ridge;
    }
    let mut x = right.clone();
    if cholesky(&mut a) {
        substitute(&a, &mut x);
        Ok(x)
    } else {
        Err(Error::TooLittle("the training pairs do not determine a regressor: more photos are needed".into()))
    }
}

/// In-place Cholesky factor in the lower triangle; false when the matrix is not positive definite.
pub(crate) fn cholesky(a: &mut Array2<f64>) -> bool {
    let n = a.nrows();
    for j in 0..n {
        let (above, mut below) = a.view_mut().split_at(ndarray::Axis(0), j + 1);
        let row = above.row(j);
        let d = row[j] - row.slice(s![..j]).dot(&row.slice(s![..j]));
        // A pivot below the rounding of its column counts as none.
        if !(d > 1e-13 * row[j].abs()) || !d.is_finite() {
            return false;
        }
        let root = d.sqrt();
        let head: Array1<f64> = row.slice(s![..j]).to_owned();
        for mut other in below.rows_mut() {
            let v = other[j] - other.slice(s![..j]).dot(&head);
            other[j] = v / root;
        }
        a[[j, j]] = root;
    }
    true
}

/// Solves L·Lᵀ·X = B in place, B with one or more columns.
pub(crate) fn substitute(l: &Array2<f64>, b: &mut Array2<f64>) {
    let n = l.nrows();
    for i in 0..n {
        let (done, mut rest) = b.view_mut().split_at(ndarray::Axis(0), i);
        let mut row = rest.row_mut(0);
        for (j, other) in done.rows().into_iter().enumerate() {
            row.scaled_add(-l[[i, j]], &other);
        }
        row /= l[[i, i]];
    }
    for i in (0..n).rev() {
        let (mut head, rest) = b.view_mut().split_at(ndarray::Axis(0), i + 1);
        let mut row = head.row_mut(i);
        for (j, other) in rest.rows().into_iter().enumerate() {
            row.scaled_add(-l[[i + 1 + j, i]], &other);
        }
        row /= l[[i, i]];
    }
}

/// One ridge regressor (m×p) from features to residuals, pairs weighted.
///
/// # Errors
/// As [`solve`].
pub fn ridge(
    features: ArrayView2<'_, f32>,
    residuals: ArrayView2<'_, f32>,
    weights: Option<&[f32]>,
) -> Result<Array2<f32>, Error> {
    let gram = moments(features, features, weights);
    let right = moments(features, residuals, weights);
    let mean = gram.diag().sum() / gram.nrows() as f64;
    Ok(solve(&gram, &right, 1e-6 * mean)?.mapv(|v| v as f32))
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
        let found = ridge(x.view(), y.view(), None).unwrap();
        assert!((&found - &w).iter().all(|d| d.abs() < 1e-3));
        let weights: Vec<f32> = (0..9000).map(|i| if i % 2 == 0 { 1.0 } else { 0.0 }).collect();
        let mut spoilt = y.clone();
        spoilt.rows_mut().into_iter().skip(1).step_by(2).for_each(|mut r| r.fill(9.0));
        let found = ridge(x.view(), spoilt.view(), Some(&weights)).unwrap();
        assert!((&found - &w).iter().all(|d| d.abs() < 1e-3));
    }

    #[test]
    fn singular_systems_are_errors() {
        let a = Array2::from_elem((3, 3), 1.0);
        assert!(solve(&a, &Array2::zeros((3, 1)), 0.0).is_err());
        assert!(solve(&a, &Array2::zeros((3, 1)), 1e-3).is_ok());
        assert!(solve(&Array2::from_elem((2, 2), f64::NAN), &Array2::zeros((2, 1)), 0.0).is_err());
    }
}
