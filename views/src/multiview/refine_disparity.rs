//! Disparity made exact by the samples themselves: with the image I fitted to all samples at their places x = p − D·u,
//! minimises Σ w (f − I(p − D·u))² over D around each pixel, by Gauss–Newton steps. Disparities matched between
//! interpolated views are biased towards zero, since all views have their samples at the same places; those fitted to
//! the samples are not.

use rayon::prelude::*;

use super::sample_set::SampleSet;
use super::view_disparities::{ViewDisparities, view_offset};
use lenslet_core::image::{Plane, bilinear_shares, bilinear_with_slopes};

/// Rounds of fitting the image and correcting the disparity.
///
/// Source: chosen.
const ROUNDS: usize = 4;

/// Largest correction of one round, pixels of the map at the outermost view.
///
/// Source: chosen.
const STEP: f32 = 0.7;

/// Pixels of the map around a pixel that share its correction.
///
/// Source: chosen.
const RADIUS: usize = 4;

/// Neighbours whose disparities differ by more (pixels of the target per view step) belong to another surface.
///
/// Source: chosen.
const SAME: f32 = 0.2;

/// Least noise of brightness (square root of linear light) that is assumed.
///
/// Source: chosen: noise of a good camera.
const NOISE: f32 = 0.008;

/// Sums over the samples around a pixel, which determine its correction.
#[derive(Clone, Copy, Default)]
struct Vote {
    /// Σ w g², Σ w r g: normal equation of the correction.
    normal: f32,
    right: f32,
    /// Σ min(r², spread²), and how many samples.
    misfit: f32,
    weight: f32,
}

impl Vote {
    #[inline]
    fn add(&mut self, other: &Vote) {
        self.normal += other.normal;
        self.right += other.right;
        self.misfit += other.misfit;
        self.weight += other.weight;
    }
}

/// The middle view's map of `disparities`, corrected; `light`: brightness of every sample, views one after the other.
pub(super) fn refine_disparity(set: &SampleSet, light: &[f32], disparities: &ViewDisparities) -> Plane {
    let scale = disparities.scale;
    let views = (disparities.rows, disparities.columns);
    let middle = (views.0 / 2) * views.1 + views.1 / 2;
    let mut map = disparities.maps[middle].clone();
    let (w, h) = (map.width, map.height);
    if w < 8 || h < 8 || views.0 * views.1 < 2 {
        return map;
    }
    let reach =
        (0..views.0 * views.1).map(|k| view_offset(views, k)).fold(1f32, |m, s| m.max(s[0].abs()).max(s[1].abs()));
    let mut rays = origins(set, disparities);
    let mut best = map.clone();
    let mut least = vec![f32::INFINITY; w * h];
    for round in 0..=ROUNDS {
        place(set, &map, scale, views, &mut rays);
        let image = fit(light, &rays, w, h);
        let spread = spread(light, &rays, &image);
        let votes = gather(&vote(light, &rays, &image, views, scale, spread), &map);
        for (k, v) in votes.iter().enumerate() {
            let misfit = v.misfit / v.weight.max(1e-6);
            if misfit < least[k] {
                (least[k], best.data[k]) = (misfit, map.data[k]);
            }
        }
        if round == ROUNDS {
            break;
        }
        let unit = scale[0].max(scale[1]);
        let limit = STEP * unit / reach;
        // Damping: the texture with which a correction is in error by a tenth of a pixel at the outermost view.
        let least = spread * spread * (reach * reach) / (0.1 * unit).powi(2);
        map.data.par_iter_mut().zip(&votes).for_each(|(d, v)| {
            *d += (v.right / (v.normal + least)).clamp(-limit, limit);
        });
    }
    best
}

/// A sample: which, and where it lies in the middle view, pixels of the map.
#[derive(Clone, Copy)]
struct Ray {
    sample: u32,
    view: u16,
    x: f32,
    y: f32,
}

/// Samples of surfaces that are visible in the middle view.
fn origins(set: &SampleSet, disparities: &ViewDisparities) -> Vec<Ray> {
    let views = (disparities.rows, disparities.columns);
    let middle = (views.0 / 2) * views.1 + views.1 / 2;
    let n = set.points.len();
    let scale = disparities.scale;
    let (right, bottom) = ((set.target.width - 1) as f32, (set.target.height - 1) as f32);
    (0..views.0 * views.1)
        .into_par_iter()
        .filter(|&k| !set.is_dark(k))
        .flat_map_iter(|k| {
            let u = view_offset(views, k);
            set.points.iter().enumerate().filter_map(move |(i, p)| {
                let d = disparities.at(k, p[0], p[1]);
                let (x, y) = (p[0] - d * u[0], p[1] - d * u[1]);
                let seen = x >= 0.0 && y >= 0.0 && x <= right && y <= bottom;
                let miss = (disparities.at(middle, x, y) - d).abs();
                (seen && miss < SAME).then(|| Ray {
                    sample: (k * n + i) as u32,
                    view: k as u16,
                    x: (x + 0.5) / scale[0] - 0.5,
                    y: (y + 0.5) / scale[1] - 0.5,
                })
            })
        })
        .collect()
}

/// Where the samples lie under the disparities of `map`.
fn place(set: &SampleSet, map: &Plane, scale: [f32; 2], views: (usize, usize), rays: &mut [Ray]) {
    let n = set.points.len();
    rays.par_iter_mut().for_each(|ray| {
        let p = set.points[ray.sample as usize % n];
        let u = view_offset(views, ray.view as usize);
        let (s, t) = ((ray.x + 0.5).max(0.0) as usize, (ray.y + 0.5).max(0.0) as usize);
        let d = map.data[t.min(map.height - 1) * map.width + s.min(map.width - 1)];
        ray.x = (p[0] - d * u[0] + 0.5) / scale[0] - 0.5;
        ray.y = (p[1] - d * u[1] + 0.5) / scale[1] - 0.5;
    });
}

/// Cell, shares of its four pixels; none outside.
#[inline]
fn cell(ray: &Ray, w: usize, h: usize) -> Option<(usize, f32, f32)> {
    if !(ray.x >= 0.0 && ray.y >= 0.0 && ray.x < (w - 1) as f32 && ray.y < (h - 1) as f32) {
        return None;
    }
    let (x, y) = (ray.x as usize, ray.y as usize);
    Some((y * w + x, ray.x - x as f32, ray.y - y as f32))
}

/// Sums that every ray adds to, `size` of them: a few fixed parts side by side, then added up in order.
fn scattered<T: Copy + Default + Send>(
    rays: &[Ray],
    size: usize,
    each: impl Fn(&Ray, &mut [T]) + Sync,
    add: impl Fn(&mut T, &T),
) -> Vec<T> {
    let parts: Vec<Vec<T>> = rays
        .par_chunks(rays.len().div_ceil(PARTS).max(1))
        .map(|rays| {
            let mut sums = vec![T::default(); size];
            rays.iter().for_each(|ray| each(ray, &mut sums));
            sums
        })
        .collect();
    let mut total = vec![T::default(); size];
    for part in &parts {
        total.iter_mut().zip(part).for_each(|(a, b)| add(a, b));
    }
    total
}

/// Parts of the rays that are summed separately.
///
/// Source: chosen; the same on every machine, so that sums do not depend on threads.
const PARTS: usize = 4;

/// The image of the samples: their means at each pixel, plus once the means of the residuals.
fn fit(light: &[f32], rays: &[Ray], w: usize, h: usize) -> Plane {
    let mut image = vec![0f32; w * h];
    for _ in 0..2 {
        let add = |a: &mut [f32; 2], b: &[f32; 2]| *a = [a[0] + b[0], a[1] + b[1]];
        let sums = scattered(
            rays,
            w * h,
            |ray, sums: &mut [[f32; 2]]| {
                let Some((k, fx, fy)) = cell(ray, w, h) else { return };
                let b = bilinear_shares(fx, fy);
                let r = light[ray.sample as usize]
                    - (b[0] * image[k] + b[1] * image[k + 1] + b[2] * image[k + w] + b[3] * image[k + w + 1]);
                for (b, at) in b.into_iter().zip([k, k + 1, k + w, k + w + 1]) {
                    sums[at][0] += b * r;
                    sums[at][1] += b;
                }
            },
            add,
        );
        for (p, s) in image.iter_mut().zip(&sums) {
            *p += s[0] / (s[1] + 1e-3);
        }
    }
    Plane { width: w, height: h, data: image }
}

/// Residual of a ray, and how the image changes there along x and y (pixels of the map).
#[inline]
fn residual(light: &[f32], ray: &Ray, image: &Plane) -> Option<(f32, f32, f32)> {
    let w = image.width;
    let (k, fx, fy) = cell(ray, w, image.height)?;
    let corners = [image.data[k], image.data[k + 1], image.data[k + w], image.data[k + w + 1]];
    let [value, dx, dy] = bilinear_with_slopes(corners, fx, fy);
    Some((light[ray.sample as usize] - value, dx, dy))
}

/// Residual beyond which the weight of a sample is small: three times the usual one.
fn spread(light: &[f32], rays: &[Ray], image: &Plane) -> f32 {
    let few = rays.iter().step_by(37);
    let mut squares: Vec<f32> = few.filter_map(|r| residual(light, r, image)).map(|(r, ..)| r * r).collect();
    squares.sort_unstable_by(f32::total_cmp);
    let median = squares.get(squares.len() / 2).copied().unwrap_or(0.0);
    // The median of squares is 0.455 of their mean.
    3.0 * (median / 0.455).sqrt().max(NOISE)
}

/// The terms of every sample, added up at the pixel nearest to it.
fn vote(light: &[f32], rays: &[Ray], image: &Plane, views: (usize, usize), scale: [f32; 2], spread: f32) -> Vec<Vote> {
    let w = image.width;
    let steps: Vec<[f32; 2]> = (0..views.0 * views.1).map(|k| view_offset(views, k)).collect();
    let each = |ray: &Ray, votes: &mut [Vote]| {
        let Some((r, gx, gy)) = residual(light, ray, image) else { return };
        let u = steps[ray.view as usize];
        let g = -(gx * u[0] / scale[0] + gy * u[1] / scale[1]);
        let belief = 1.0 / (1.0 + (r / spread).powi(2));
        let weight = belief * belief;
        let misfit = (r * r).min(spread * spread);
        votes[(ray.y + 0.5) as usize * w + (ray.x + 0.5) as usize].add(&Vote {
            normal: weight * g * g,
            right: weight * g * r,
            misfit,
            weight: 1.0,
        });
    };
    scattered(rays, w * image.height, each, Vote::add)
}

/// Sums of these terms over the pixels of the same surface around every pixel.
fn gather(votes: &[Vote], map: &Plane) -> Vec<Vote> {
    let (w, h) = (map.width, map.height);
    let mut out = vec![Vote::default(); w * h];
    out.par_chunks_mut(w).enumerate().for_each(|(t, row)| {
        for (s, o) in row.iter_mut().enumerate() {
            let own = map.data[t * w + s];
            for y in t.saturating_sub(RADIUS)..=(t + RADIUS).min(h - 1) {
                for x in s.saturating_sub(RADIUS)..=(s + RADIUS).min(w - 1) {
                    if (map.data[y * w + x] - own).abs() < SAME {
                        o.add(&votes[y * w + x]);
                    }
                }
            }
        }
    });
    out
}
