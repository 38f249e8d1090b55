//! How far the other views are believed, place by place: the picture found from them foretells the view's own samples, and
//! so do the samples around each in the view itself. Where what the others leave of them comes near to what the samples
//! around leave (glass, a wrong disparity, blurred views), the view is better off alone. Luminance is asked: colours of
//! captures are what demosaicing made of them, and smoothed ones are foretold by those around wherever they came from.
//!
//! Measured over planted scenes (views/tests/scenes.rs): the joint fit is better than the view alone where the root mean
//! square of what the other views leave of its samples, beyond noise, is below 0.45 of what the samples around leave, and
//! worse above, with lenslets and with pixels, with noise and without.

use lenslet_core::geometry::Size;

use super::cross_validation::{falling, lower_quantiles};
use super::local_light::Light;
use crate::buckets::Buckets;
use crate::inverse::{LEAST_RESIDUAL, Problem, Row};

/// Root mean square that the other views leave of a view's own samples beyond noise, as a share of what the samples around
/// leave: full trust up to the first, none from the second.
///
/// Source: measured, views/tests/scenes.rs: the view alone is as good at 0.45.
const LEFT: [f32; 2] = [0.35, 0.6];

/// Of the places of like light one in this many has noise alone.
///
/// Source: chosen; more would take for noise what glass makes of a picture.
const QUIETEST: usize = 10;

/// Mean squares this many times those of the quietest places of like light are noise.
///
/// Source: chosen: of some thirty samples of noise, one mean in twenty is larger.
const NOISE: f32 = 2.2;

/// Variance of the difference between a sample and what six around it foretell, of independent noise of variance 1.
///
/// Source: computed: 1 + (16 + 1)/(9·6).
const ONE_AND_AROUND: f32 = 1.31;

/// What other views leave of a sample counts as this many times the mean of what they leave of those beside it at most: a
/// lone sample of which they leave much is at fault itself (dust on its lenslet), not they.
///
/// Source: chosen; of noise alone in three channels, one sample in forty is larger.
const LONE: f32 = 4.0;

/// Power of the trust by which the weight of other views' samples falls: there are many of them.
///
/// Source: chosen.
const POWER: i32 = 3;

/// Side of the cells over which squares are averaged, as a share of that of light's.
///
/// Source: chosen; four samples of the view.
const CELLS: f32 = 0.5;

/// The samples around each sample of a view from which that can be told: those beside it, and those twice as far.
pub(super) struct Neighbours {
    /// Where the list of each sample begins.
    starts: Vec<u32>,
    /// Pairs of a sample beside, and the one twice as far.
    pairs: Vec<[u32; 2]>,
}

impl Neighbours {
    /// Of samples about `pitch` pixels apart.
    pub(super) fn of(points: &[[f32; 2]], pitch: f32) -> Self {
        let buckets = Buckets::new(points, pitch.max(1e-3));
        let near = |place: [f32; 2], reach: f32| {
            let within = move |p: [f32; 2]| (p[0] - place[0]).powi(2) + (p[1] - place[1]).powi(2) < reach * reach;
            buckets.around(place, reach).filter(move |&i| within(points[i as usize]))
        };
        let mut out = Neighbours { starts: vec![0], pairs: Vec::new() };
        for (i, p) in points.iter().enumerate() {
            let first = out.pairs.len();
            let (mut beside, mut balance) = (0, [0f32; 2]);
            for j in near(*p, 1.3 * pitch).filter(|&j| j as usize != i) {
                let q = points[j as usize];
                let twice = [2.0 * q[0] - p[0], 2.0 * q[1] - p[1]];
                beside += 1;
                balance = [balance[0] + q[0] - p[0], balance[1] + q[1] - p[1]];
                out.pairs.extend(near(twice, 0.4 * pitch).last().map(|k| [j, k]));
            }
            // At the border and beside gaps nothing is told.
            if out.pairs.len() - first < beside || beside < 4 || balance[0].hypot(balance[1]) > 0.5 * pitch {
                out.pairs.truncate(first);
            }
            out.starts.push(out.pairs.len() as u32);
        }
        out
    }

    /// Those around the sample `i`; none where nothing is told of it.
    fn around(&self, i: usize) -> &[[u32; 2]] {
        &self.pairs[self.starts[i] as usize..self.starts[i + 1] as usize]
    }

    /// What the samples around foretell of the sample `i`, as cubic interpolation would along every direction.
    pub(super) fn foretold(&self, i: usize, value: impl Fn(u32) -> [f32; 4]) -> Option<[f32; 4]> {
        let pairs = self.around(i);
        let mut sum = [0f32; 4];
        for [near, far] in pairs {
            let (near, far) = (value(*near), value(*far));
            for (sum, (n, f)) in sum.iter_mut().zip(near.iter().zip(far)) {
                *sum += (4.0 * n - f) / 3.0;
            }
        }
        (!pairs.is_empty()).then(|| sum.map(|s| s / pairs.len() as f32))
    }
}

/// Trust in the other views, 0 to 1, at every pixel of a grid.
pub(super) struct Trust {
    pixels: Vec<f32>,
}

impl Trust {
    /// From a picture `smooth` (as samples see it) that the view's own samples had no part in.
    pub(super) fn new(problem: &Problem<'_>, smooth: &[[f32; 4]], neighbours: &Neighbours, pitch: f32) -> Trust {
        let grid = &problem.grid;
        let value = |i: u32| problem.values[(problem.own.start + i) as usize];
        let own: Vec<&Row> = problem.rows.iter().filter(|row| problem.own.contains(&row.sample)).collect();
        let number = |row: &Row| (row.sample - problem.own.start) as usize;
        let mut by_views = vec![0f32; problem.own.len()];
        for row in &own {
            by_views[number(row)] = problem.left(row, smooth).1.powi(2);
        }
        let squares = own.iter().filter_map(|row| {
            let i = number(row);
            let around = neighbours.foretold(i, value)?;
            let here = value(i as u32);
            let by_samples: [f32; 4] = std::array::from_fn(|l| here[l] - around[l]);
            let beside = neighbours.around(i);
            let beside = beside.iter().map(|[j, _]| by_views[*j as usize]).sum::<f32>() / beside.len() as f32;
            let light = here.iter().sum::<f32>();
            let by_views = by_views[i].min(LONE * beside);
            Some((grid.place(row).into(), [by_views, problem.luminance_left(row, &by_samples).powi(2), light]))
        });
        let view = Size::new(grid.width - 2 * grid.margin, grid.height - 2 * grid.margin);
        let mut cells = Light::of_values(squares, view, CELLS * pitch);
        let of_light = |c: usize| cells.filled().map(|m| (m[2], m[c])).collect();
        let least = LEAST_RESIDUAL * LEAST_RESIDUAL;
        // The quietest places are noise; what tells little there is nearer to it.
        let left = [0, 1].map(|c| lower_quantiles(of_light(c), QUIETEST, [least, f32::INFINITY], least));
        let noise_at = |light: f32| left[0].noise_at(light).min(left[1].noise_at(light) / ONE_AND_AROUND).max(least);
        cells.map(|[views, samples, light]| trust_of(views, samples, noise_at(light)));
        let inner = |k: usize, side: usize| k.saturating_sub(grid.margin).min(side - 1);
        let at = |k: usize| cells.at_pixel(inner(k % grid.width, view.width), inner(k / grid.width, view.height))[0];
        Trust { pixels: (0..grid.pixels()).map(at).collect() }
    }

    /// Weighs rows of other views.
    pub(super) fn weigh<'a>(&self, rows: impl Iterator<Item = &'a mut Row>) {
        for row in rows {
            row.weight *= self.pixels[row.cell as usize].powi(POWER);
        }
    }

    /// The picture `together` where the other views are trusted, `alone` elsewhere.
    pub(super) fn mixed(&self, mut alone: Vec<Vec<f32>>, together: &[Vec<f32>]) -> Vec<Vec<f32>> {
        for (alone, together) in alone.iter_mut().zip(together) {
            for ((alone, together), trust) in alone.iter_mut().zip(together).zip(&self.pixels) {
                *alone += trust * (together - *alone);
            }
        }
        alone
    }
}

fn trust_of(by_views: f32, by_samples: f32, noise: f32) -> f32 {
    let beyond_noise = (by_views - NOISE * noise).max(0.0);
    let left = (beyond_noise / by_samples.max(1e-12)).sqrt();
    falling(left, LEFT)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lattice() -> Vec<[f32; 2]> {
        let place = |k: usize| [3.3 * (k % 20) as f32 + 1.65 * ((k / 20) % 2) as f32, 2.858 * (k / 20) as f32];
        (0..400).map(place).collect()
    }

    #[test]
    fn samples_around_foretell_a_parabola_and_nothing_at_the_border() {
        let points = lattice();
        let neighbours = Neighbours::of(&points, 3.3);
        let value = |i: u32| {
            let [x, y] = points[i as usize];
            [0.3 + 0.01 * x - 0.02 * y + 0.002 * x * y + 0.001 * y * y, 0.0, 0.0, 0.0]
        };
        let inner = 10 * 20 + 10;
        let found = neighbours.foretold(inner, value).unwrap();
        assert!((found[0] - value(inner as u32)[0]).abs() < 2e-3, "{found:?}");
        assert!(neighbours.foretold(0, value).is_none() && neighbours.foretold(19, value).is_none());
    }

    #[test]
    fn what_is_foretold_is_trusted_and_what_is_contradicted_is_not() {
        let noise = 1e-4;
        assert_eq!(trust_of(1.5e-4, 1.3e-4, noise), 1.0, "noise alone");
        assert_eq!(trust_of(4e-4, 9e-3, noise), 1.0, "texture foretold");
        assert_eq!(trust_of(6e-3, 9e-3, noise), 0.0, "texture contradicted");
        let half = trust_of(2e-3, 9e-3, noise);
        assert!(half > 0.2 && half < 0.9, "{half}");
    }
}
