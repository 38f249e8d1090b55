//! Products of matrices.

use faer::linalg::matmul::triangular::BlockStructure;
use faer::linalg::matmul::{matmul, triangular};
use faer::{Accum, MatMut, Par};
use ndarray::{Array2, ArrayView2};

use super::matrix::{Real, Stored};

/// a·b, for a of n×k and b of k×m: n×m.
///
/// # Panics
/// When the shapes do not fit.
///
/// ```
/// use lenslet_core::linalg::{Par, product};
/// use ndarray::array;
/// let a = array![[1.0f32, 2.0], [3.0, 4.0]];
/// assert_eq!(product(a.view(), a.t(), Par::Seq), array![[5.0, 11.0], [11.0, 25.0]]);
/// ```
#[must_use]
pub fn product<T: Real>(a: ArrayView2<'_, T>, b: ArrayView2<'_, T>, par: Par) -> Array2<T> {
    let mut out = Array2::zeros((a.nrows(), b.ncols()));
    product_into_columns(&mut out, 0, a, b, par);
    out
}

/// Writes a·b over the columns `first..first + b.ncols()` of `out`, whose rows must be contiguous.
///
/// # Panics
/// When the shapes do not fit, or `out` is not in row-major order.
///
/// ```
/// use lenslet_core::linalg::{Par, product_into_columns};
/// use ndarray::{Array2, array};
/// let mut out = Array2::from_elem((1, 3), 9.0f32);
/// product_into_columns(&mut out, 1, array![[1.0, 2.0]].view(), array![[3.0, 0.0], [0.0, 4.0]].view(), Par::Seq);
/// assert_eq!(out, array![[9.0, 3.0, 8.0]]);
/// ```
pub fn product_into_columns<T: Real>(
    out: &mut Array2<T>,
    first: usize,
    a: ArrayView2<'_, T>,
    b: ArrayView2<'_, T>,
    par: Par,
) {
    let ((rows, columns), count) = (out.dim(), b.ncols());
    let (a, b) = (Stored::of(a), Stored::of(b));
    let contiguous = out.as_slice_mut();
    assert!(contiguous.is_some(), "the output of a product must be in row-major order");
    if let Some(values) = contiguous {
        let out = MatMut::from_row_major_slice_mut(values, rows, columns).subcols_mut(first, count);
        matmul(out, Accum::Replace, a.view(), b.view(), T::one(), par);
    }
}

/// The Gram matrix aᵀ·a of the columns of a, at half the work of a product, and exactly symmetric.
///
/// ```
/// use lenslet_core::linalg::{Par, gram};
/// use ndarray::array;
/// let a = array![[1.0f64, 2.0], [3.0, 4.0], [0.0, 1.0]];
/// assert_eq!(gram(a.view(), Par::Seq), array![[10.0, 14.0], [14.0, 21.0]]);
/// assert_eq!(gram(a.t(), Par::Seq), a.dot(&a.t()));
/// ```
#[must_use]
pub fn gram<T: Real>(a: ArrayView2<'_, T>, par: Par) -> Array2<T> {
    let n = a.ncols();
    let a = Stored::of(a);
    let mut out = Array2::zeros((n, n));
    if let Some(values) = out.as_slice_mut() {
        let full = BlockStructure::Rectangular;
        let (a, out) = (a.view(), MatMut::from_row_major_slice_mut(values, n, n));
        let lower = BlockStructure::TriangularLower;
        triangular::matmul(out, lower, Accum::Replace, a.transpose(), full, a, full, T::one(), par);
    }
    for i in 0..n {
        for j in i + 1..n {
            out[[i, j]] = out[[j, i]];
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::s;
    use rand::{RngExt, SeedableRng};

    fn random(rows: usize, columns: usize, seed: u64) -> Array2<f64> {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(seed);
        Array2::from_shape_fn((rows, columns), |_| rng.random::<f64>() - 0.5)
    }

    /// The three nested loops.
    fn plain(a: ArrayView2<'_, f64>, b: ArrayView2<'_, f64>) -> Array2<f64> {
        Array2::from_shape_fn((a.nrows(), b.ncols()), |(i, j)| (0..a.ncols()).map(|k| a[[i, k]] * b[[k, j]]).sum())
    }

    #[test]
    fn products_equal_the_nested_loops_in_every_layout() {
        let (a, b) = (random(7, 12, 1), random(5, 12, 2));
        let cut = a.slice(s![1..;2, ..]);
        for (a, b) in [(a.view(), b.t()), (b.view(), a.t()), (cut, b.t()), (cut.t(), cut)] {
            let found = product(a, b, Par::Seq);
            assert!((&found - &plain(a, b)).iter().all(|d| d.abs() < 1e-12));
            let single = product(a.mapv(|v| v as f32).view(), b.mapv(|v| v as f32).view(), Par::Seq);
            assert!((&found - &single.mapv(f64::from)).iter().all(|d| d.abs() < 1e-5));
        }
        assert_eq!(product(random(3, 0, 1).view(), random(0, 2, 1).view(), Par::Seq), Array2::<f64>::zeros((3, 2)));
    }

    #[test]
    fn gram_matrices_equal_products() {
        for a in [random(9, 33, 3), random(40, 8, 4), random(0, 3, 5)] {
            let found = gram(a.view(), Par::Seq);
            assert!((&found - &plain(a.t(), a.view())).iter().all(|d| d.abs() < 1e-12));
            assert_eq!(found, found.t());
        }
    }
}
