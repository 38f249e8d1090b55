//! Light that differs from view to view: shine that moves, shade of the optics, a white image that does not fit. What the
//! picture leaves of a view's samples is averaged over cells of the target view; where that differs from what it leaves of
//! the target's own samples, the difference is taken out of the view's values, so that all speak of the target's light.

use lenslet_core::geometry::Size;
use lenslet_core::image::{Cell, bilinear_by_differences};

use super::view_models::ViewRows;
use crate::inverse::{Problem, Solution};

/// Side of a cell, in spacings of a view's samples.
///
/// Source: chosen; sixteen samples of a view.
const CELL: f32 = 4.0;

/// Least side of a cell, pixels of the target.
///
/// Source: chosen.
const LEAST_SIDE: f32 = 4.0;

/// Samples around a cell at which half of what they say is believed.
///
/// Source: chosen; a view has some hundred there.
const HALF_BELIEVED: f32 = 32.0;

/// Usual residuals at which a sample's weight falls to a quarter.
///
/// Source: chosen.
const UNUSUAL: f32 = 4.0;

/// Takes the light in which the other views differ from the view `target` out of `values`; `pitch`: spacing of a view's
/// samples, pixels of the target.
pub(super) fn equalise(
    values: &mut [[f32; 4]],
    problem: &Problem<'_>,
    solution: &Solution,
    parts: &[ViewRows],
    target: usize,
    pitch: f32,
) {
    let Some(own) = parts.iter().find(|p| p.view == target) else { return };
    let side = (CELL * pitch).max(LEAST_SIDE);
    let own = Light::of_view(problem, solution, own, side);
    for part in parts.iter().filter(|p| p.view != target) {
        let mut light = Light::of_view(problem, solution, part, side);
        for (there, here) in light.means.iter_mut().zip(&own.means) {
            for (t, h) in there.iter_mut().zip(here) {
                *t -= h;
            }
        }
        for row in part.of(problem.rows) {
            let k = row.cell as usize;
            let difference = light.at_pixel(k % problem.grid.width, k / problem.grid.width);
            for (value, d) in values[row.sample as usize].iter_mut().zip(difference) {
                *value -= d;
            }
        }
    }
}

/// Mean of one view's light around each cell.
pub(super) struct Light {
    width: usize,
    height: usize,
    side: f32,
    means: Vec<[f32; 4]>,
}

impl Light {
    /// Of values at places (x, y) of a view of `size` whose samples are `pitch` pixels apart.
    pub(super) fn of_values(values: impl Iterator<Item = ([f32; 2], [f32; 3])>, size: Size, pitch: f32) -> Light {
        let values = values.map(|(place, value)| (place.map(|p| (p + 0.5).max(0.0)), value, 1.0));
        Light::gather(values, size, (CELL * pitch).max(LEAST_SIDE), 0.0)
    }

    fn of_view(problem: &Problem<'_>, solution: &Solution, part: &ViewRows, side: f32) -> Light {
        let grid = &problem.grid;
        let usual = solution.residual.max(1e-3) * UNUSUAL;
        let left = part.of(problem.rows).map(|row| {
            let ([r, g, b, _], size) = problem.left(row, &solution.smooth);
            let unusual = size / usual;
            let weight = row.weight / (1.0 + unusual * unusual).powi(2);
            let k = row.cell as usize;
            ([k % grid.width, k / grid.width].map(|pixel| pixel as f32), [r, g, b], weight)
        });
        Light::gather(left, Size::new(grid.width, grid.height), side, HALF_BELIEVED)
    }

    /// Means of values with weights, each at its distances from the left and upper edge, over cells of `side` pixels.
    fn gather(
        values: impl Iterator<Item = ([f32; 2], [f32; 3], f32)>,
        size: Size,
        side: f32,
        half_believed: f32,
    ) -> Light {
        let cells = |pixels: usize| ((pixels as f32 / side).ceil() as usize).max(1);
        let (width, height) = (cells(size.width), cells(size.height));
        let cell = |from_edge: f32, end: usize| ((from_edge / side) as usize).min(end - 1);
        let mut sums = vec![[0f32; 4]; width * height];
        for ([x, y], value, weight) in values {
            let sum = &mut sums[cell(y, height) * width + cell(x, width)];
            for (sum, value) in sum.iter_mut().zip(value) {
                *sum += weight * value;
            }
            sum[3] += weight;
        }
        Light { width, height, side, means: means_around(&sums, width, height, half_believed) }
    }

    /// The means of cells that anything lies in or beside.
    pub(super) fn filled(&self) -> impl Iterator<Item = [f32; 3]> + '_ {
        self.means.iter().filter(|m| m[3] > 0.0).map(|m| [m[0], m[1], m[2]])
    }

    /// Replaces the means of each cell by one number; 1 where nothing is near.
    pub(super) fn map(&mut self, number: impl Fn([f32; 3]) -> f32) {
        for m in &mut self.means {
            m[0] = if m[3] > 0.0 { number([m[0], m[1], m[2]]) } else { 1.0 };
        }
    }

    /// At a pixel of the view.
    #[inline(always)]
    pub(super) fn at_pixel(&self, s: usize, t: usize) -> [f32; 3] {
        let place = |pixel: usize| (pixel as f32 + 0.5) / self.side - 0.5;
        let cell = Cell::clamped(place(s), place(t), Size::new(self.width, self.height));
        let corners = cell.corners(|x, y| self.means[y * self.width + x]);
        std::array::from_fn(|c| bilinear_by_differences(corners.map(|m| m[c]), cell.fx, cell.fy))
    }
}

/// Binomial mean over the 3×3 cells around each: sums of weighted values and, last, of weights become means, halved where
/// the weights around are `half_believed`.
fn means_around(sums: &[[f32; 4]], width: usize, height: usize, half_believed: f32) -> Vec<[f32; 4]> {
    let around = |k: usize, end: usize| k.saturating_sub(1)..(k + 2).min(end);
    let mut out = Vec::with_capacity(sums.len());
    for t in 0..height {
        for s in 0..width {
            let mut sum = [0f32; 4];
            for v in around(t, height) {
                for u in around(s, width) {
                    let share = ((2 - v.abs_diff(t)) * (2 - u.abs_diff(s))) as f32 / 4.0;
                    for (sum, one) in sum.iter_mut().zip(sums[v * width + u]) {
                        *sum += share * one;
                    }
                }
            }
            let weight = (sum[3] + half_believed / 4.0).max(f32::MIN_POSITIVE);
            out.push([sum[0] / weight, sum[1] / weight, sum[2] / weight, sum[3]]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inverse::{Basis, Grid, Kernel, Row, SampleFootprint, SolveOptions, solve};

    #[test]
    fn smooth_values_at_places_come_back() {
        let light = |x: f32, y: f32| [0.1 + 0.002 * x, 0.3 - 0.001 * y, 0.0];
        let places = (0..900).map(|k| [2.1 * (k % 30) as f32 + 0.4, 1.9 * (k / 30) as f32]);
        let found = Light::of_values(places.map(|[x, y]| ([x, y], light(x, y))), Size::new(63, 57), 2.0);
        for (s, t) in [(30, 28), (12, 40), (45, 15)] {
            let (a, b) = (found.at_pixel(s, t), light(s as f32, t as f32));
            assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 0.002), "{s}, {t}: {a:?} {b:?}");
        }
    }

    #[test]
    fn light_that_only_one_view_has_is_taken_out_of_it() {
        let side = 48usize;
        let basis = Basis::Quadratic;
        let footprint = SampleFootprint::Box { width: 2.0, height: 2.0 };
        let kernel = Kernel::of_footprint(&footprint, basis);
        let grid = Grid::around(Size::new(side, side), kernel.radius() + 3, basis);
        let (n, views) = (side / 2, 5usize);
        let scene = |x: f32, y: f32| 0.5 + 0.2 * (0.4 * x).sin() * (0.3 * y).cos();
        // Shine on one side of the last view, a few usual residuals.
        let shine = |view: usize, x: f32| if view == views - 1 { 0.006 * (x / side as f32) } else { 0.0 };
        let (mut rows, mut parts, mut values) = (Vec::<Row>::new(), Vec::<ViewRows>::new(), Vec::<[f32; 4]>::new());
        for view in 0..views {
            let first = rows.len();
            for k in 0..n * n {
                let place = |k: usize| 2.0 * k as f32 + 0.5 + 0.37 * view as f32;
                let (x, y) = (place(k % n), place(k / n));
                rows.extend(grid.row(x, y, kernel.radius() as f32, 1.0, values.len()));
                values.push([scene(x, y) + shine(view, x), 0.0, 0.0, 0.0]);
            }
            parts.push(ViewRows { view, ranges: std::iter::once(first..rows.len()).collect() });
        }
        let contrast = vec![0.05; grid.pixels()];
        let problem = Problem {
            grid,
            kernel: &kernel,
            rows: &rows,
            values: &values,
            channels: 1,
            slopes: &[],
            contrast: &contrast,
            own: 0..(n * n) as u32,
        };
        let solution = solve(&problem, vec![vec![0.5; grid.pixels()]], &SolveOptions::default());
        let mut equal = values.clone();
        equalise(&mut equal, &problem, &solution, &parts, 0, 2.0);
        let last = (views - 1) * n * n;
        let rms = |values: &[[f32; 4]]| {
            let mut sum = 0.0;
            for (k, value) in values[last..].iter().enumerate() {
                let place = |k: usize| 2.0 * k as f32 + 0.5 + 0.37 * (views - 1) as f32;
                sum += (value[0] - scene(place(k % n), place(k / n))).powi(2);
            }
            (sum / (n * n) as f32).sqrt()
        };
        assert!(rms(&equal) < 0.65 * rms(&values), "{} {}", rms(&equal), rms(&values));
        assert_eq!(equal[..n * n], values[..n * n], "the target's own samples stay");
        let moved = |k: usize| (equal[k][0] - values[k][0]).abs();
        assert!((n * n..last).map(moved).fold(0.0, f32::max) < 0.003, "the other views hardly change");
    }
}
