//! Matching costs of all hypotheses at every pixel, gathered along edges.

use lenslet_core::geometry::Size;
use lenslet_core::image::{BoxMeans, GuidedFilter, Plane};
use lenslet_core::progress::Observer;
use rayon::prelude::*;

use super::error::Error;
use super::hidden::Hidden;
use super::options::Options;
use super::sweep;

fn placed<'a>(grid: &'a [Vec<Plane>], at: (usize, usize), options: &Options) -> Vec<sweep::Placed<'a>> {
    let mut out = Vec::new();
    for (v, row) in grid.iter().enumerate() {
        for (u, plane) in row.iter().enumerate() {
            if (v, u) != at && options.uses(v * row.len() + u) {
                out.push((plane, u as f32 - at.1 as f32, v as f32 - at.0 as f32));
            }
        }
    }
    out
}

/// The hypotheses of a range: `step` pixels apart at the outermost view, at least 5, at most 128.
pub(super) fn hypotheses(range: (f32, f32), step: f32, reach: f32) -> Vec<f32> {
    let n = (((range.1 - range.0) * reach.max(1.0) / step).ceil() as usize).clamp(4, 127);
    (0..=n).map(|k| range.0 + (range.1 - range.0) * k as f32 / n as f32).collect()
}

/// View steps from the reference view to the furthest one in use.
pub(super) fn outermost_step(grid: &[Vec<Plane>], at: (usize, usize), options: &Options) -> f32 {
    let (rows, columns) = (grid.len(), grid[0].len());
    let step = |k: usize| (k / columns).abs_diff(at.0).max((k % columns).abs_diff(at.1));
    (0..rows * columns).filter(|&k| options.uses(k)).map(step).max().unwrap_or(0) as f32
}

/// Costs of all hypotheses, gathered along edges. `hidden`: as [`sweep::Sweep`] has it.
pub(super) fn cost_volume(
    grid: &[Vec<Plane>],
    at: (usize, usize),
    hypotheses: Vec<f32>,
    radius: usize,
    hidden: Option<&Hidden>,
    options: &Options,
    observer: &dyn Observer,
) -> Result<sweep::Volume, Error> {
    let reference = &grid[at.0][at.1];
    let views = placed(grid, at, options);
    let robust = sweep::Robust { truncation: options.truncation, half_penalty: 0.5 };
    let guide = GuidedFilter::new(
        &reference.data,
        Size::new(reference.width, reference.height),
        radius,
        1e-4,
        BoxMeans::OneThread,
    );
    let sweep = sweep::Sweep { reference, views: &views, robust, hidden };
    let planes = hypotheses
        .par_chunks(sweep::HYPOTHESES)
        .map(|some| {
            observer.check()?;
            let mut costs = sweep.costs(some);
            costs.iter_mut().for_each(|costs| guide.filter(costs));
            observer.advance(some.len() as u64);
            Ok(costs)
        })
        .collect::<Result<Vec<_>, Error>>()?;
    let planes = planes.into_iter().flatten().collect();
    Ok(sweep::Volume { width: reference.width, height: reference.height, hypotheses, planes })
}

/// Index of the least cost at a pixel, and how far it stands below the mean over the hypotheses (0..1).
pub(super) fn least_cost(volume: &sweep::Volume, k: usize) -> (usize, f32) {
    let (mut best, mut least, mut sum) = (0, f32::INFINITY, 0.0);
    for (d, plane) in volume.planes.iter().enumerate() {
        let c = plane[k];
        sum += c;
        if c < least {
            (best, least) = (d, c);
        }
    }
    let mean = sum / volume.planes.len() as f32;
    (best, confidence_of(mean, least))
}

/// Confidence of a minimum `least` under a mean cost `mean`; the constant is the brightness noise of a good camera.
pub(super) fn confidence_of(mean: f32, least: f32) -> f32 {
    ((mean - least) / (mean + 0.004)).clamp(0.0, 1.0)
}
