//! Algorithm 1 as printed, "rotate image by the estimated angle", for captures: the demosaiced raw is resampled so that
//! its rows of lenslets lie along the pixels. For comparison only: the default turns coordinates, and resamples once.

use crate::geometry::Size;
use ndarray::Array3;
use rayon::prelude::*;

use crate::image::{Cell, bilinear_by_differences};

/// A turn about the middle of a picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turn {
    middle: [f64; 2],
    sin: f64,
    cos: f64,
}

impl Turn {
    /// The turn that makes a direction at `angle` (radians, clockwise on screen) horizontal.
    pub(super) fn upright(angle: f64, width: usize, height: usize) -> Turn {
        let (sin, cos) = angle.sin_cos();
        Turn { middle: [(width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0], sin, cos }
    }

    /// Where a place of the picture lies in the turned one.
    #[inline]
    pub(super) fn turned(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (dx, dy) = (x - self.middle[0], y - self.middle[1]);
        [self.middle[0] + self.cos * dx + self.sin * dy, self.middle[1] + self.cos * dy - self.sin * dx]
    }

    /// Where a place of the turned picture lies in the picture.
    #[inline]
    fn unturned(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (dx, dy) = (x - self.middle[0], y - self.middle[1]);
        [self.middle[0] + self.cos * dx - self.sin * dy, self.middle[1] + self.sin * dx + self.cos * dy]
    }

    /// The picture (t, s, c) turned, bilinear; beyond its border the edge pixel repeats.
    pub(super) fn apply(&self, image: &Array3<f32>) -> Array3<f32> {
        let (height, width, channels) = image.dim();
        let mut out = Array3::zeros(image.dim());
        if let Some(flat) = out.as_slice_mut() {
            flat.par_chunks_mut((width * channels).max(1)).enumerate().for_each(|(y, row)| {
                for (x, pixel) in row.chunks_exact_mut(channels).enumerate() {
                    let [sx, sy] = self.unturned([x as f64, y as f64]);
                    let cell = Cell::clamped(sx, sy, Size::new(width, height));
                    for (c, p) in pixel.iter_mut().enumerate() {
                        let corners = cell.corners(|x, y| image[[y, x, c]]);
                        *p = bilinear_by_differences(corners, cell.fx as f32, cell.fy as f32);
                    }
                }
            });
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_turned_is_the_ramp_at_turned_places() {
        let image = Array3::from_shape_fn((60, 80, 2), |(t, s, c)| 0.01 * s as f32 + 0.02 * t as f32 + c as f32);
        let turn = Turn::upright(0.05, 80, 60);
        let out = turn.apply(&image);
        for (x, y) in [(40.0, 30.0), (20.3, 21.8), (55.1, 33.3)] {
            let [tx, ty] = turn.turned([x, y]);
            let back = turn.unturned([tx, ty]);
            assert!((back[0] - x).abs() < 1e-9 && (back[1] - y).abs() < 1e-9);
            let cell = Cell::clamped(tx, ty, Size::new(80, 60));
            let seen = bilinear_by_differences(cell.corners(|x, y| f64::from(out[[y, x, 1]])), cell.fx, cell.fy);
            assert!((seen - (0.01 * x + 0.02 * y + 1.0)).abs() < 1e-5, "{seen}");
        }
        // What lies along the angle becomes horizontal.
        let along = [10.0 * 0.05f64.cos(), 10.0 * 0.05f64.sin()];
        let [a, b] = [[30.0, 20.0], [30.0 + along[0], 20.0 + along[1]]].map(|p| turn.turned(p));
        assert!((a[1] - b[1]).abs() < 1e-9 && (b[0] - a[0] - 10.0).abs() < 1e-9);
    }
}
