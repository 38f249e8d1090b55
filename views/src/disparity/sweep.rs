//! Plane sweep: for each hypothesis d, cost(x) = robust mean over views of |L(x + d·(u,v); v,u) − L(x; reference)|,
//! over all views or, where something in front blocks some of them, over the half of the views in which the point is
//! visible.

use lenslet_core::image::Plane;

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

/// The cost plane of one hypothesis `d`.
pub fn cost(reference: &Plane, views: &[Placed], d: f32, robust: &Robust) -> Vec<f32> {
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
            let sides = [Some(0), side(u, 1), side(v, 3)];
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
            let mut best = if seen[0] > 0.0 { sums[0][s] / seen[0] } else { robust.truncation };
            for k in 1..5 {
                if seen[k] > 0.0 {
                    best = best.min(factor * sums[k][s] / seen[k]);
                }
            }
            *o = best;
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
