//! Agreement of views: a view warped by the true disparity should equal the central view.

use ndarray::{Array3, ArrayView2, ArrayView3};

use super::error::Error;
use super::psnr::psnr;
use crate::sampling::bicubic::bicubic_at;

/// PSNR in dB of `other`, warped by `disparity`, against `centre` (both (t, s, c)), `border` pixels left out on each
/// side. `disparity` (t, s) is in pixels per view step, `steps` (u, v) the number of views that `other` is to the right
/// of and below `centre`. Only for scenes without occlusions.
///
/// # Errors
/// As [`psnr`]; also when the border leaves nothing.
///
/// ```
/// use lenslet_core::metrics::view_consistency;
/// use ndarray::{Array2, Array3};
///
/// let wave = |x: f32| 0.5 + 0.3 * (0.3 * x).sin();
/// let view = |shift: f32| Array3::from_shape_fn((30, 40, 1), |(_, s, _)| wave(s as f32 - shift));
/// let disparity = Array2::from_elem((30, 40), 0.5);
/// let right = view_consistency(view(0.0).view(), view(1.0).view(), disparity.view(), (2.0, 0.0), 4)?;
/// let wrong = view_consistency(view(0.0).view(), view(1.0).view(), disparity.view(), (0.0, 0.0), 4)?;
/// assert!(right > 50.0 && wrong < 30.0);
/// # Ok::<(), lenslet_core::metrics::Error>(())
/// ```
pub fn view_consistency(
    centre: ArrayView3<f32>,
    other: ArrayView3<f32>,
    disparity: ArrayView2<f32>,
    steps: (f64, f64),
    border: usize,
) -> Result<f64, Error> {
    let (height, width, channels) = centre.dim();
    if other.dim() != centre.dim() || disparity.dim() != (height, width) {
        return Err(Error::Shape { result: other.shape().to_vec(), reference: centre.shape().to_vec() });
    }
    if 2 * border >= height.min(width) {
        return Err(Error::Small { height, width, least: 2 * border + 1 });
    }
    let mut moved = Array3::zeros((height - 2 * border, width - 2 * border, channels));
    let mut pixel = vec![0.0; channels];
    for t in 0..height - 2 * border {
        for s in 0..width - 2 * border {
            let (x, y) = ((s + border) as f64, (t + border) as f64);
            let d = f64::from(disparity[[t + border, s + border]]);
            bicubic_at(other, x + d * steps.0, y + d * steps.1, &mut pixel);
            for (c, &value) in pixel.iter().enumerate() {
                moved[[t, s, c]] = value;
            }
        }
    }
    let inner = centre.slice(ndarray::s![border..height - border, border..width - border, ..]);
    psnr(moved.view(), inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    #[test]
    fn moved_by_the_right_disparity_views_agree() {
        let view = |u: f64, v: f64| {
            Array3::from_shape_fn((60, 70, 1), |(t, s, _)| {
                let (x, y) = (s as f64 - 0.6 * u, t as f64 - 0.6 * v);
                (0.5 + 0.3 * (0.2 * x).sin() * (0.15 * y).cos()) as f32
            })
        };
        let (centre, other) = (view(0.0, 0.0), view(3.0, -2.0));
        let right = Array2::from_elem((60, 70), 0.6);
        let score = |d: &Array2<f32>| view_consistency(centre.view(), other.view(), d.view(), (3.0, -2.0), 6).unwrap();
        assert!(score(&right) > 60.0 && score(&Array2::zeros((60, 70))) < 30.0);
        assert!(view_consistency(centre.view(), other.view(), right.view(), (1.0, 0.0), 30).is_err());
    }
}
