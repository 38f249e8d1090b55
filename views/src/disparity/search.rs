//! Search at one size: costs regularised, the minimum made sub-pixel, outliers removed.

use lenslet_core::image::Plane;
use lenslet_core::progress::Observer;
use ndarray::Array2;
use rayon::prelude::*;

use super::error::Error;
use super::options::Options;
use super::volume::{confidence_of, cost_volume, hypotheses, outermost_step};
use super::{regularise, sweep, tensor};

/// What a search at one size gives, pixel by pixel.
pub(super) struct Found {
    pub(super) disparity: Vec<f32>,
    pub(super) confidence: Vec<f32>,
}

/// The disparity at every pixel of the view `at`, of hypotheses within `range`.
pub(super) fn search(
    grid: &[Vec<Plane>],
    at: (usize, usize),
    range: (f32, f32),
    options: &Options,
    observer: &dyn Observer,
) -> Result<Found, Error> {
    let reference = &grid[at.0][at.1];
    let (w, h) = (reference.width, reference.height);
    let list = hypotheses(range, options.step, outermost_step(grid, at, options));
    let spacing = list[1] - list[0];
    observer.begin("disparity", list.len() as u64);
    let volume = cost_volume(grid, at, list, 2, options, observer)?;
    let n = volume.hypotheses.len();
    let penalties = regularise::Penalties { small: 0.009, large: 0.06, edge: 0.03 };
    let total = regularise::semi_global(&volume, reference, &penalties);
    observer.check()?;
    let mut found = Found { disparity: vec![0.0; w * h], confidence: vec![0.0; w * h] };
    found.disparity.par_iter_mut().zip(found.confidence.par_iter_mut()).enumerate().for_each(|(k, (d, c))| {
        let costs = &total[k * n..(k + 1) * n];
        let mut best = 0;
        for (i, v) in costs.iter().enumerate() {
            if *v < costs[best] {
                best = i;
            }
        }
        *d = volume.hypotheses[best] + spacing * vertex(costs, best);
        let mean = volume.planes.iter().map(|p| p[k]).sum::<f32>() / n as f32;
        *c = confidence_of(mean, volume.planes[best][k]);
    });
    drop(total);
    refine_by_tensor(grid, at, &mut found, &volume, options);
    found.disparity = regularise::weighted_median(&found.disparity, &found.confidence, reference, 2, 0.03);
    Ok(found)
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
