//! Planes made smaller, antialiased: a separable kernel widened by the factor (as MATLAB's `imresize` does it).

use std::f64::consts::PI;

use lenslet_core::image::keys_kernel;
use ndarray::{Array2, ArrayView2};

use super::error::Error;

/// The kernel of a reduction; it is widened by the reduction's factor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReductionKernel {
    /// Lanczos-3, the sharper one.
    Lanczos,
    /// Bicubic (a = −½), as super-resolution protocols shrink.
    Bicubic,
}

impl ReductionKernel {
    fn reach(self) -> f64 {
        match self {
            ReductionKernel::Lanczos => 3.0,
            ReductionKernel::Bicubic => 2.0,
        }
    }

    fn value(self, x: f64) -> f64 {
        let x = x.abs();
        if x >= self.reach() {
            return 0.0;
        }
        let sinc = |x: f64| if x < 1e-9 { 1.0 } else { (PI * x).sin() / (PI * x) };
        match self {
            ReductionKernel::Lanczos => sinc(x) * sinc(x / 3.0),
            ReductionKernel::Bicubic => keys_kernel(x),
        }
    }
}

/// Shrinks a plane to `rows`×`columns` (neither larger than it is) with a kernel widened accordingly.
///
/// # Errors
/// [`Error::Reduction`] for sizes of zero or larger than the plane.
///
/// ```
/// use lenslet_data_gen::photo::{ReductionKernel, reduce_plane};
/// let flat = ndarray::Array2::from_elem((30, 40), 0.5f32);
/// let small = reduce_plane(flat.view(), 10, 20, ReductionKernel::Lanczos)?;
/// assert_eq!(small.dim(), (10, 20));
/// assert!(small.iter().all(|v| (v - 0.5).abs() < 1e-6));
/// # Ok::<(), lenslet_data_gen::photo::Error>(())
/// ```
pub fn reduce_plane(
    plane: ArrayView2<'_, f32>,
    rows: usize,
    columns: usize,
    kernel: ReductionKernel,
) -> Result<Array2<f32>, Error> {
    let (h, w) = plane.dim();
    if rows == 0 || columns == 0 || rows > h || columns > w {
        return Err(Error::Reduction { from: (w, h), to: (columns, rows) });
    }
    let half = shrink_rows(plane, rows, kernel);
    Ok(shrink_rows(half.t(), columns, kernel).reversed_axes().as_standard_layout().into_owned())
}

/// Shrinks along the first axis.
fn shrink_rows(plane: ArrayView2<'_, f32>, count: usize, kernel: ReductionKernel) -> Array2<f32> {
    let n = plane.nrows();
    if count == n {
        return plane.to_owned();
    }
    let scale = n as f64 / count as f64;
    let reach = kernel.reach() * scale;
    let mut out = Array2::<f32>::zeros((count, plane.ncols()));
    for (i, mut row) in out.rows_mut().into_iter().enumerate() {
        let centre = (i as f64 + 0.5) * scale - 0.5;
        let (first, last) = ((centre - reach).ceil() as i64, (centre + reach).floor() as i64);
        let taps: Vec<(usize, f64)> = (first..=last)
            .map(|k| (k.clamp(0, n as i64 - 1) as usize, kernel.value((k as f64 - centre) / scale)))
            .collect();
        let total: f64 = taps.iter().map(|t| t.1).sum();
        for (k, tap) in taps {
            row.scaled_add((tap / total) as f32, &plane.row(k));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shrinking_keeps_planes_and_sizes() {
        let plane = Array2::from_shape_fn((60, 90), |(y, x)| 0.2 + 0.003 * x as f32 + 0.005 * y as f32);
        for kernel in [ReductionKernel::Lanczos, ReductionKernel::Bicubic] {
            let small = reduce_plane(plane.view(), 40, 60, kernel).unwrap();
            assert_eq!(small.dim(), (40, 60));
            for y in 5..35 {
                for x in 5..55 {
                    let truth = 0.2 + 0.003 * (x as f32 * 1.5 + 0.25) + 0.005 * (y as f32 * 1.5 + 0.25);
                    assert!((small[[y, x]] - truth).abs() < 5e-4);
                }
            }
        }
        assert!(reduce_plane(plane.view(), 61, 60, ReductionKernel::Lanczos).is_err());
        assert!(reduce_plane(plane.view(), 0, 60, ReductionKernel::Lanczos).is_err());
        assert_eq!(reduce_plane(plane.view(), 60, 90, ReductionKernel::Bicubic).unwrap(), plane);
    }
}
