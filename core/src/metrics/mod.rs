//! Scores of pictures: PSNR and SSIM against a truth, sharpness and jaggedness of edges, contrast of patterns, agreement of
//! views, and the registration that makes results of other tools comparable.

pub mod align;
mod consistency;
mod difference;
mod edge;
mod pattern;
mod ssim;

pub use consistency::consistency;
pub use difference::{delta_e_2000, lab};
pub use edge::{Edge, slanted_edge};
pub use pattern::{Pattern, pattern};
pub use ssim::{Window, ssim, ssim_map_plain};

use ndarray::{Array2, ArrayView2, ArrayView3, ArrayViewD, Axis};

/// What cannot be scored.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The two pictures differ in shape.
    #[error("shapes differ: {result:?} and {reference:?}")]
    Shape {
        /// Shape of the result.
        result: Vec<usize>,
        /// Shape of the reference.
        reference: Vec<usize>,
    },
    /// Too small for the measure.
    #[error("{height}x{width} pixels are too few: at least {least} along each side")]
    Small {
        /// Height, pixels.
        height: usize,
        /// Width, pixels.
        width: usize,
        /// Smallest side, pixels.
        least: usize,
    },
    /// A value is NaN or infinite.
    #[error("values that are not finite numbers cannot be scored")]
    NotFinite,
}

/// Weights of R, G and B in luminance (ITU-R BT.601).
pub const LUMINANCE: [f32; 3] = [0.299, 0.587, 0.114];

/// Luminance of a picture (t, s, c): the weighted sum of three channels, or the single channel.
pub fn luminance(picture: ArrayView3<f32>) -> Array2<f32> {
    if picture.dim().2 == 3 {
        picture.map_axis(Axis(2), |p| LUMINANCE[0] * p[0] + LUMINANCE[1] * p[1] + LUMINANCE[2] * p[2])
    } else {
        picture.index_axis(Axis(2), 0).to_owned()
    }
}

/// Mean squared difference of two pictures, summed in f64 in index order.
///
/// # Errors
/// When the shapes differ or are empty, or a value is not finite.
pub fn mean_squared_error(result: ArrayViewD<f32>, reference: ArrayViewD<f32>) -> Result<f64, Error> {
    if result.shape() != reference.shape() || result.is_empty() {
        return Err(Error::Shape { result: result.shape().to_vec(), reference: reference.shape().to_vec() });
    }
    let mut sum = 0.0;
    // One partial sum a row keeps the rounding error independent of the picture's size.
    let last = Axis(result.ndim().saturating_sub(1));
    for (a, b) in result.lanes(last).into_iter().zip(reference.lanes(last)) {
        let row: f64 = a.iter().zip(b).map(|(&x, &y)| (f64::from(x) - f64::from(y)).powi(2)).sum();
        sum += row;
    }
    if sum.is_finite() { Ok(sum / result.len() as f64) } else { Err(Error::NotFinite) }
}

/// Peak signal-to-noise ratio in dB of pictures with values 0..1: `-10 log10(mean squared difference)`; infinite for
/// equal pictures.
///
/// # Errors
/// As [`mean_squared_error`].
pub fn psnr(result: ArrayViewD<f32>, reference: ArrayViewD<f32>) -> Result<f64, Error> {
    Ok(-10.0 * mean_squared_error(result, reference)?.log10())
}

/// A picture without `border` pixels on each side; None when nothing is left.
pub fn inner<'a>(picture: &ArrayView3<'a, f32>, border: usize) -> Option<ArrayView3<'a, f32>> {
    let (height, width, _) = picture.dim();
    let twice = border.checked_mul(2)?;
    if twice >= height || twice >= width {
        return None;
    }
    let (bottom, right) = (height - border, width - border);
    Some((*picture).slice_move(ndarray::s![border..bottom, border..right, ..]))
}

fn finite(picture: &ArrayView2<f32>) -> bool {
    picture.iter().all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array3, array};

    #[test]
    fn psnr_of_known_differences() {
        let a = Array3::<f32>::zeros((4, 5, 3));
        let b = &a + 0.1;
        assert!((psnr(a.view().into_dyn(), b.view().into_dyn()).unwrap() - 20.0).abs() < 1e-5);
        assert_eq!(psnr(a.view().into_dyn(), a.view().into_dyn()).unwrap(), f64::INFINITY);
        let c = &a + f32::NAN;
        assert_eq!(psnr(a.view().into_dyn(), c.view().into_dyn()), Err(Error::NotFinite));
        let d = Array3::<f32>::zeros((4, 4, 3));
        assert!(matches!(psnr(a.view().into_dyn(), d.view().into_dyn()), Err(Error::Shape { .. })));
    }

    #[test]
    fn luminance_weights_and_single_channel() {
        let p = array![[[1.0f32, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.5, 0.5, 0.5]]];
        let y = luminance(p.view());
        for (got, expected) in y.iter().zip([0.299, 0.587, 0.114, 0.5]) {
            assert!((got - expected).abs() < 1e-6);
        }
        assert_eq!(luminance(array![[[0.25f32]]].view()), array![[0.25]]);
    }

    #[test]
    fn inner_cuts_all_sides() {
        let p = Array3::from_shape_fn((5, 6, 1), |(t, s, _)| (10 * t + s) as f32);
        let i = inner(&p.view(), 2).unwrap();
        assert_eq!(i.dim(), (1, 2, 1));
        assert_eq!(i[[0, 0, 0]], 22.0);
        assert!(inner(&p.view(), 3).is_none() && inner(&p.view(), usize::MAX).is_none());
    }
}
