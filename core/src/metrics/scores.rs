//! The scores of one view that every table of this project shows.

use ndarray::ArrayView3;

use super::error::Error;
use super::psnr::psnr;
use super::ssim::ssim;
use super::window::Window;
use crate::colour::luminance;

/// PSNR and SSIM of a view against its truth.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Scores {
    /// PSNR over all channels, dB; infinite when the pictures are equal. Of luminance where one picture is grey.
    pub psnr_rgb: f64,
    /// PSNR of the luminance, dB.
    pub psnr_y: f64,
    /// Mean SSIM of the luminance, at most 1.
    pub ssim_y: f64,
}

impl Scores {
    /// Scores `result` against `reference`, both (t, s, c) with values 0..1 and of one size, inside of `window`.
    ///
    /// # Errors
    /// When the sizes differ, the border leaves less than an SSIM window, or a value is not finite.
    ///
    /// ```
    /// use lenslet_core::metrics::{BORDER, Scores, Window};
    /// use ndarray::Array3;
    ///
    /// let truth = Array3::from_shape_fn((40, 50, 3), |(t, s, _)| ((t * s) % 7) as f32 / 7.0);
    /// let scores = Scores::between(truth.mapv(|x| x + 0.01).view(), truth.view(), &Window::without_border(BORDER))?;
    /// assert!((scores.psnr_rgb - 40.0).abs() < 1e-4 && (scores.psnr_y - 40.0).abs() < 1e-4);
    /// assert!(scores.ssim_y > 0.99);
    /// # Ok::<(), lenslet_core::metrics::Error>(())
    /// ```
    pub fn between(result: ArrayView3<f32>, reference: ArrayView3<f32>, window: &Window) -> Result<Scores, Error> {
        let (result, reference) = (window.crop(result)?, window.crop(reference)?);
        let (y, y_reference) = (luminance(result), luminance(reference));
        let psnr_y = psnr(y.view(), y_reference.view())?;
        // Against a grey picture only luminance can be compared.
        let psnr_rgb = if result.dim() == reference.dim() { psnr(result, reference)? } else { psnr_y };
        Ok(Scores { psnr_rgb, psnr_y, ssim_y: ssim(y.view(), y_reference.view(), window.ssim)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array3, Axis};

    #[test]
    fn the_border_is_ignored_and_grey_is_compared_with_luminance() {
        let truth = Array3::from_shape_fn((36, 40, 3), |(t, s, c)| ((t + 2 * s + c) % 9) as f32 / 9.0);
        let window = Window::without_border(12);
        let mut result = &truth + 0.1;
        result.index_axis_mut(Axis(0), 3).fill(5.0);
        let scores = Scores::between(result.view(), truth.view(), &window).unwrap();
        assert!((scores.psnr_rgb - 20.0).abs() < 1e-4 && (scores.psnr_y - 20.0).abs() < 1e-4, "{scores:?}");
        let grey = luminance(truth.view()).insert_axis(Axis(2));
        let scores = Scores::between(grey.view(), truth.view(), &window).unwrap();
        assert_eq!((scores.psnr_rgb, scores.psnr_y), (f64::INFINITY, f64::INFINITY));
        assert!(matches!(
            Scores::between(truth.view(), truth.slice(ndarray::s![1.., .., ..]), &window),
            Err(Error::Shape { .. })
        ));
        assert!(matches!(
            Scores::between(truth.view(), truth.view(), &Window::without_border(18)),
            Err(Error::Small { .. })
        ));
    }
}
