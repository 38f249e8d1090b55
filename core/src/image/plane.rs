//! A picture of one channel.
//!
//! Plain rows, not an `Array2`: inner loops walk its rows as slices, and its two sizes are read in every pixel.

use super::bilinear::{Cell, bilinear_by_differences};
use crate::geometry::Size;

/// One image, rows one after the other.
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width·height` values.
    pub data: Vec<f32>,
}

impl Plane {
    /// A plane of one value.
    #[must_use]
    pub fn filled(size: Size, value: f32) -> Self {
        let Size { width, height } = size;
        Plane { width, height, data: vec![value; width * height] }
    }

    /// Row `t`.
    #[inline]
    #[must_use]
    pub fn row(&self, t: usize) -> &[f32] {
        &self.data[t * self.width..(t + 1) * self.width]
    }

    /// Bilinear value at (`x`, `y`), clamped to the frame; the plane must not be empty.
    ///
    /// ```
    /// use lenslet_core::image::Plane;
    /// let plane = Plane { width: 2, height: 2, data: vec![0.0, 1.0, 2.0, 3.0] };
    /// assert_eq!(plane.bilinear_at(0.5, 0.25), 1.0);
    /// assert_eq!(plane.bilinear_at(9.0, 9.0), 3.0);
    /// ```
    #[inline]
    #[must_use]
    pub fn bilinear_at(&self, x: f32, y: f32) -> f32 {
        let cell = Cell::clamped(x, y, Size::new(self.width, self.height));
        let (top, bottom) = (self.row(cell.rows[0]), self.row(cell.rows[1]));
        let [x0, x1] = cell.columns;
        bilinear_by_differences([top[x0], top[x1], bottom[x0], bottom[x1]], cell.fx, cell.fy)
    }

    /// Half the size: means of 2×2 pixels. Pixel (s, t) of the half lies at (2s + ½, 2t + ½) of the whole.
    #[must_use]
    pub fn halved(&self) -> Plane {
        let (w, h) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let mut out = Plane::filled(Size::new(w, h), 0.0);
        for t in 0..h {
            let (a, b) = (self.row((2 * t).min(self.height - 1)), self.row((2 * t + 1).min(self.height - 1)));
            for s in 0..w {
                let (l, r) = ((2 * s).min(self.width - 1), (2 * s + 1).min(self.width - 1));
                out.data[t * w + s] = 0.25 * (a[l] + a[r] + b[l] + b[r]);
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(w: usize, h: usize) -> Plane {
        let data = (0..w * h).map(|k| 0.01 * (k % w) as f32 + 0.02 * (k / w) as f32).collect();
        Plane { width: w, height: h, data }
    }

    #[test]
    fn halving_keeps_the_mean() {
        let p = ramp(8, 6);
        let mean = |p: &Plane| p.data.iter().sum::<f32>() / p.data.len() as f32;
        assert!((mean(&p) - mean(&p.halved())).abs() < 1e-6);
    }

    #[test]
    fn a_ramp_is_read_exactly_between_its_pixels() {
        let p = ramp(8, 6);
        for (x, y) in [(0.0f32, 0.0f32), (2.3, 4.9), (7.0, 5.0), (6.99, 0.5)] {
            assert!((p.bilinear_at(x, y) - (0.01 * x + 0.02 * y)).abs() < 1e-6);
        }
    }
}
