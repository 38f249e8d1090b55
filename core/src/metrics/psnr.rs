//! Peak signal-to-noise ratio: `PSNR = −10 log10(MSE)` dB for values 0..1, `MSE` the mean squared difference.

use ndarray::{ArrayView, ArrayViewD, Axis, Dimension};

use super::error::Error;

/// Mean squared difference of two arrays of the same shape, summed in f64: along each row (last axis), then over the
/// rows in index order.
///
/// # Errors
/// When the shapes differ or are empty, or a value is not finite.
///
/// ```
/// use lenslet_core::metrics::mean_squared_error;
/// use ndarray::array;
///
/// let error = mean_squared_error(array![0.0, 0.5].view(), array![0.0, 0.25].view())?;
/// assert_eq!(error, 0.03125);
/// # Ok::<(), lenslet_core::metrics::Error>(())
/// ```
pub fn mean_squared_error<D: Dimension>(result: ArrayView<f32, D>, reference: ArrayView<f32, D>) -> Result<f64, Error> {
    let (result, reference): (ArrayViewD<f32>, ArrayViewD<f32>) = (result.into_dyn(), reference.into_dyn());
    if result.shape() != reference.shape() || result.is_empty() {
        return Err(Error::Shape { result: result.shape().to_vec(), reference: reference.shape().to_vec() });
    }
    let mut sum = 0.0;
    // One partial sum per row keeps the rounding error independent of the picture's size.
    let last = Axis(result.ndim().saturating_sub(1));
    for (a, b) in result.lanes(last).into_iter().zip(reference.lanes(last)) {
        let row: f64 = a.iter().zip(b).map(|(&x, &y)| (f64::from(x) - f64::from(y)).powi(2)).sum();
        sum += row;
    }
    if sum.is_finite() { Ok(sum / result.len() as f64) } else { Err(Error::NotFinite) }
}

/// Peak signal-to-noise ratio in dB of pictures with values 0..1: `−10 log10` of their [`mean_squared_error`]; infinite
/// for equal ones.
///
/// # Errors
/// As [`mean_squared_error`].
///
/// ```
/// use lenslet_core::metrics::psnr;
/// use ndarray::Array2;
///
/// let (truth, off_by_a_tenth) = (Array2::<f32>::zeros((8, 8)), Array2::from_elem((8, 8), 0.1));
/// assert!((psnr(off_by_a_tenth.view(), truth.view())? - 20.0).abs() < 1e-5);
/// assert_eq!(psnr(truth.view(), truth.view())?, f64::INFINITY);
/// # Ok::<(), lenslet_core::metrics::Error>(())
/// ```
pub fn psnr<D: Dimension>(result: ArrayView<f32, D>, reference: ArrayView<f32, D>) -> Result<f64, Error> {
    Ok(-10.0 * mean_squared_error(result, reference)?.log10())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;

    #[test]
    fn psnr_of_known_differences() {
        let a = Array3::<f32>::zeros((4, 5, 3));
        let b = &a + 0.1;
        assert!((psnr(a.view(), b.view()).unwrap() - 20.0).abs() < 1e-5);
        assert_eq!(psnr(a.view(), a.view()).unwrap(), f64::INFINITY);
        let c = &a + f32::NAN;
        assert_eq!(psnr(a.view(), c.view()), Err(Error::NotFinite));
        let d = Array3::<f32>::zeros((4, 4, 3));
        assert!(matches!(psnr(a.view(), d.view()), Err(Error::Shape { .. })));
    }
}
