//! Smaller pictures: every pixel of the result is the mean of the box it covers.

use ndarray::{Array3, ArrayView3};

/// A picture (t, s, c) whose longer side is at most `side` pixels: each pixel is the mean of the box it covers,
/// boundary pixels counted by the share that lies inside. A picture that is small enough is returned unchanged, as is
/// any with `side` 0.
///
/// ```
/// use lenslet::image_io::shrink;
/// use ndarray::Array3;
///
/// let picture = Array3::from_shape_fn((2, 4, 1), |(t, s, _)| (4 * t + s) as f32);
/// let small = shrink(&picture.view(), 2);
/// assert_eq!(small.dim(), (1, 2, 1));
/// assert_eq!([small[[0, 0, 0]], small[[0, 1, 0]]], [2.5, 4.5]);
/// ```
pub fn shrink(image: &ArrayView3<f32>, side: usize) -> Array3<f32> {
    let (height, width, channels) = image.dim();
    let longer = height.max(width);
    if longer <= side || side == 0 {
        return image.to_owned();
    }
    let scaled = |n: usize| ((n * side + longer / 2) / longer).max(1);
    let (h, w) = (scaled(height), scaled(width));
    let rows = overlaps(height, h);
    let columns = overlaps(width, w);
    // Along the rows, then down the columns.
    let mut narrow = Array3::<f32>::zeros((height, w, channels));
    for (mut out, row) in narrow.outer_iter_mut().zip(image.outer_iter()) {
        for (s, list) in columns.iter().enumerate() {
            for &(k, share) in list {
                for c in 0..channels {
                    out[[s, c]] += share * row[[k, c]];
                }
            }
        }
    }
    let mut small = Array3::<f32>::zeros((h, w, channels));
    for (mut out, list) in small.outer_iter_mut().zip(&rows) {
        for &(k, share) in list {
            out.scaled_add(share, &narrow.index_axis(ndarray::Axis(0), k));
        }
    }
    small
}

/// Which of `from` cells each of `to` cells covers, and how much of the mean each makes up.
fn overlaps(from: usize, to: usize) -> Vec<Vec<(usize, f32)>> {
    let ratio = from as f64 / to as f64;
    (0..to)
        .map(|k| {
            let (lo, hi) = (k as f64 * ratio, (k + 1) as f64 * ratio);
            (lo as usize..(hi.ceil() as usize).min(from))
                .map(|i| (i, ((hi.min((i + 1) as f64) - lo.max(i as f64)) / ratio) as f32))
                .collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shrinking_keeps_the_mean_and_constants() {
        let image = Array3::from_shape_fn((30, 47, 3), |(t, s, c)| ((t * 7 + s * 13 + c * 5) % 11) as f32);
        let small = shrink(&image.view(), 20);
        assert_eq!(small.dim(), (13, 20, 3));
        assert!((small.mean().unwrap() - image.mean().unwrap()).abs() < 0.02);
        let flat = shrink(&Array3::from_elem((30, 47, 3), 0.7).view(), 13);
        assert!(flat.iter().all(|v| (v - 0.7).abs() < 1e-5));
    }
}
