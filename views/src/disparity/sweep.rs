//! Plane sweep: for each hypothesis d, cost(x) = robust mean over views of |L(x + d·(u,v); v,u) − L(x; reference)|,
//! over all views or, where something in front blocks some of them, over the half of the views in which the point is
//! visible.

use lenslet_core::image::Plane;

use super::hidden::Hidden;
use super::planes::{neighbours_of_shifted_row, weighted_sum};

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

/// Rows of the reference that are swept together: what they need of a view is then read from memory once.
///
/// Source: chosen for speed.
const ROWS: usize = 8;

/// Hypotheses that are swept together.
///
/// Source: chosen for speed.
pub(super) const HYPOTHESES: usize = 4;

/// What is compared, and how.
pub struct Sweep<'a> {
    pub reference: &'a Plane,
    pub views: &'a [Placed<'a>],
    pub robust: Robust,
    /// Where it is known what is hidden, half of the views are taken instead of all where something hides the point in
    /// the other half; else wherever that makes the cost clearly lower.
    pub hidden: Option<&'a Hidden>,
}

impl Sweep<'_> {
    /// The cost of every hypothesis (disparity, pixels a view step) at every pixel, row by row.
    pub fn costs(&self, hypotheses: &[f32]) -> Vec<Vec<f32>> {
        pulp::Arch::new().dispatch(Costs { sweep: self, hypotheses })
    }
}

struct Costs<'a> {
    sweep: &'a Sweep<'a>,
    hypotheses: &'a [f32],
}

impl pulp::WithSimd for Costs<'_> {
    type Output = Vec<Vec<f32>>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Vec<Vec<f32>> {
        let Costs { sweep, hypotheses } = self;
        let (w, h) = (sweep.reference.width, sweep.reference.height);
        let mut planes = vec![vec![0f32; w * h]; hypotheses.len()];
        let mut sums = vec![vec![RowSums::new(w); ROWS]; hypotheses.len()];
        let mut scratch = Vec::new();
        for top in (0..h).step_by(ROWS) {
            for (&d, sums) in hypotheses.iter().zip(&mut sums) {
                for (t, sums) in (top..h).zip(sums) {
                    sums.clear(sweep.needs_halves(t, d));
                }
            }
            for &view in sweep.views {
                for (&d, sums) in hypotheses.iter().zip(&mut sums) {
                    for (t, sums) in (top..h).zip(sums) {
                        sweep.add_view(view, t, d, &mut scratch, sums);
                    }
                }
            }
            for ((&d, sums), plane) in hypotheses.iter().zip(&sums).zip(&mut planes) {
                for (t, sums) in (top..h).zip(sums) {
                    sweep.choose(t, d, sums, &mut plane[t * w..(t + 1) * w]);
                }
            }
        }
        planes
    }
}

/// Sums of a row over all views, left, right, above, below.
#[derive(Clone)]
struct RowSums {
    halves: bool,
    sums: [Vec<f32>; 5],
    /// Views counted where their run of valid pixels begins and ends; to be summed up along the row.
    counts: [Vec<f32>; 5],
}

impl RowSums {
    fn new(width: usize) -> Self {
        let row = |n| [(); 5].map(|()| vec![0f32; n]);
        Self { halves: false, sums: row(width), counts: row(width + 1) }
    }

    fn clear(&mut self, halves: bool) {
        self.halves = halves;
        for row in self.sums.iter_mut().chain(&mut self.counts) {
            row.fill(0.0);
        }
    }
}

impl Sweep<'_> {
    /// Sums over a half are needed where something hides points.
    fn needs_halves(&self, t: usize, d: f32) -> bool {
        let mut row = t * self.reference.width..(t + 1) * self.reference.width;
        self.hidden.is_none_or(|hidden| row.any(|k| (0..4).any(|side| hidden.hides(side, k, d))))
    }

    #[inline(always)]
    fn add_view(&self, (plane, u, v): Placed, t: usize, d: f32, scratch: &mut Vec<f32>, into: &mut RowSums) {
        let (w, h) = (self.reference.width, self.reference.height);
        let (dx, dy) = (d * u, d * v);
        let y = t as f32 + dy;
        if y < 0.0 || y > (h - 1) as f32 {
            return;
        }
        let from = (-dx).ceil().clamp(0.0, w as f32) as usize;
        let to = (((w - 1) as f32 - dx).floor().clamp(-1.0, (w - 1) as f32) + 1.0) as usize;
        if from >= to {
            return;
        }
        let (weights, neighbours) = neighbours_of_shifted_row(plane, t, dx, dy, scratch);
        let truncation = self.robust.truncation;
        let own = &self.reference.row(t)[from..to];
        let differences = neighbours[from..].windows(4).zip(own).map(|(q, own)| {
            let difference = (weighted_sum(&weights, q) - own).abs();
            if difference < truncation { difference } else { truncation }
        });
        let halves = [side(u, 1), side(v, 3)].map(|side| side.filter(|_| into.halves));
        for k in [Some(0), halves[0], halves[1]].into_iter().flatten() {
            into.counts[k][from] += 1.0;
            into.counts[k][to] -= 1.0;
        }
        let [all, left, right, above, below] = into.sums.each_mut().map(|sums| &mut sums[from..to]);
        let across = if u < 0.0 { left } else { right };
        let along = if v < 0.0 { above } else { below };
        match halves {
            [None, None] => differences.zip(all).for_each(|(r, a)| *a += r),
            [Some(_), None] => differences.zip(all).zip(across).for_each(|((r, a), b)| {
                *a += r;
                *b += r;
            }),
            [None, Some(_)] => differences.zip(all).zip(along).for_each(|((r, a), b)| {
                *a += r;
                *b += r;
            }),
            [Some(_), Some(_)] => differences.zip(all).zip(across).zip(along).for_each(|(((r, a), b), c)| {
                *a += r;
                *b += r;
                *c += r;
            }),
        }
    }

    #[inline(always)]
    fn choose(&self, t: usize, d: f32, RowSums { halves, sums, counts }: &RowSums, costs: &mut [f32]) {
        let factor = 1.0 + self.robust.half_penalty;
        let first = t * self.reference.width;
        let mut seen = [0f32; 5];
        for (s, cost) in costs.iter_mut().enumerate() {
            for (n, c) in seen.iter_mut().zip(counts) {
                *n += c[s];
            }
            let mean = |k: usize| if seen[k] > 0.0 { sums[k][s] / seen[k] } else { f32::INFINITY };
            let all = if seen[0] > 0.0 { mean(0) } else { self.robust.truncation };
            let clearly = || (1..5).fold(all, |best, k| best.min(factor * mean(k)));
            *cost = match self.hidden {
                None => clearly(),
                Some(_) if !halves => all,
                Some(hidden) => {
                    let covered = [0, 1, 2, 3].map(|side| hidden.hides(side, first + s, d));
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
}

fn side(offset: f32, first: usize) -> Option<usize> {
    match offset {
        o if o < 0.0 => Some(first),
        o if o > 0.0 => Some(first + 1),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::depth_order::DepthOrder;
    use super::super::planes::shifted_row;
    use super::*;

    /// The cost at one pixel, straight from its definition.
    fn plainly(sweep: &Sweep, d: f32, s: usize, t: usize) -> f32 {
        let (w, h) = (sweep.reference.width, sweep.reference.height);
        let mean = |takes: &dyn Fn(f32, f32) -> bool| {
            let (mut sum, mut count) = (0f32, 0f32);
            for &(plane, u, v) in sweep.views.iter().filter(|view| takes(view.1, view.2)) {
                let (x, y) = (s as f32 + d * u, t as f32 + d * v);
                if x >= 0.0 && y >= 0.0 && x <= (w - 1) as f32 && y <= (h - 1) as f32 {
                    let mut row = vec![0.0; w];
                    shifted_row(plane, t, d * u, d * v, &mut Vec::new(), &mut row);
                    sum += (row[s] - sweep.reference.row(t)[s]).abs().min(sweep.robust.truncation);
                    count += 1.0;
                }
            }
            (count > 0.0).then(|| sum / count)
        };
        let halves: [&dyn Fn(f32, f32) -> bool; 4] =
            [&|u, _| u < 0.0, &|u, _| u > 0.0, &|_, v| v < 0.0, &|_, v| v > 0.0];
        let halves = halves.map(|half| mean(half).unwrap_or(f32::INFINITY));
        let all = mean(&|_, _| true).unwrap_or(sweep.robust.truncation);
        let clearly = halves.iter().fold(all, |best, half| best.min((1.0 + sweep.robust.half_penalty) * half));
        let Some(hidden) = sweep.hidden else { return clearly };
        let covered = [0, 1, 2, 3].map(|side| hidden.hides(side, t * w + s, d));
        let opposite = [1, 0, 3, 2];
        let free = (0..4).filter(|&side| covered[opposite[side]] && !covered[side]);
        let least = free.fold(f32::INFINITY, |best, side| best.min(halves[side]));
        match (least.is_finite(), covered.contains(&true)) {
            (true, _) => least,
            (false, true) => clearly,
            (false, false) => all,
        }
    }

    #[test]
    fn costs_in_blocks_are_those_of_the_definition() {
        let (w, h) = (37, 21);
        let plane = |k: usize| Plane {
            width: w,
            height: h,
            data: (0..w * h).map(|p| ((p * (31 + 2 * k) + p / w * 17) % 29) as f32 / 29.0).collect(),
        };
        let planes: Vec<Plane> = (0..10).map(plane).collect();
        let step = |k: usize| [(k % 3) as f32 - 1.0, (k / 3) as f32 - 1.0];
        let views: Vec<Placed> = (0..9).map(|k| (&planes[k + 1], step(k)[0], step(k)[1])).collect();
        let first: Vec<f32> = (0..w * h).map(|p| if (12..20).contains(&(p % w)) { -1.5 } else { 0.7 }).collect();
        let hidden = Hidden::of(&first, w, 1.0, 0.1, DepthOrder::NearerIsSmaller);
        let robust = Robust { truncation: 0.3, half_penalty: 0.2 };
        // Beyond the picture, too; more than are swept together.
        let hypotheses = [-40.0, -1.5, -0.25, 0.0, 0.7, 1.3];
        for hidden in [None, Some(&hidden)] {
            let sweep = Sweep { reference: &planes[0], views: &views, robust, hidden };
            let costs = sweep.costs(&hypotheses);
            assert!(hidden.is_none_or(|hidden| (0..w * h).any(|k| hidden.hides(0, k, 0.7))));
            for (d, costs) in hypotheses.iter().zip(&costs) {
                for (k, cost) in costs.iter().enumerate() {
                    let expected = plainly(&sweep, *d, k % w, k / w);
                    assert!((cost - expected).abs() < 1e-5, "{d}, pixel {k}: {cost} {expected}");
                }
            }
        }
    }
}
