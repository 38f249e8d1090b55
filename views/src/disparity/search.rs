//! Search at one size: costs regularised, the minimum made sub-pixel, outliers removed.

use lenslet_core::image::Plane;
use lenslet_core::progress::Observer;
use ndarray::Array2;
use rayon::prelude::*;

use super::depth_order::DepthOrder;
use super::error::Error;
use super::find_order::find_depth_order;
use super::hidden::Hidden;
use super::options::Options;
use super::volume::{confidence_of, cost_volume, hypotheses, outermost_step};
use super::{regularise, sweep, tensor};

/// What a search at one size gives, pixel by pixel.
pub(super) struct Found {
    pub(super) disparity: Vec<f32>,
    pub(super) confidence: Vec<f32>,
}

/// Shorter side, pixels, from which on the first map is found at half the size.
///
/// Source: chosen.
const HALVED: usize = 64;

/// Differences of disparity, in steps between hypotheses, up to which nothing hides anything.
///
/// Source: chosen.
const MARGIN: f32 = 0.3;

/// How costs are made and smoothed.
#[derive(Debug, Clone, Copy)]
struct Smoothing {
    /// 0 clean, 1 noisy.
    noise: f32,
    /// Radius of the filter along edges, pixels.
    radius: usize,
    /// Brightness differences are cut off at this share of the option's value.
    truncation: f32,
    /// Power of the local contrast that costs are divided by.
    contrast: f32,
    /// Confidence from which on a surface is taken to hide what is behind it.
    sure: f32,
    penalties: regularise::Penalties,
}

/// Residual, a quarter of the least costs being lower, at and below which views count as clean, and at and above which as
/// noisy.
///
/// Source: measured at half the size: rendered views have 0.0012 to 0.0030, views of simulated captures 0.0053 to 0.0083.
const NOISE: [f32; 2] = [0.0013, 0.0055];

/// Costs that are, in the mean over all hypotheses, as high as the first are left as they are when divided by the local
/// contrast; the second is added to both, so that costs of no contrast at all grow by a bounded factor.
///
/// Source: the best of those tried on two rendered light fields and four simulated scenes.
const CONTRAST: [f32; 2] = [0.01, 0.001];

/// Of clean views.
///
/// Source: the best of those tried on two rendered light fields.
const CLEAN: Smoothing = Smoothing {
    noise: 0.0,
    radius: 1,
    truncation: 0.55,
    contrast: 0.5,
    sure: 0.3,
    penalties: regularise::Penalties { small: 0.005, large: 0.06, edge: 0.015 },
};

/// Of noisy ones.
///
/// Source: the best of those tried on four simulated captures.
const NOISY: Smoothing = Smoothing {
    noise: 1.0,
    radius: 2,
    truncation: 1.0,
    contrast: 0.0,
    sure: 0.0,
    penalties: regularise::Penalties { small: 0.009, large: 0.12, edge: 0.015 },
};

impl Smoothing {
    /// Between those of clean and of noisy views, by what the costs of a first volume leave.
    fn of(volume: &sweep::Volume) -> Self {
        let count = volume.width * volume.height;
        let least = |k: usize| volume.planes.iter().map(|p| p[k]).fold(f32::INFINITY, f32::min);
        let mut left: Vec<f32> = (0..count).into_par_iter().map(least).collect();
        let noise = *left.select_nth_unstable_by(count / 4, f32::total_cmp).1;
        let share = ((noise - NOISE[0]) / (NOISE[1] - NOISE[0])).clamp(0.0, 1.0);
        let mix = |a: f32, b: f32| a + share * (b - a);
        let (a, b) = (CLEAN.penalties, NOISY.penalties);
        Smoothing {
            noise: share,
            radius: if share < 0.5 { CLEAN.radius } else { NOISY.radius },
            truncation: mix(CLEAN.truncation, NOISY.truncation),
            contrast: mix(CLEAN.contrast, NOISY.contrast),
            sure: mix(CLEAN.sure, NOISY.sure),
            penalties: regularise::Penalties {
                small: mix(a.small, b.small),
                large: mix(a.large, b.large),
                edge: mix(a.edge, b.edge),
            },
        }
    }
}

/// Chance that a disparity is within 0.07: logistic in how far the least cost stands out, and in the noise.
///
/// Source: fitted (least log loss) on eight light fields of four simulated scenes, the true views and those decoded from captures.
const CHANCE: [f32; 3] = [0.97, 6.17, -1.79];

/// How far a minimum must stand out for that chance to hold; below it falls to 0.
///
/// Source: chosen; nothing is known without texture, and the fit had few such pixels (0.3 % of rendered ones).
const NOTHING: f32 = 0.05;

/// The chance that the disparity of a pixel, whose least cost stands `out` (0..1) below the mean, is within 0.07 of the true one.
fn chance_within(out: f32, noise: f32) -> f32 {
    let chance = 1.0 / (1.0 + (-(CHANCE[0] + CHANCE[1] * out + CHANCE[2] * noise)).exp());
    chance * (out / NOTHING).min(1.0)
}

/// The disparity at every pixel of the view `at`, of hypotheses within `range`. A first map tells how noisy the views are,
/// and what is hidden where; unless they are very noisy, that is found once more from the map that follows.
pub(super) fn search(
    grid: &[Vec<Plane>],
    at: (usize, usize),
    range: (f32, f32),
    options: &Options,
    observer: &dyn Observer,
) -> Result<Found, Error> {
    let reference = &grid[at.0][at.1];
    let reach = outermost_step(grid, at, options);
    let list = hypotheses(range, options.step, reach);
    observer.begin("disparity", list.len() as u64 * 3);
    let FirstMap { hidden, order, smoothing } = first_map(grid, at, range, options, observer)?;
    let cut = Options { truncation: smoothing.truncation * options.truncation, ..options.clone() };
    let look = |hidden: &Hidden| {
        let volume = cost_volume(grid, at, list.clone(), smoothing.radius, Some(hidden), &cut, observer)?;
        let look = Look::of(volume, reference, &smoothing);
        observer.check()?;
        Ok::<_, Error>(look)
    };
    let mut seen = look(&hidden)?;
    // Of views as noisy as can be the map says less of what hides what than the first one, which is smoother.
    if smoothing.noise < NOISY.noise {
        let margin = MARGIN * seen.spacing();
        let surfaces = seen.sure_surfaces(order, smoothing.sure);
        drop(seen);
        seen = look(&Hidden::of(&surfaces, reference.width, reach, margin, order))?;
    } else {
        observer.advance(list.len() as u64);
    }
    let Look { volume, places, confidence } = seen;
    let mut found = Found { disparity: places.iter().map(|p| p.0).collect(), confidence };
    refine_by_tensor(grid, at, &mut found, &volume, options);
    found.disparity = regularise::weighted_median(&found.disparity, &found.confidence, reference, 2, 0.03);
    found.confidence.par_iter_mut().for_each(|c| *c = chance_within(*c, smoothing.noise));
    Ok(found)
}

/// Costs, and the disparity of least total cost of each pixel.
struct Look {
    volume: sweep::Volume,
    /// Disparity, and the index of its hypothesis.
    places: Vec<(f32, usize)>,
    /// How far the least cost stands out.
    confidence: Vec<f32>,
}

impl Look {
    fn of(volume: sweep::Volume, reference: &Plane, smoothing: &Smoothing) -> Self {
        let n = volume.hypotheses.len();
        let mean = |k: usize| volume.planes.iter().map(|p| p[k]).sum::<f32>() / n as f32;
        let means: Vec<f32> = (0..volume.width * volume.height).into_par_iter().map(mean).collect();
        let gain = |m: &f32| ((CONTRAST[0] + CONTRAST[1]) / (m + CONTRAST[1])).powf(smoothing.contrast);
        let gains: Vec<f32> = means.par_iter().map(gain).collect();
        let places = least_total(&volume, &gains, reference, &smoothing.penalties);
        let each = places.par_iter().zip(&means).enumerate();
        let confidence = each.map(|(k, (place, &mean))| confidence_of(mean, volume.planes[place.1][k])).collect();
        Look { volume, places, confidence }
    }

    /// Between hypotheses.
    fn spacing(&self) -> f32 {
        self.volume.hypotheses[1] - self.volume.hypotheses[0]
    }

    /// The disparity where it is at least as sure as that; elsewhere that of the furthest surface, which hides nothing.
    fn sure_surfaces(&self, order: DepthOrder, least: f32) -> Vec<f32> {
        let furthest = self.places.iter().map(|p| p.0).reduce(|a, b| order.behind(a, b)).unwrap_or(0.0);
        let each = self.places.iter().zip(&self.confidence);
        each.map(|(place, &confidence)| if confidence >= least { place.0 } else { furthest }).collect()
    }
}

/// What a map of half the size tells.
struct FirstMap {
    hidden: Hidden,
    order: DepthOrder,
    smoothing: Smoothing,
}

fn first_map(
    grid: &[Vec<Plane>],
    at: (usize, usize),
    range: (f32, f32),
    options: &Options,
    observer: &dyn Observer,
) -> Result<FirstMap, Error> {
    let (w, h) = (grid[at.0][at.1].width, grid[at.0][at.1].height);
    let reach = outermost_step(grid, at, options);
    let halved: Vec<Vec<Plane>>;
    let (small, factor) = if w.min(h) >= HALVED {
        halved = grid.par_iter().map(|r| r.iter().map(Plane::halved).collect()).collect();
        (halved.as_slice(), 2.0)
    } else {
        (grid, 1.0)
    };
    let reference = &small[at.0][at.1];
    let list = hypotheses((range.0 / factor, range.1 / factor), options.step, reach);
    let volume = cost_volume(small, at, list, NOISY.radius, None, options, observer)?;
    let smoothing = Smoothing::of(&volume);
    let first = Look::of(volume, reference, &smoothing);
    let places = first.places.iter().map(|p| p.0).collect();
    let map = Plane { width: reference.width, height: reference.height, data: places };
    let order = find_depth_order(&map, small, at, [1.0, 1.0], &|k| !options.uses(k));
    let place = |k: usize, n: usize| ((k as f32 / factor) as usize).min(n - 1);
    let enlarged: Vec<f32> =
        (0..w * h).map(|k| factor * map.row(place(k / w, map.height))[place(k % w, map.width)]).collect();
    let margin = MARGIN * factor * first.spacing();
    Ok(FirstMap { hidden: Hidden::of(&enlarged, w, reach, margin, order), order, smoothing })
}

/// The disparity of least total cost, pixel by pixel, and the index of its hypothesis; costs of a pixel times its gain.
fn least_total(
    volume: &sweep::Volume,
    gains: &[f32],
    reference: &Plane,
    penalties: &regularise::Penalties,
) -> Vec<(f32, usize)> {
    let n = volume.hypotheses.len();
    let total = regularise::semi_global(volume, gains, reference, penalties);
    let spacing = volume.hypotheses[1] - volume.hypotheses[0];
    total
        .par_chunks(n)
        .map(|costs| {
            let mut best = 0;
            for (i, v) in costs.iter().enumerate() {
                if *v < costs[best] {
                    best = i;
                }
            }
            (volume.hypotheses[best] + spacing * vertex(costs, best), best)
        })
        .collect()
}

/// Offset (−½..½) of the minimum of the parabola through the costs around `best`.
fn vertex(costs: &[f32], best: usize) -> f32 {
    if best == 0 || best + 1 >= costs.len() {
        return 0.0;
    }
    let (a, b, c) = (costs[best - 1], costs[best], costs[best + 1]);
    let curvature = a - 2.0 * b + c;
    if curvature > 0.0 { (0.5 * (a - c) / curvature).clamp(-0.5, 0.5) } else { 0.0 }
}

/// Sub-pixel: the slope of the EPI structure tensor, sheared near the disparity found, is taken where the lines are
/// coherent and it lowers the matching cost.
fn refine_by_tensor(
    grid: &[Vec<Plane>],
    at: (usize, usize),
    found: &mut Found,
    volume: &sweep::Volume,
    options: &Options,
) {
    let (lo, hi) = found.disparity.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &d| (a.min(d), b.max(d)));
    let gap = 0.4;
    let n = ((hi - lo) / gap).ceil().clamp(1.0, 64.0) as usize;
    let width = (hi - lo) / n as f32;
    let shears: Vec<f32> = (0..n).map(|k| lo + width * (k as f32 + 0.5)).collect();
    let tensors: Vec<_> =
        shears.par_iter().map(|&shear| tensor::slopes(grid, at, shear, 2, &|k| options.uses(k))).collect();
    let spacing = volume.hypotheses[1] - volume.hypotheses[0];
    let cost = |k: usize, d: f32| {
        let place = ((d - volume.hypotheses[0]) / spacing).clamp(0.0, (volume.planes.len() - 1) as f32);
        let i = (place as usize).min(volume.planes.len() - 2);
        let f = place - i as f32;
        volume.planes[i][k] * (1.0 - f) + volume.planes[i + 1][k] * f
    };
    found.disparity.par_iter_mut().enumerate().for_each(|(k, d)| {
        let index = if width > 0.0 { (((*d - lo) / width) as usize).min(n - 1) } else { 0 };
        let t = &tensors[index];
        let slope = t.disparity[k];
        if t.coherence[k] > 0.8 && (slope - *d).abs() < spacing && cost(k, slope) < 0.95 * cost(k, *d) {
            *d = slope;
        }
    });
}

/// Brings a search result to the full size, in units of full pixels. Bilinear, not edge-aware.
pub(super) fn enlarge(
    found: &Found,
    reference: &Plane,
    full: (usize, usize),
    scale: f32,
) -> (Array2<f32>, Array2<f32>) {
    let (w, h) = (reference.width, reference.height);
    let plane = |data: &[f32]| Plane { width: w, height: h, data: data.to_vec() };
    let (d, c) = (plane(&found.disparity), plane(&found.confidence));
    let place = |k: usize| (k as f32 + 0.5) / scale - 0.5;
    (
        Array2::from_shape_fn((full.1, full.0), |(t, s)| scale * d.bilinear_at(place(s), place(t))),
        Array2::from_shape_fn((full.1, full.0), |(t, s)| c.bilinear_at(place(s), place(t))),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 12 pixels at hypothesis 5 within one of 24 at hypothesis 2, its costs so much lower.
    fn square_within(contrast: f32) -> sweep::Volume {
        let (width, height) = (24, 24);
        let plane = |k: usize| {
            let cost = |p| {
                if is_within(p) { contrast * 0.02 * (k as f32 - 5.0).abs() } else { 0.02 * (k as f32 - 2.0).abs() }
            };
            (0..width * height).map(cost).collect()
        };
        let hypotheses = (0..8).map(|k| k as f32 * 0.1).collect();
        sweep::Volume { width, height, hypotheses, planes: (0..8).map(plane).collect() }
    }

    fn is_within(pixel: usize) -> bool {
        (6..18).contains(&(pixel % 24)) && (6..18).contains(&(pixel / 24))
    }

    #[test]
    fn ground_of_little_contrast_keeps_its_disparity_within_a_strong_surface() {
        let guide = Plane { width: 24, height: 24, data: vec![0.5; 24 * 24] };
        let kept = |contrast: f32, smoothing: &Smoothing| {
            let look = Look::of(square_within(contrast), &guide, smoothing);
            let places = look.places.iter().enumerate();
            places.filter(|(k, place)| is_within(*k) && (place.0 - 0.5).abs() < 0.05).count() as f32 / 144.0
        };
        assert!(kept(1.0, &CLEAN) > 0.9, "{}", kept(1.0, &CLEAN));
        let (with, without) = (kept(0.05, &CLEAN), kept(0.05, &Smoothing { contrast: 0.0, ..CLEAN }));
        assert!(with > 0.4 && without < 0.1, "{with} {without}");
    }

    #[test]
    fn surfaces_that_are_not_sure_are_the_furthest_one() {
        let look = Look {
            volume: square_within(1.0),
            places: vec![(0.3, 3), (-0.2, 0), (0.1, 1), (0.4, 4)],
            confidence: vec![0.2, 0.3, 0.9, 0.1],
        };
        assert_eq!(look.sure_surfaces(DepthOrder::NearerIsSmaller, 0.3), [0.4, -0.2, 0.1, 0.4]);
        assert_eq!(look.sure_surfaces(DepthOrder::NearerIsLarger, 0.3), [-0.2, -0.2, 0.1, -0.2]);
        assert_eq!(look.sure_surfaces(DepthOrder::NearerIsSmaller, 0.0), [0.3, -0.2, 0.1, 0.4]);
    }
}
