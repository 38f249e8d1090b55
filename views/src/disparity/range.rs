//! The range of disparities of a light field.

use lenslet_core::image::Plane;
use lenslet_core::progress::Observer;

use super::error::Error;
use super::options::Options;
use super::sweep::Volume;
use super::volume::{cost_volume, hypotheses, least_cost, outermost_step};

/// Matching cost, of the best one within the usual limit, at which a disparity beyond it is taken for the better one.
///
/// Source: chosen.
const BETTER: f32 = 0.5;

/// Least cost within the usual limit where something beyond it is looked for: below it the views agree but for noise.
///
/// Source: chosen, of the range 0..1.
const DISAGREE: f32 = 0.012;

/// Share of the pixels that must be better matched beyond the usual limit for it to be left.
///
/// Source: chosen.
const ENOUGH: f32 = 0.03;

/// The range that holds nearly all confident disparities of a small version of the light field. Where the views agree
/// better beyond the usual limit, the search goes on there.
pub(super) fn find_range(
    grid: &[Vec<Plane>],
    at: (usize, usize),
    options: &Options,
    factor: f32,
    observer: &dyn Observer,
) -> Result<(f32, f32), Error> {
    let limit = options.limit / factor;
    let reach = outermost_step(grid, at, options);
    let list = hypotheses((-limit, limit), options.step, reach);
    let spacing = list[1] - list[0];
    observer.begin("disparity range", list.len() as u64);
    let usual = cost_volume(grid, at, list, 2, None, options, observer)?;
    // Further than half a view nothing is seen twice.
    let (width, height) = (usual.width as f32, usual.height as f32);
    let widest = (options.widest / factor).min(0.5 * width.max(height) / reach.max(1.0));
    let mut votes = votes_of(&usual, |_, d| d.abs() <= limit);
    let mut bounds = (-limit, limit);
    if widest > 1.05 * limit {
        let wide =
            cost_volume(grid, at, hypotheses((-widest, widest), options.step, reach), 2, None, options, observer)?;
        let own: Vec<f32> =
            (0..votes.len()).map(|k| usual.planes.iter().map(|p| p[k]).fold(f32::INFINITY, f32::min)).collect();
        let mut better = 0usize;
        let mut beyond = votes_of(&wide, |k, d| {
            // At the borders few views remain, and cost little by chance.
            let (x, y) = ((k % wide.width) as f32, (k / wide.width) as f32);
            let seen = |x: f32, size: f32| x - d.abs() * reach >= 0.0 || x + d.abs() * reach <= size - 1.0;
            seen(x, width) && seen(y, height)
        });
        for (k, (vote, own_vote)) in beyond.iter_mut().zip(&votes).enumerate() {
            let cost = wide.planes.iter().map(|p| p[k]).fold(f32::INFINITY, f32::min);
            if vote.0.abs() > limit && own[k] > DISAGREE && cost < BETTER * own[k] && vote.1 > 0.0 {
                better += 1;
            } else {
                *vote = *own_vote;
            }
        }
        if better as f32 > ENOUGH * votes.len() as f32 {
            votes = beyond;
            bounds = (-widest, widest);
        }
    }
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
        bounds.1
    };
    let (lo, hi) = (quantile(0.003), quantile(0.997));
    let margin = (2.0 * spacing).max(0.1 * (hi - lo));
    Ok(((lo - margin).max(bounds.0), (hi + margin).min(bounds.1)))
}

/// The best hypothesis of every pixel, with its confidence; 0 where `counts` (pixel, hypothesis) is false.
fn votes_of(volume: &Volume, counts: impl Fn(usize, f32) -> bool) -> Vec<(f32, f32)> {
    (0..volume.width * volume.height)
        .map(|k| {
            let (best, confidence) = least_cost(volume, k);
            let d = volume.hypotheses[best];
            (d, if counts(k, d) { confidence } else { 0.0 })
        })
        .collect()
}
