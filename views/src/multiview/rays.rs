//! Where the samples of all views lie in one view, by the disparity of their surfaces, and the weight of each there.

use std::ops::Range;

use lenslet_core::geometry::Size;
use lenslet_core::image::bilinear_shares;

use super::sample_set::SampleSet;
use super::view_disparities::{ViewDisparities, steps_between};

/// A sample carried to the target view: cell (upper left of four pixels), position within it, weight.
#[derive(Clone, Copy)]
pub(super) struct Ray {
    pub(super) cell: u32,
    fx: f32,
    fy: f32,
    pub(super) weight: f32,
    /// Which sample of which view.
    pub(super) sample: u32,
}

impl Ray {
    fn new(x: f32, y: f32, w: usize, weight: f32, sample: usize) -> Ray {
        let (x0, y0) = (x as usize, y as usize);
        Ray { cell: (y0 * w + x0) as u32, fx: x - x0 as f32, fy: y - y0 as f32, weight, sample: sample as u32 }
    }

    /// Shares of the four pixels.
    #[inline]
    pub(super) fn shares(&self) -> [f32; 4] {
        bilinear_shares(self.fx, self.fy)
    }

    /// Sample minus image; the lane of the weight is 0.
    #[inline]
    pub(super) fn residual(&self, b: &[f32; 4], f: &[f32; 4], image: &[[f32; 4]], w: usize) -> [f32; 4] {
        let k = self.cell as usize;
        let (p, q) = (&image[k..k + 2], &image[k + w..k + w + 2]);
        let mut r = [0f32; 4];
        for l in 0..3 {
            r[l] = f[l] - (b[0] * p[0][l] + b[1] * p[1][l] + b[2] * q[0][l] + b[3] * q[1][l]);
        }
        r
    }

    /// Adds `value` to the four pixels by their shares.
    #[inline]
    pub(super) fn spread(&self, b: &[f32; 4], value: &[f32; 4], sums: &mut [[f32; 4]], w: usize) {
        let k = self.cell as usize;
        for (b, at) in b.iter().zip([k, k + 1, k + w, k + w + 1]) {
            for l in 0..4 {
                sums[at][l] += b * value[l];
            }
        }
    }
}

/// Weight of a sample of the target view itself, whose place is certain.
///
/// Source: chosen.
pub(super) const OWN: f32 = 2.0;

/// Misplacement (pixels of the target) at which the weight of a sample falls to a quarter.
///
/// Source: chosen.
const TOLERANCE: f32 = 0.6;

/// The samples of the view itself.
pub(super) fn own_samples(set: &SampleSet, disparities: &ViewDisparities, at: (usize, usize), size: Size) -> Vec<Ray> {
    let first = (at.0 * disparities.columns + at.1) * set.points.len();
    let (right, bottom) = ((size.width - 1) as f32, (size.height - 1) as f32);
    let inside = |p: &[f32; 2]| p[0] >= 0.0 && p[1] >= 0.0 && p[0] < right && p[1] < bottom;
    let points = set.points.iter().enumerate().filter(|(_, p)| inside(p));
    points.map(|(i, p)| Ray::new(p[0], p[1], size.width, OWN, first + i)).collect()
}

/// Where every sample of every other view lies in the target view; samples hidden there are left out.
pub(super) fn other_samples(
    set: &SampleSet,
    disparities: &ViewDisparities,
    at: (usize, usize),
    size: Size,
) -> Vec<Ray> {
    let views = set.views();
    let target_view = at.0 * views.1 + at.1;
    let n = set.points.len();
    let mut rays = Vec::with_capacity(n * (views.0 * views.1).saturating_sub(1));
    let (right, bottom) = ((size.width - 1) as f32, (size.height - 1) as f32);
    for k in (0..views.0 * views.1).filter(|&k| k != target_view && !set.is_dark(k)) {
        carry_samples(set, disparities, 0..n, [k, target_view], |carried| {
            let (x, y) = carried.place;
            // Also false for NaN.
            if !(x >= 0.0 && y >= 0.0 && x < right && y < bottom) {
                return;
            }
            let weight = carried.weight_at(disparities, target_view, carried.place);
            if weight >= LEAST_WEIGHT {
                rays.push(Ray::new(x, y, size.width, weight, carried.sample));
            }
        });
    }
    rays
}

/// Weight below which a sample of another view is left out.
///
/// Source: chosen.
pub(super) const LEAST_WEIGHT: f32 = 0.02;

/// A sample of another view, carried to a target view by its disparity.
#[derive(Clone, Copy)]
pub(super) struct Carried {
    pub(super) sample: usize,
    /// Where it lies in the target view.
    pub(super) place: (f32, f32),
    disparity: f32,
    /// View steps between the two views along the longer axis.
    steps: f32,
    /// Share of the light squared: noise grows as light falls.
    light: f32,
}

impl Carried {
    /// Its weight at `place` of the target view: 1 in full light where the surface there has its disparity, towards 0
    /// as the surface's would put it elsewhere.
    #[inline(always)]
    pub(super) fn weight_at(&self, disparities: &ViewDisparities, target: usize, place: (f32, f32)) -> f32 {
        let miss = (disparities.near(target, place.0, place.1) - self.disparity) * (self.steps / TOLERANCE);
        let agree = 1.0 / (1.0 + miss * miss);
        self.light * (agree * agree)
    }
}

/// Calls `each` for the samples `some` of the view `from` that are not withheld, carried to the view `target`.
#[inline(always)]
pub(super) fn carry_samples(
    set: &SampleSet,
    disparities: &ViewDisparities,
    some: Range<usize>,
    [from, target]: [usize; 2],
    mut each: impl FnMut(Carried),
) {
    let [du, dv] = steps_between(set.views(), from, target);
    let (steps, light) = (du.abs().max(dv.abs()), set.weights[from] * set.weights[from]);
    let first = from * set.points.len() + some.start;
    for ((i, p), &d) in set.points[some].iter().enumerate().zip(&disparities.samples[first..]) {
        if !set.is_withheld(first + i) {
            each(Carried { sample: first + i, place: (p[0] - d * du, p[1] - d * dv), disparity: d, steps, light });
        }
    }
}

/// Calls `each` for every sample of every view with its position (x, y) in the view `at`, its weight and its value.
pub(super) fn for_each_ray(
    set: &SampleSet,
    disparities: &ViewDisparities,
    at: (usize, usize),
    size: Size,
    mut each: impl FnMut(f32, f32, f32, &[f32]),
) {
    for ray in own_samples(set, disparities, at, size).into_iter().chain(other_samples(set, disparities, at, size)) {
        let (x, y) = (ray.cell as usize % size.width, ray.cell as usize / size.width);
        let value = &set.lanes[ray.sample as usize][..set.channels()];
        each(x as f32 + ray.fx, y as f32 + ray.fy, ray.weight, value);
    }
}
