//! A view's picture on the grid that is solved for.

use ndarray::Array3;

use crate::inverse::Grid;

/// A picture (t, s, c) as one plane a channel on the grid, its border repeated in the margins.
pub(super) fn extended(picture: &Array3<f32>, grid: &Grid) -> Vec<Vec<f32>> {
    let (h, w, c) = picture.dim();
    let inner = |k: usize, side: usize| k.saturating_sub(grid.margin).min(side - 1);
    let plane = |l: usize| {
        let pixel = |k: usize| picture[[inner(k / grid.width, h), inner(k % grid.width, w), l]];
        (0..grid.pixels()).map(pixel).collect()
    };
    (0..c).map(plane).collect()
}
