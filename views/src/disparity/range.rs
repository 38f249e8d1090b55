//! The range of disparities of a light field.

use lenslet_core::image::Plane;
use lenslet_core::progress::Observer;

use super::error::Error;
use super::options::Options;
use super::volume::{cost_volume, hypotheses, least_cost, outermost_step};

/// The range that holds nearly all confident disparities of a small version of the light field.
pub(super) fn find_range(
    grid: &[Vec<Plane>],
    at: (usize, usize),
    options: &Options,
    factor: f32,
    observer: &dyn Observer,
) -> Result<(f32, f32), Error> {
    let limit = options.limit / factor;
    let list = hypotheses((-limit, limit), options.step, outermost_step(grid, at));
    let spacing = list[1] - list[0];
    observer.begin("disparity range", list.len() as u64);
    let volume = cost_volume(grid, at, list, 2, options, observer)?;
    let count = volume.width * volume.height;
    let mut votes: Vec<(f32, f32)> = (0..count)
        .map(|k| {
            let (best, confidence) = least_cost(&volume, k);
            (volume.hypotheses[best], confidence)
        })
        .collect();
    votes.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let total: f32 = votes.iter().map(|v| v.1).sum();
    let quantile = |q: f32| {
        let mut sum = 0.0;
        for v in &votes {
            sum += v.1;
            if sum >= q * total {
                return v.0;
            }
        }
        limit
    };
    let (lo, hi) = (quantile(0.003), quantile(0.997));
    let margin = (2.0 * spacing).max(0.1 * (hi - lo));
    Ok(((lo - margin).max(-limit), (hi + margin).min(limit)))
}
