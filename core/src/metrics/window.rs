//! The part of a picture that is scored, and the window of its SSIM.

use ndarray::{ArrayView3, s};

use super::error::Error;
use super::ssim::SsimWindow;

/// Pixels left out on each side of a view when it is scored or trained on: there the lattice of lenslets ends, and
/// interpolation has samples on one side only.
/// Source: chosen; between three and four lenslet pitches of an F01 at 1080 pixels per view.
pub const BORDER: usize = 12;

/// What of two pictures is compared, and how.
///
/// ```
/// use lenslet_core::metrics::{BORDER, SsimWindow, Window};
/// use ndarray::Array3;
///
/// let picture = Array3::<f32>::zeros((40, 60, 3));
/// let window = Window::without_border(BORDER).with_ssim(SsimWindow::Uniform);
/// assert_eq!(window.crop(picture.view())?.dim(), (16, 36, 3));
/// assert!(Window::without_border(20).crop(picture.view()).is_err());
/// # Ok::<(), lenslet_core::metrics::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Pixels left out on each side.
    pub border: usize,
    /// Window of the SSIM.
    pub ssim: SsimWindow,
}

impl Window {
    /// All but `border` pixels on each side, with the Gaussian SSIM window.
    pub fn without_border(border: usize) -> Window {
        Window { border, ssim: SsimWindow::default() }
    }

    /// The same part of the pictures with another SSIM window.
    pub fn with_ssim(self, ssim: SsimWindow) -> Window {
        Window { ssim, ..self }
    }

    /// The compared part of a picture (t, s, c).
    ///
    /// # Errors
    /// [`Error::Small`] when the border leaves nothing.
    pub fn crop<'a>(&self, picture: ArrayView3<'a, f32>) -> Result<ArrayView3<'a, f32>, Error> {
        let (height, width, _) = picture.dim();
        let twice = self.border.saturating_mul(2);
        if twice >= height || twice >= width {
            return Err(Error::Small { height, width, least: twice.saturating_add(1) });
        }
        let (bottom, right) = (height - self.border, width - self.border);
        Ok(picture.slice_move(s![self.border..bottom, self.border..right, ..]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;

    #[test]
    fn a_crop_cuts_all_sides() {
        let p = Array3::from_shape_fn((5, 6, 1), |(t, s, _)| (10 * t + s) as f32);
        let i = Window::without_border(2).crop(p.view()).unwrap();
        assert_eq!(i.dim(), (1, 2, 1));
        assert_eq!(i[[0, 0, 0]], 22.0);
        let small = |border| matches!(Window::without_border(border).crop(p.view()), Err(Error::Small { .. }));
        assert!(small(3) && small(usize::MAX));
    }
}
