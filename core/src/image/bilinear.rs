//! Bilinear interpolation: the four pixels around a position, and the two ways to weight them.
//!
//! a + f·(b − a) and a·(1 − f) + b·f are equal but for rounding: the first is exact at f = 0 and costs one product
//! less, the second is exact at both ends. Results of both have been published, so each caller keeps the form it has.
//!
//! Corners are always given as upper left, upper right, lower left, lower right.

use crate::geometry::Size;
use ndarray::NdFloat;

/// A coordinate in pixels: f32 or f64.
pub trait Position: NdFloat {
    /// The pixel before a coordinate held within 0..=`last`, and how far beyond it the coordinate lies, 0..1.
    fn split_clamped(self, last: usize) -> (usize, Self);
}

impl Position for f32 {
    #[inline]
    fn split_clamped(self, last: usize) -> (usize, f32) {
        let held = self.clamp(0.0, last as f32);
        (held as usize, held - (held as usize) as f32)
    }
}

impl Position for f64 {
    #[inline]
    fn split_clamped(self, last: usize) -> (usize, f64) {
        let held = self.clamp(0.0, last as f64);
        (held as usize, held - (held as usize) as f64)
    }
}

/// The cell of four pixels around a position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell<T> {
    /// The columns to its left and right; equal in the last column.
    pub columns: [usize; 2],
    /// The rows above and below it; equal in the last row.
    pub rows: [usize; 2],
    /// Position between the left column (0) and the right one (1).
    pub fx: T,
    /// Position between the upper row (0) and the lower one (1).
    pub fy: T,
}

impl<T: Position> Cell<T> {
    /// The cell around (`x`, `y`), clamped to a picture of `width`×`height` pixels. The picture must not be empty.
    ///
    /// ```
    /// use lenslet_core::image::Cell;
    /// use lenslet_core::geometry::Size;
    /// let cell = Cell::clamped(2.25f32, 9.0, Size::new(4, 3));
    /// assert_eq!((cell.columns, cell.rows), ([2, 3], [2, 2]));
    /// assert_eq!((cell.fx, cell.fy), (0.25, 0.0));
    /// ```
    #[inline]
    #[must_use]
    pub fn clamped(x: T, y: T, size: Size) -> Self {
        let Size { width, height } = size;
        let ((x0, fx), (y0, fy)) = (x.split_clamped(width - 1), y.split_clamped(height - 1));
        Cell { columns: [x0, (x0 + 1).min(width - 1)], rows: [y0, (y0 + 1).min(height - 1)], fx, fy }
    }

    /// The values of its four pixels, read by `value(x, y)`.
    #[inline]
    pub fn corners<V>(&self, value: impl Fn(usize, usize) -> V) -> [V; 4] {
        let ([x0, x1], [y0, y1]) = (self.columns, self.rows);
        [value(x0, y0), value(x1, y0), value(x0, y1), value(x1, y1)]
    }
}

/// Bilinear value by differences: u = a + fx·(b − a), l = c + fx·(d − c), then u + fy·(l − u).
///
/// ```
/// use lenslet_core::image::bilinear_by_differences;
/// assert_eq!(bilinear_by_differences([0.0, 4.0, 8.0, 12.0], 0.25, 0.5), 5.0);
/// ```
#[inline]
#[must_use]
pub fn bilinear_by_differences<T: NdFloat>([a, b, c, d]: [T; 4], fx: T, fy: T) -> T {
    let upper = a + fx * (b - a);
    let lower = c + fx * (d - c);
    upper + fy * (lower - upper)
}

/// Bilinear value by weights: (a·(1 − fx) + b·fx)·(1 − fy) + (c·(1 − fx) + d·fx)·fy.
///
/// ```
/// use lenslet_core::image::bilinear_by_weights;
/// assert_eq!(bilinear_by_weights([0.0, 4.0, 8.0, 12.0], 0.25, 0.5), 5.0);
/// ```
#[inline]
#[must_use]
pub fn bilinear_by_weights<T: NdFloat>([a, b, c, d]: [T; 4], fx: T, fy: T) -> T {
    let one = T::one();
    (a * (one - fx) + b * fx) * (one - fy) + (c * (one - fx) + d * fx) * fy
}

/// The value of [`bilinear_by_differences`] and its slopes along x and y, per pixel.
///
/// ```
/// use lenslet_core::image::bilinear_with_slopes;
/// assert_eq!(bilinear_with_slopes([0.0, 4.0, 8.0, 12.0], 0.25, 0.5), [5.0, 4.0, 8.0]);
/// ```
#[inline]
#[must_use]
pub fn bilinear_with_slopes<T: NdFloat>([a, b, c, d]: [T; 4], fx: T, fy: T) -> [T; 3] {
    let (upper, lower) = (a + fx * (b - a), c + fx * (d - c));
    [upper + fy * (lower - upper), (T::one() - fy) * (b - a) + fy * (d - c), lower - upper]
}

/// The weights of the four pixels; they sum to one.
///
/// ```
/// use lenslet_core::image::bilinear_shares;
/// assert_eq!(bilinear_shares(0.25, 0.5), [0.375, 0.125, 0.375, 0.125]);
/// ```
#[inline]
#[must_use]
pub fn bilinear_shares<T: NdFloat>(fx: T, fy: T) -> [T; 4] {
    let one = T::one();
    [(one - fx) * (one - fy), fx * (one - fy), (one - fx) * fy, fx * fy]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_equals_the_sum_of_shares() {
        for k in 0..200 {
            let at = |n: usize| ((k * 7919 + n * 104_729) % 1009) as f64 / 1008.0;
            let (corners, fx, fy) = ([at(0) - 0.5, at(1), at(2), at(3) * 3.0], at(4), at(5));
            let plain: f64 = corners.iter().zip(bilinear_shares(fx, fy)).map(|(v, w)| v * w).sum();
            let [value, dx, dy] = bilinear_with_slopes(corners, fx, fy);
            assert!((bilinear_by_differences(corners, fx, fy) - plain).abs() < 1e-14);
            assert!((bilinear_by_weights(corners, fx, fy) - plain).abs() < 1e-14);
            assert_eq!(value, bilinear_by_differences(corners, fx, fy));
            let step = 1e-6;
            assert!((bilinear_by_weights(corners, fx + step, fy) - plain - dx * step).abs() < 1e-12);
            assert!((bilinear_by_weights(corners, fx, fy + step) - plain - dy * step).abs() < 1e-12);
        }
    }

    #[test]
    fn cells_stay_within_the_picture() {
        for (x, y) in [(-3.0, 0.4), (0.0, 0.0), (3.999, 1.5), (4.0, 2.0), (99.0, -1.0), (f64::NAN, 1.0)] {
            let cell = Cell::clamped(x, y, Size::new(5, 3));
            assert!(cell.columns.iter().all(|&x| x < 5) && cell.rows.iter().all(|&y| y < 3));
            let corners = cell.corners(|x, y| (x, y));
            assert_eq!(corners[1], (cell.columns[1], cell.rows[0]));
            assert_eq!(corners[2], (cell.columns[0], cell.rows[1]));
        }
        assert_eq!(Cell::clamped(7.0f32, 7.0, Size::new(1, 1)).columns, [0, 0]);
    }
}
