//! A short piece of an edge or a line: nearly straight, with profiles across it.

use lenslet_core::image::Plane;

use super::fits::{Parabola, fit_polynomial, value_at};
use super::picture::read_between;

/// Least length of a segment, pixels of length for a pixel of its chain: a staircase at 45° has 0.71.
///
/// Source: chosen.
const LEAST_SPAN: f64 = 0.65;

/// A piece of a curve: points `centre + t·along + k(t)·across`, |t| up to half of `span`, k a parabola.
#[derive(Debug, Clone, Copy)]
pub(super) struct Segment {
    pub(super) centre: [f64; 2],
    pub(super) along: [f64; 2],
    pub(super) across: [f64; 2],
    pub(super) curve: Parabola,
    pub(super) span: f64,
}

impl Segment {
    /// The segment through `points`, a parabola of `degree` 2 or a straight line of 1; `None` where one is more than
    /// `tolerance` pixels off it, or where they turn back.
    pub(super) fn through(points: &[[f64; 2]], degree: usize, tolerance: f64) -> Option<Segment> {
        let n = points.len() as f64;
        let centre = [0, 1].map(|a| points.iter().map(|p| p[a]).sum::<f64>() / n);
        let about = |p: &[f64; 2]| [p[0] - centre[0], p[1] - centre[1]];
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for [x, y] in points.iter().map(about) {
            (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
        }
        let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
        let (along, across) = ([angle.cos(), angle.sin()], [-angle.sin(), angle.cos()]);
        let local: Vec<(f64, f64)> = points
            .iter()
            .map(about)
            .map(|[x, y]| (x * along[0] + y * along[1], x * across[0] + y * across[1]))
            .collect();
        let (low, high) = local.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p.0), h.max(p.0)));
        let curve = fit_polynomial(local.iter().copied(), degree)?;
        let fits = local.iter().all(|&(t, r)| (r - value_at(&curve, t)).abs() <= tolerance);
        (high - low >= LEAST_SPAN * n && fits).then_some(Segment { centre, along, across, curve, span: high - low })
    }

    /// Positions along the segment, a pixel apart.
    pub(super) fn positions(&self) -> Vec<f64> {
        let half = self.span / 2.0;
        (0..=self.span as usize).map(|k| k as f64 - half).collect()
    }

    /// Where position `t` and `offset` across lie.
    pub(super) fn place(&self, t: f64, offset: f64) -> [f64; 2] {
        let off = value_at(&self.curve, t) + offset;
        [0, 1].map(|a| self.centre[a] + t * self.along[a] + off * self.across[a])
    }

    /// What `plane` shows at each position (rows) and offset (columns).
    pub(super) fn profiles(&self, plane: &Plane, positions: &[f64], offsets: &[f64]) -> Vec<Vec<f64>> {
        let read = |t: f64, o: f64| {
            let [x, y] = self.place(t, o);
            f64::from(read_between(plane, x, y))
        };
        positions.iter().map(|&t| offsets.iter().map(|&o| read(t, o)).collect()).collect()
    }
}

/// Offsets from −`half` to `half`, `step` apart.
pub(super) fn offsets(half: f64, step: f64) -> Vec<f64> {
    let n = (half / step).round() as i32;
    (-n..=n).map(|k| f64::from(k) * step).collect()
}

/// Mean of the values at each quarter of a pixel from −`half` to `half` across: `value(row, column)` lies at
/// `offset(row, column)`. `None` where there is no value.
pub(super) fn quarter_pixel_profile(
    rows: &[Vec<f64>],
    offset: impl Fn(usize, usize) -> f64,
    half: i32,
) -> Vec<Option<f64>> {
    let mut sums = vec![(0.0, 0usize); (2 * half + 1) as usize];
    for (r, row) in rows.iter().enumerate() {
        for (c, value) in row.iter().enumerate() {
            let k = (4.0 * offset(r, c)).round() as i32 + half;
            if let Some(sum) = usize::try_from(k).ok().and_then(|k| sums.get_mut(k)) {
                *sum = (sum.0 + value, sum.1 + 1);
            }
        }
    }
    sums.into_iter().map(|(sum, n)| (n > 0).then(|| sum / n as f64)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_is_followed() {
        let points: Vec<[f64; 2]> = (0..26).map(f64::from).map(|k| [10.0 + k, 20.0 + 0.3 * k]).collect();
        let s = Segment::through(&points, 2, 0.1).unwrap();
        let [x, y] = s.place(3.0, 0.0);
        assert!((y - 20.0 - 0.3 * (x - 10.0)).abs() < 1e-9 && s.positions().len() >= 26);
        let bent: Vec<[f64; 2]> = points.iter().map(|p| [p[0], p[1] + (p[0] - 20.0).abs()]).collect();
        assert!(Segment::through(&bent, 2, 1.0).is_none());
    }
}
