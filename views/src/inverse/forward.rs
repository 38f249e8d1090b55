//! Where samples lie in the picture that is solved for, and what the picture gives there: B(x)·J.

use super::basis::{Basis, slopes, weights};
use lenslet_core::geometry::Size;

/// The pixels that are solved for: a view and `margin` pixels around it, which footprints at its border reach.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grid {
    /// Width with both margins, pixels.
    pub width: usize,
    /// Height with both margins, pixels.
    pub height: usize,
    /// Pixels on each side that do not belong to the view.
    pub margin: usize,
    /// How the picture is interpolated between its pixels.
    pub basis: Basis,
}

impl Grid {
    /// The grid of a view of `width`×`height` pixels.
    #[must_use]
    pub fn around(size: Size, margin: usize, basis: Basis) -> Self {
        let Size { width, height } = size;
        Grid { width: width + 2 * margin, height: height + 2 * margin, margin, basis }
    }

    /// Pixels of the grid.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// The row of a sample at (`x`, `y`) of the view, with its weight; `None` where a footprint of `reach` pixels would
    /// leave the grid.
    #[inline(always)]
    #[must_use]
    pub fn row(&self, x: f32, y: f32, reach: f32, weight: f32, sample: usize) -> Option<Row> {
        let (gx, gy) = (x + self.margin as f32, y + self.margin as f32);
        let inside = |g: f32, side: usize| g >= reach + 1.0 && g < side as f32 - 2.0 - reach;
        if !(inside(gx, self.width) && inside(gy, self.height)) {
            return None;
        }
        let ((x0, fx), (y0, fy)) = (self.basis.split(gx), self.basis.split(gy));
        Some(Row { cell: (y0 * self.width + x0) as u32, fx, fy, weight, sample: sample as u32 })
    }

    /// Where a row lies, pixels of the view.
    #[inline]
    #[must_use]
    pub fn place(&self, row: &Row) -> (f32, f32) {
        let k = row.cell as usize;
        let centre = (self.basis.taps() - 2) as f32 / 2.0;
        let at = |k: usize, f: f32| k as f32 + centre + f - self.margin as f32;
        (at(k % self.width, row.fx), at(k / self.width, row.fy))
    }
}

/// A sample in the picture: the upper left of the pixels around it, the place between them, the weight, and which
/// sample it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Index of the upper left pixel in the grid.
    pub cell: u32,
    /// Place along x, 0 to 1.
    pub fx: f32,
    /// Place along y, 0 to 1.
    pub fy: f32,
    /// Weight of the sample before any reweighting.
    pub weight: f32,
    /// Index of the sample's value.
    pub sample: u32,
}

impl Row {
    /// B(x)·`picture` with `N` pixels an axis, every lane by itself; rows of the picture have `width` pixels.
    #[inline(always)]
    pub(super) fn apply<const N: usize>(&self, picture: &[[f32; 4]], width: usize) -> [f32; 4] {
        let (bx, by) = (weights::<N>(self.fx), weights::<N>(self.fy));
        let mut sum = [0f32; 4];
        for j in 0..N {
            let at = self.cell as usize + j * width;
            for (b, p) in bx.iter().zip(&picture[at..at + N]) {
                add_times(&mut sum, by[j] * b, p);
            }
        }
        sum
    }

    /// [`Row::apply`], and how it changes with the place along x and y.
    #[inline(always)]
    pub(super) fn apply_with_slopes<const N: usize>(&self, picture: &[[f32; 4]], width: usize) -> [[f32; 4]; 3] {
        let (bx, by) = (weights::<N>(self.fx), weights::<N>(self.fy));
        let (dx, dy) = (slopes::<N>(self.fx), slopes::<N>(self.fy));
        let mut sums = [[0f32; 4]; 3];
        for j in 0..N {
            let at = self.cell as usize + j * width;
            for (i, p) in picture[at..at + N].iter().enumerate() {
                add_times(&mut sums[0], by[j] * bx[i], p);
                add_times(&mut sums[1], by[j] * dx[i], p);
                add_times(&mut sums[2], dy[j] * bx[i], p);
            }
        }
        sums
    }
}

#[inline(always)]
fn add_times(sum: &mut [f32; 4], factor: f32, value: &[f32; 4]) {
    for (s, v) in sum.iter_mut().zip(value) {
        *s += factor * v;
    }
}

/// Planes of up to three channels as lanes, the rest 0.
pub(super) fn interleaved(planes: &[Vec<f32>]) -> Vec<[f32; 4]> {
    let mut lanes = vec![[0f32; 4]; planes.first().map_or(0, Vec::len)];
    for (l, plane) in planes.iter().enumerate().take(3) {
        for (lanes, &p) in lanes.iter_mut().zip(plane) {
            lanes[l] = p;
        }
    }
    lanes
}
