//! Edge-preserving regularisation of a cost volume: semi-global matching (Hirschmüller 2008) minimises
//! Σ C(x, d) + P1·[|Δd| = 1] + P2·[|Δd| > 1] along eight paths; a weighted median removes outliers.

use lenslet_core::image::Plane;
use rayon::prelude::*;

use super::sweep::Volume;

/// Penalties of semi-global matching, in the unit of the costs.
#[derive(Debug, Clone, Copy)]
pub struct Penalties {
    /// For a change by one hypothesis.
    pub small: f32,
    /// For any larger change, where the guide is flat.
    pub large: f32,
    /// Brightness step at which `large` has fallen to half.
    pub edge: f32,
}

/// Costs, those of a pixel times its gain, summed along eight paths, pixel after pixel: `[(t·w + s)·K + k]`.
pub fn semi_global(volume: &Volume, gains: &[f32], guide: &Plane, penalties: &Penalties) -> Vec<f32> {
    let (w, h, n) = (volume.width, volume.height, volume.hypotheses.len());
    let mut cost = vec![0f32; w * h * n];
    cost.par_chunks_mut(w * n).enumerate().for_each(|(t, row)| {
        for s in 0..w {
            for (k, plane) in volume.planes.iter().enumerate() {
                row[s * n + k] = gains[t * w + s] * plane[t * w + s];
            }
        }
    });
    let mut total = vec![0f32; w * h * n];
    // Along the rows, both ways.
    total.par_chunks_mut(w * n).zip(cost.par_chunks(w * n)).enumerate().for_each(|(t, (out, cost))| {
        let brightness = guide.row(t);
        let (mut before, mut now) = (vec![0f32; n], vec![0f32; n]);
        for backwards in [false, true] {
            before.fill(0.0);
            for k in 0..w {
                let s = if backwards { w - 1 - k } else { k };
                let last = if backwards { (s + 1).min(w - 1) } else { s.saturating_sub(1) };
                let jump = penalty(penalties, brightness[s] - brightness[last]);
                step(&cost[s * n..(s + 1) * n], &before, penalties.small, jump, &mut now);
                for (o, v) in out[s * n..(s + 1) * n].iter_mut().zip(&now) {
                    *o += v;
                }
                std::mem::swap(&mut before, &mut now);
            }
        }
    });
    // From row to row: straight, and along both diagonals; down, then up.
    for upwards in [false, true] {
        let mut before = vec![0f32; 3 * w * n];
        let mut now = vec![0f32; 3 * w * n];
        for k in 0..h {
            let t = if upwards { h - 1 - k } else { k };
            let last = if upwards { (t + 1).min(h - 1) } else { t.saturating_sub(1) };
            let (own, other) = (guide.row(t), guide.row(last));
            let cost = &cost[t * w * n..(t + 1) * w * n];
            let out = &mut total[t * w * n..(t + 1) * w * n];
            let chunk = 64;
            out.par_chunks_mut(chunk * n).zip(now.par_chunks_mut(3 * chunk * n)).enumerate().for_each(
                |(c, (out, now))| {
                    for (i, (out, now)) in out.chunks_mut(n).zip(now.chunks_mut(3 * n)).enumerate() {
                        let s = c * chunk + i;
                        for (direction, now) in now.chunks_mut(n).enumerate() {
                            let from = (s as isize + direction as isize - 1).clamp(0, w as isize - 1) as usize;
                            let start = (3 * from + direction) * n;
                            let jump = penalty(penalties, own[s] - other[from]);
                            step(&cost[s * n..(s + 1) * n], &before[start..start + n], penalties.small, jump, now);
                            for (o, v) in out.iter_mut().zip(now.iter()) {
                                *o += v;
                            }
                        }
                    }
                },
            );
            std::mem::swap(&mut before, &mut now);
        }
    }
    total
}

fn penalty(p: &Penalties, difference: f32) -> f32 {
    (p.large / (1.0 + difference.abs() / p.edge)).max(p.small)
}

/// One step of one path: cost plus the least cost of coming from the pixel before, minus the minimum there.
fn step(cost: &[f32], before: &[f32], small: f32, large: f32, now: &mut [f32]) {
    let least = before.iter().copied().fold(f32::INFINITY, f32::min);
    let jump = least + large;
    let n = cost.len();
    let one = |k: usize, up: f32, down: f32| cost[k] + before[k].min(jump).min(up.min(down) + small) - least;
    now[0] = one(0, if n > 1 { before[1] } else { f32::INFINITY }, f32::INFINITY);
    if n > 1 {
        now[n - 1] = one(n - 1, before[n - 2], f32::INFINITY);
    }
    for (((o, c), b), _) in now[1..].iter_mut().zip(&cost[1..]).zip(before.windows(3)).zip(2..n) {
        *o = c + b[1].min(jump).min(b[0].min(b[2]) + small) - least;
    }
}

/// Median of `values` around each pixel, weighted by nearness of the guide's brightness; edges follow those of the
/// guide.
pub fn weighted_median(values: &[f32], weights: &[f32], guide: &Plane, radius: usize, sigma: f32) -> Vec<f32> {
    let (w, h) = (guide.width, guide.height);
    let mut out = vec![0f32; w * h];
    let scale = -1.0 / (2.0 * sigma * sigma);
    out.par_chunks_mut(w).enumerate().for_each_init(Vec::new, |window: &mut Vec<(f32, f32)>, (t, row)| {
        for (s, o) in row.iter_mut().enumerate() {
            window.clear();
            let own = guide.data[t * w + s];
            for y in t.saturating_sub(radius)..=(t + radius).min(h - 1) {
                for x in s.saturating_sub(radius)..=(s + radius).min(w - 1) {
                    let k = y * w + x;
                    let d = guide.data[k] - own;
                    window.push((values[k], (d * d * scale).exp() * (weights[k] + 1e-3)));
                }
            }
            window.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
            let half = 0.5 * window.iter().map(|p| p.1).sum::<f32>();
            let mut sum = 0.0;
            *o = values[t * w + s];
            for &(value, weight) in window.iter() {
                sum += weight;
                if sum >= half {
                    *o = value;
                    break;
                }
            }
        }
    });
    out
}
