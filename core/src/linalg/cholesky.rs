//! Symmetric positive definite systems by the Cholesky factor A = L·Lᵀ; ridge and least squares by means of it.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::{Mat, Par};
use ndarray::{Array2, ArrayView2};

use super::matrix::{Real, array, owned};
use super::{Error, gram, product};

/// The factor L of A = L·Lᵀ.
///
/// ```
/// use lenslet_core::linalg::Cholesky;
/// use ndarray::array;
/// let factor = Cholesky::new(array![[4.0, 2.0], [2.0, 5.0]].view())?;
/// assert_eq!(factor.solve(array![[8.0], [12.0]].view()), array![[1.0], [2.0]]);
/// assert!(Cholesky::new(array![[1.0, 2.0], [2.0, 1.0]].view()).is_err());
/// # Ok::<(), lenslet_core::linalg::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Cholesky<T: Real> {
    /// L in the lower triangle.
    factor: Mat<T>,
}

impl<T: Real> Cholesky<T> {
    /// Factors a symmetric matrix, of which the lower triangle alone is read.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`]; a pivot below 1e-13 times its diagonal entry (2e-6 for f32) counts as not
    /// positive.
    ///
    /// # Panics
    /// When the matrix is not square.
    pub fn new(matrix: ArrayView2<'_, T>) -> Result<Self, Error> {
        let n = matrix.nrows();
        assert_eq!(n, matrix.ncols(), "a symmetric matrix is square");
        let mut factor = owned(matrix);
        let need = llt::factor::cholesky_in_place_scratch::<T>(n, Par::Seq, Default::default());
        let mut memory = MemBuffer::new(need);
        let stack = MemStack::new(&mut memory);
        llt::factor::cholesky_in_place(factor.as_mut(), Default::default(), Par::Seq, stack, Default::default())
            .map_err(|_| Error::NotPositiveDefinite)?;
        let sound = (0..n).all(|i| {
            let pivot = factor[(i, i)];
            pivot.is_finite() && pivot * pivot > T::LEAST_PIVOT * matrix[[i, i]].abs()
        });
        if sound { Ok(Self { factor }) } else { Err(Error::NotPositiveDefinite) }
    }

    /// X of A·X = B, for B of n×k.
    ///
    /// # Panics
    /// When B has another number of rows than A.
    #[must_use]
    pub fn solve(&self, right: ArrayView2<'_, T>) -> Array2<T> {
        let mut x = owned(right);
        let need = llt::solve::solve_in_place_scratch::<T>(x.nrows(), x.ncols(), Par::Seq);
        let mut memory = MemBuffer::new(need);
        llt::solve::solve_in_place(self.factor.as_ref(), x.as_mut(), Par::Seq, MemStack::new(&mut memory));
        array(&x)
    }

    /// L, with zeros above the diagonal.
    #[must_use]
    pub fn lower(&self) -> Array2<T> {
        let n = self.factor.nrows();
        Array2::from_shape_fn((n, n), |(i, j)| if j > i { T::zero() } else { self.factor[(i, j)] })
    }
}

/// X of (A + ρI)·X = B for a symmetric A (n×n) whose lower triangle is read, and B of n×k.
///
/// # Errors
/// [`Error::NotPositiveDefinite`] when A + ρI is not.
///
/// # Panics
/// When the shapes do not fit.
///
/// ```
/// use lenslet_core::linalg::solve_ridge;
/// use ndarray::array;
/// let x = solve_ridge(array![[1.0f64, 1.0], [1.0, 1.0]].view(), array![[3.0], [3.0]].view(), 1.0)?;
/// assert!((&x - &array![[1.0], [1.0]]).iter().all(|d| d.abs() < 1e-12));
/// # Ok::<(), lenslet_core::linalg::Error>(())
/// ```
pub fn solve_ridge<T: Real>(matrix: ArrayView2<'_, T>, right: ArrayView2<'_, T>, ridge: T) -> Result<Array2<T>, Error> {
    let mut matrix = matrix.to_owned();
    matrix.diag_mut().mapv_inplace(|v| v + ridge);
    Ok(Cholesky::new(matrix.view())?.solve(right))
}

/// W (m×p) of min ‖X·W − Y‖² + ρ‖W‖², for X of n×m and Y of n×p, by the normal equations (XᵀX + ρI)·W = XᵀY: relative
/// errors grow with the square of X's condition number.
///
/// # Errors
/// [`Error::NotPositiveDefinite`] when the rows do not determine W.
///
/// # Panics
/// When X and Y differ in their number of rows.
///
/// ```
/// use lenslet_core::linalg::least_squares;
/// use ndarray::array;
/// // The line 1 + 2x through three of its points.
/// let w = least_squares(array![[1.0, 0.0], [1.0, 1.0], [1.0, 3.0]].view(), array![[1.0], [3.0], [7.0]].view(), 0.0)?;
/// assert!((w[[0, 0]] - 1.0f64).abs() < 1e-12 && (w[[1, 0]] - 2.0).abs() < 1e-12);
/// # Ok::<(), lenslet_core::linalg::Error>(())
/// ```
pub fn least_squares<T: Real>(x: ArrayView2<'_, T>, y: ArrayView2<'_, T>, ridge: T) -> Result<Array2<T>, Error> {
    solve_ridge(gram(x, Par::Seq).view(), product(x.t(), y, Par::Seq).view(), ridge)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn factors_multiply_back_and_solve() {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(7);
        for n in [1, 2, 5, 40, 150] {
            let x = Array2::from_shape_fn((n + 3, n), |_| rng.random::<f64>() - 0.5);
            let a = x.t().dot(&x);
            let factor = Cholesky::new(a.view()).unwrap();
            let l = factor.lower();
            assert!((&l.dot(&l.t()) - &a).iter().all(|d| d.abs() < 1e-11));
            let truth = Array2::from_shape_fn((n, 4), |_| rng.random::<f64>());
            let found = factor.solve(a.dot(&truth).view());
            assert!((&a.dot(&found) - &a.dot(&truth)).iter().all(|d| d.abs() < 1e-10));
        }
    }

    #[test]
    fn what_is_not_positive_definite_is_an_error() {
        let not = |a: Array2<f64>| Cholesky::new(a.view()).unwrap_err() == Error::NotPositiveDefinite;
        assert!(not(Array2::from_elem((3, 3), 1.0)));
        assert!(not(Array2::from_elem((2, 2), f64::NAN)));
        assert!(not(Array2::from_elem((1, 1), f64::INFINITY)));
        assert!(not(Array2::from_diag(&ndarray::array![1.0, -1.0])));
        assert!(solve_ridge(Array2::from_elem((3, 3), 1.0).view(), Array2::zeros((3, 1)).view(), 1e-3).is_ok());
    }
}
