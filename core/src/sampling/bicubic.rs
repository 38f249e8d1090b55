//! Bicubic interpolation (paper section 4.1): Keys' cubic convolution with a = −½, signed values, nothing clamped.

use ndarray::{Array3, ArrayView3};
use rayon::prelude::*;

use super::error::{Error, check_size};
use crate::geometry::{SensorToView, Size};
use crate::image::keys_weights;

/// Taps of one output position: four clamped indices and their weights.
fn taps(x: f64, len: usize) -> ([usize; 4], [f32; 4]) {
    let last = (len - 1) as f64;
    let x = x.clamp(-1.0, last + 1.0);
    let base = x.floor();
    let index = [-1.0, 0.0, 1.0, 2.0].map(|k| (base + k).clamp(0.0, last) as usize);
    (index, keys_weights(x - base).map(|w| w as f32))
}

/// Interpolates all channels of `image` (t, s, c) at (`x`, `y`) into `out`; beyond the border the edge pixel repeats.
/// The image must not be empty.
///
/// ```
/// use lenslet_core::sampling::bicubic::bicubic_at;
/// let image = ndarray::Array3::from_shape_fn((5, 8, 1), |(t, s, _)| (s * s + t) as f32);
/// let mut value = [0.0];
/// bicubic_at(image.view(), 3.5, 2.0, &mut value); // parabolas are reproduced
/// assert_eq!(value, [14.25]);
/// ```
pub fn bicubic_at(image: ArrayView3<'_, f32>, x: f64, y: f64, out: &mut [f32]) {
    let (height, width, _) = image.dim();
    let (xs, wx) = taps(x, width);
    let (ys, wy) = taps(y, height);
    for (c, o) in out.iter_mut().enumerate() {
        *o = (0..4).map(|k| wy[k] * (0..4).map(|l| wx[l] * image[[ys[k], xs[l], c]]).sum::<f32>()).sum();
    }
}

/// Enlarges (or plainly resamples, without a wider kernel for shrinking) `image` (t, s, c) to `size`; places by
/// [`crate::geometry::SensorToView`].
///
/// # Errors
/// An empty image, or a size out of range.
///
/// ```
/// use lenslet_core::geometry::Size;
/// use lenslet_core::sampling::bicubic::resize_bicubic;
/// let image = ndarray::Array3::from_elem((3, 4, 2), 0.25);
/// let large = resize_bicubic(image.view(), Size::new(8, 6))?;
/// assert_eq!(large.dim(), (6, 8, 2));
/// assert!(large.iter().all(|v| (v - 0.25).abs() < 1e-6));
/// # Ok::<(), lenslet_core::sampling::Error>(())
/// ```
pub fn resize_bicubic(image: ArrayView3<'_, f32>, size: Size) -> Result<Array3<f32>, Error> {
    let (h, w, channels) = image.dim();
    check_size("image", Size::new(w, h))?;
    check_size("view", size)?;
    let map = SensorToView::new(Size::new(w, h), size);
    let Size { width, height } = size;
    let source_of = |s: usize, t: usize| map.to_sensor([s as f64, t as f64]);
    let columns: Vec<_> = (0..width).map(|s| taps(source_of(s, 0)[0], w)).collect();
    // Along the rows first: (h, width, c).
    let mut wide = Array3::<f32>::zeros((h, width, channels));
    let image = image.as_standard_layout();
    let mut out = Array3::<f32>::zeros((height, width, channels));
    let (Some(source), Some(target)) = (image.as_slice(), wide.as_slice_mut()) else { return Ok(out) };
    if channels == 0 {
        return Ok(out);
    }
    target.par_chunks_mut(width * channels).zip(source.par_chunks(w * channels)).for_each(|(to, from)| {
        for (pixel, (index, weight)) in to.chunks_exact_mut(channels).zip(&columns) {
            for (c, p) in pixel.iter_mut().enumerate() {
                *p = (0..4).map(|k| weight[k] * from[index[k] * channels + c]).sum();
            }
        }
    });
    let row = width * channels;
    let wide = &*target;
    if let Some(flat) = out.as_slice_mut() {
        flat.par_chunks_mut(row).enumerate().for_each(|(t, to)| {
            let (index, weight) = taps(source_of(0, t)[1], h);
            let [a, b, c, d] = index.map(|k| &wide[k * row..(k + 1) * row]);
            for (k, p) in to.iter_mut().enumerate() {
                *p = weight[0] * a[k] + weight[1] * b[k] + weight[2] * c[k] + weight[3] * d[k];
            }
        });
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_separable_form_equals_the_plain_one() {
        let image = Array3::from_shape_fn((7, 9, 2), |(t, s, c)| ((t * 31 + s * 17 + c * 7) % 13) as f32 / 6.0 - 1.0);
        let out = resize_bicubic(image.view(), Size::new(23, 30)).unwrap();
        for t in 0..30 {
            for s in 0..23 {
                let mut plain = [0f32; 2];
                bicubic_at(
                    image.view(),
                    (s as f64 + 0.5) * 9.0 / 23.0 - 0.5,
                    (t as f64 + 0.5) * 7.0 / 30.0 - 0.5,
                    &mut plain,
                );
                for c in 0..2 {
                    assert!((out[[t, s, c]] - plain[c]).abs() < 1e-5);
                }
            }
        }
    }

    #[test]
    fn a_parabola_comes_back_inside_and_signs_survive() {
        // Keys' kernel with a = -1/2 reproduces second-degree polynomials.
        let f = |x: f64| 0.05 * x * x - 0.6 * x - 1.0;
        let image = Array3::from_shape_fn((5, 12, 1), |(_, s, _)| f(s as f64) as f32);
        let mut out = [0f32];
        for k in 10..90 {
            let x = f64::from(k) / 10.0;
            bicubic_at(image.view(), x, 2.0, &mut out);
            assert!((f64::from(out[0]) - f(x)).abs() < 1e-5);
        }
        assert!(out[0] < 0.0);
    }

    #[test]
    fn bad_sizes_are_errors() {
        assert!(resize_bicubic(Array3::zeros((0, 3, 1)).view(), Size::new(4, 4)).is_err());
        assert!(resize_bicubic(Array3::zeros((3, 3, 1)).view(), Size::new(0, 4)).is_err());
        assert!(resize_bicubic(Array3::zeros((3, 3, 1)).view(), Size::new(usize::MAX, 4)).is_err());
        assert_eq!(resize_bicubic(Array3::zeros((3, 3, 0)).view(), Size::new(4, 5)).unwrap().dim(), (5, 4, 0));
    }
}
