//! ndarray matrices as faer matrices, without a copy where their rows or columns are contiguous.

use std::borrow::Cow;

use faer::{Mat, MatRef};
use ndarray::{Array2, ArrayView2};

/// The element types of matrices: f32 and f64.
pub trait Real: faer::traits::RealField + ndarray::NdFloat {
    /// A pivot below this share of its diagonal entry counts as rounding error.
    const LEAST_PIVOT: Self;
}
impl Real for f32 {
    const LEAST_PIVOT: f32 = 2e-6;
}
impl Real for f64 {
    const LEAST_PIVOT: f64 = 1e-13;
}

/// The values of a matrix in the order that they are stored in.
pub(super) struct Stored<'a, T: Clone> {
    values: Cow<'a, [T]>,
    by_rows: bool,
    shape: (usize, usize),
}

impl<'a, T: Real> Stored<'a, T> {
    /// Borrows a matrix whose rows or whose columns are contiguous; copies any other.
    pub fn of(matrix: ArrayView2<'a, T>) -> Self {
        let shape = matrix.dim();
        if let Some(rows) = matrix.to_slice() {
            return Self { values: rows.into(), by_rows: true, shape };
        }
        match matrix.reversed_axes().to_slice() {
            Some(columns) => Self { values: columns.into(), by_rows: false, shape },
            None => Self { values: matrix.iter().copied().collect::<Vec<T>>().into(), by_rows: true, shape },
        }
    }

    /// The matrix as a view of faer's.
    pub fn view(&self) -> MatRef<'_, T> {
        let (rows, columns) = self.shape;
        if self.by_rows {
            MatRef::from_row_major_slice(&self.values, rows, columns)
        } else {
            MatRef::from_column_major_slice(&self.values, rows, columns)
        }
    }
}

/// A copy in faer's own layout, for work in place.
pub(super) fn owned<T: Real>(matrix: ArrayView2<'_, T>) -> Mat<T> {
    Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[[i, j]])
}

/// A copy in ndarray's layout.
pub(super) fn array<T: Real>(matrix: &Mat<T>) -> Array2<T> {
    Array2::from_shape_fn((matrix.nrows(), matrix.ncols()), |(i, j)| matrix[(i, j)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_not_contiguous_is_copied() {
        let a = Array2::from_shape_fn((4, 6), |(i, j)| (10 * i + j) as f32);
        for (view, copied) in [
            (a.view(), false),
            (a.t(), false),
            (a.slice(ndarray::s![1..3, ..]), false),
            (a.slice(ndarray::s![.., ..;2]), true),
        ] {
            let stored = Stored::of(view);
            assert_eq!(matches!(stored.values, Cow::Owned(_)), copied);
            let seen = stored.view();
            assert!(view.indexed_iter().all(|((i, j), v)| seen[(i, j)] == *v));
        }
    }
}
