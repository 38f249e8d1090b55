//! Singular value and symmetric eigenvalue decompositions.

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::{evd, svd};
use faer::{Mat, Par};
use ndarray::{Array1, Array2, ArrayView2};

use super::Error;
use super::matrix::{Real, Stored, array, owned};

/// A = U·diag(s)·Vᵀ with k = min(m, n).
#[derive(Debug, Clone, PartialEq)]
pub struct Svd<T> {
    /// Left singular vectors as columns, m×k.
    pub u: Array2<T>,
    /// Singular values, from the largest to the smallest.
    pub s: Array1<T>,
    /// Right singular vectors as columns, n×k.
    pub v: Array2<T>,
}

/// The thin singular value decomposition of a matrix (m×n).
///
/// # Errors
/// [`Error::NoConvergence`] when an entry is not finite.
///
/// ```
/// use lenslet_core::linalg::thin_svd;
/// use ndarray::array;
/// let svd = thin_svd(array![[0.0, 2.0], [3.0, 0.0], [0.0, 0.0]].view())?;
/// assert!((svd.s[0] - 3.0f64).abs() < 1e-12 && (svd.s[1] - 2.0).abs() < 1e-12);
/// assert_eq!((svd.u.dim(), svd.v.dim()), ((3, 2), (2, 2)));
/// # Ok::<(), lenslet_core::linalg::Error>(())
/// ```
pub fn thin_svd<T: Real>(matrix: ArrayView2<'_, T>) -> Result<Svd<T>, Error> {
    use svd::ComputeSvdVectors::Thin;
    if !matrix.iter().all(|v| v.is_finite()) {
        return Err(Error::NoConvergence);
    }
    let ((m, n), k) = (matrix.dim(), matrix.nrows().min(matrix.ncols()));
    let (mut u, mut s, mut v) = (Mat::zeros(m, k), Diag::zeros(k), Mat::zeros(n, k));
    let mut memory = MemBuffer::new(svd::svd_scratch::<T>(m, n, Thin, Thin, Par::Seq, Default::default()));
    let stack = MemStack::new(&mut memory);
    let (left, right) = (Some(u.as_mut()), Some(v.as_mut()));
    svd::svd(Stored::of(matrix).view(), s.as_mut(), left, right, Par::Seq, stack, Default::default())
        .map_err(|_| Error::NoConvergence)?;
    Ok(Svd { u: array(&u), s: (0..k).map(|i| s.column_vector()[i]).collect(), v: array(&v) })
}

/// A = V·diag(values)·Vᵀ.
#[derive(Debug, Clone, PartialEq)]
pub struct Eigen<T> {
    /// Eigenvalues, from the smallest to the largest.
    pub values: Array1<T>,
    /// Eigenvectors as columns, in the order of the values; their signs are arbitrary.
    pub vectors: Array2<T>,
}

/// Eigenvalues and eigenvectors of a symmetric matrix (n×n), of which the lower triangle alone is read. Those of a
/// matrix of second moments are its principal components, the last ones the strongest.
///
/// # Errors
/// [`Error::NoConvergence`] when an entry is not finite.
///
/// # Panics
/// When the matrix is not square.
///
/// ```
/// use lenslet_core::linalg::symmetric_eigen;
/// use ndarray::array;
/// let eigen = symmetric_eigen(array![[2.0, 1.0], [1.0, 2.0]].view())?;
/// assert!((eigen.values[0] - 1.0f64).abs() < 1e-12 && (eigen.values[1] - 3.0).abs() < 1e-12);
/// assert!((eigen.vectors[[0, 1]] - eigen.vectors[[1, 1]]).abs() < 1e-12); // along (1, 1)
/// # Ok::<(), lenslet_core::linalg::Error>(())
/// ```
pub fn symmetric_eigen<T: Real>(matrix: ArrayView2<'_, T>) -> Result<Eigen<T>, Error> {
    use evd::ComputeEigenvectors::Yes;
    let n = matrix.nrows();
    assert_eq!(n, matrix.ncols(), "a symmetric matrix is square");
    if !matrix.iter().all(|v| v.is_finite()) {
        return Err(Error::NoConvergence);
    }
    let matrix = owned(matrix);
    let (mut values, mut vectors) = (Diag::zeros(n), Mat::zeros(n, n));
    let mut memory = MemBuffer::new(evd::self_adjoint_evd_scratch::<T>(n, Yes, Par::Seq, Default::default()));
    let stack = MemStack::new(&mut memory);
    let (s, v) = (values.as_mut(), Some(vectors.as_mut()));
    evd::self_adjoint_evd(matrix.as_ref(), s, v, Par::Seq, stack, Default::default())
        .map_err(|_| Error::NoConvergence)?;
    Ok(Eigen { values: (0..n).map(|i| values.column_vector()[i]).collect(), vectors: array(&vectors) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn decompositions_multiply_back() {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(5);
        for shape in [(1, 1), (30, 7), (7, 30), (20, 20)] {
            let a = Array2::from_shape_fn(shape, |_| rng.random::<f64>() - 0.5);
            let svd = thin_svd(a.view()).unwrap();
            assert!((&(&svd.u * &svd.s).dot(&svd.v.t()) - &a).iter().all(|d| d.abs() < 1e-12));
            assert!(svd.s.windows(2).into_iter().all(|s| s[0] >= s[1]));
            let moments = a.t().dot(&a);
            let eigen = symmetric_eigen(moments.view()).unwrap();
            assert!(
                (&(&eigen.vectors * &eigen.values).dot(&eigen.vectors.t()) - &moments).iter().all(|d| d.abs() < 1e-12)
            );
            // Eigenvalues of AᵀA are the squared singular values.
            let strongest = eigen.values[shape.1 - 1];
            assert!((strongest - svd.s[0] * svd.s[0]).abs() < 1e-12 * strongest);
        }
        assert_eq!(thin_svd(Array2::from_elem((2, 2), f32::NAN).view()).unwrap_err(), Error::NoConvergence);
        assert_eq!(symmetric_eigen(Array2::from_elem((2, 2), f32::NAN).view()).unwrap_err(), Error::NoConvergence);
    }
}
