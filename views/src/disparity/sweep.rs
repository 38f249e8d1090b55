//! Plane sweep: for each hypothesis d, cost(x) = robust mean over views of |L(x + d·(u,v); v,u) − L(x; reference)|,
//! over all views or, where something in front blocks some of them, over the half of the views in which the point is
//! visible.

use lenslet_core::image::Plane;

use super::hidden::Hidden;
use super::planes::shifted_row;

/// Cost of every hypothesis at every pixel: `planes[k][t·w + s]`.
pub struct Volume {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Hypotheses, ascending, evenly spaced.
    pub hypotheses: Vec<f32>,
    /// One plane of costs a hypothesis.
    pub planes: Vec<Vec<f32>>,
}

/// The robust measure of brightness differences.
#[derive(Debug, Clone, Copy)]
pub struct Robust {
    /// Differences are cut off at this value.
    pub truncation: f32,
    /// Relative margin by which the cost over one half of the views must be below that over all to replace it.
    pub half_penalty: f32,
}

/// A view and its offset from the reference view: (plane, u, v), view steps.
pub type Placed<'a> = (&'a Plane, f32, f32);

/// The cost plane of one hypothesis `d`. Where it is known what is `hidden`, half of the views are taken instead of all where
/// something hides the point in the other half; else wherever that makes the cost clearly lower.
pub fn cost(reference: &Plane, views: &[Placed], d: f32, robust: &Robust, hidden: Option<&Hidden>) -> Vec<f32> {
    let (w, h) = (reference.width, reference.height);
    let mut out = vec![0f32; w * h];
    // Sums over: all views, left, right, above, below.
    let mut sums = vec![vec![0f32; w]; 5];
    // Views counted where their run of valid pixels begins and ends; summed up along the row.
    let mut counts = vec![vec![0f32; w + 1]; 5];
    let (mut scratch, mut row) = (Vec::new(), vec![0f32; w]);
    for t in 0..h {
        for (s, c) in sums.iter_mut().zip(counts.iter_mut()) {
            s.fill(0.0);
            c.fill(0.0);
        }
        // Sums over a half are needed where something hides points.
        let needed =
            hidden.is_none_or(|hidden| (t * w..(t + 1) * w).any(|k| (0..4).any(|side| hidden.hides(side, k, d))));
        let half = |offset: f32, first: usize| side(offset, first).filter(|_| needed);
        let own = reference.row(t);
        for &(plane, u, v) in views {
            let (dx, dy) = (d * u, d * v);
            let y = t as f32 + dy;
            if y < 0.0 || y > (h - 1) as f32 {
                continue;
            }
            let from = (-dx).ceil().clamp(0.0, w as f32) as usize;
            let to = ((w - 1) as f32 - dx).floor().clamp(-1.0, (w - 1) as f32) + 1.0;
            let to = to as usize;
            if from >= to {
                continue;
            }
            shifted_row(plane, t, dx, dy, &mut scratch, &mut row);
            for (r, &o) in row[from..to].iter_mut().zip(&own[from..to]) {
                *r = (*r - o).abs().min(robust.truncation);
            }
            let sides = [Some(0), half(u, 1), half(v, 3)];
            for k in sides.into_iter().flatten() {
                for (a, &r) in sums[k][from..to].iter_mut().zip(&row[from..to]) {
                    *a += r;
                }
                counts[k][from] += 1.0;
                counts[k][to] -= 1.0;
            }
        }
        let target = &mut out[t * w..(t + 1) * w];
        let factor = 1.0 + robust.half_penalty;
        let mut seen = [0f32; 5];
        for (s, o) in target.iter_mut().enumerate() {
            for (n, c) in seen.iter_mut().zip(&counts) {
                *n += c[s];
            }
            let mean = |k: usize| if seen[k] > 0.0 { sums[k][s] / seen[k] } else { f32::INFINITY };
            let all = if seen[0] > 0.0 { mean(0) } else { robust.truncation };
            let clearly = || (1..5).fold(all, |best, k| best.min(factor * mean(k)));
            *o = match hidden {
                None => clearly(),
                Some(_) if !needed => all,
                Some(hidden) => {
                    let covered = [0, 1, 2, 3].map(|side| hidden.hides(side, t * w + s, d));
                    let free = (0..4).filter(|&side| covered[side ^ 1] && !covered[side]);
                    let least = free.fold(f32::INFINITY, |best, side| best.min(mean(side + 1)));
                    if least.is_finite() {
                        least
                    } else if covered.contains(&true) {
                        clearly()
                    } else {
                        all
                    }
                }
            };
        }
    }
    out
}

fn side(offset: f32, first: usize) -> Option<usize> {
    match offset {
        o if o < 0.0 => Some(first),
        o if o > 0.0 => Some(first + 1),
        _ => None,
    }
}
