//! Weight of the other views, region by region, by leave-one-view-out validation: an image fitted to the other views'
//! samples predicts the samples of the view itself; the better it predicts them, the larger the weight.
//!
//! Where the samples of the other views are placed correctly, the residual of the fit at the view's own samples is much
//! smaller than the residual of single-view interpolation at theirs. Where they are misplaced (a wrong disparity,
//! something in front), it is as large.

use lenslet_core::geometry::Size;
use lenslet_core::image::{Cell, bilinear_by_differences};
use lenslet_core::noise::NoiseCurve;

/// Side of the cells in which squares are gathered, pixels of the target.
///
/// Source: chosen.
const CELL: usize = 4;

/// Cells on each side of a cell whose squares are added to its own.
///
/// Source: chosen.
const AROUND: usize = 1;

/// Least weight of the squares of a cell; below it the cell has no value.
///
/// Source: chosen.
const LEAST: f32 = 0.1;

/// Share of the prior residual left by the fit: full weight up to the first value, none beyond the second.
///
/// Source: chosen on planted surfaces.
const UNEXPLAINED: [f32; 2] = [0.25, 0.6];

/// Least and largest variance of noise (three colours together, values 0..1).
///
/// Source: chosen.
const NOISE: [f32; 2] = [2e-5, 6e-3];

/// Weighted squares and weights by cells.
pub(super) struct Cells {
    columns: usize,
    rows: usize,
    sums: Vec<[f32; 2]>,
}

impl Cells {
    /// For a picture of `w`×`h` pixels.
    pub(super) fn new(w: usize, h: usize) -> Self {
        let (columns, rows) = (w.div_ceil(CELL), h.div_ceil(CELL));
        Cells { columns, rows, sums: vec![[0.0; 2]; columns * rows] }
    }

    /// Adds a square and its weight at pixel (x, y).
    #[inline]
    pub(super) fn add(&mut self, x: usize, y: usize, values: [f32; 2]) {
        let cell = &mut self.sums[y / CELL * self.columns + x / CELL];
        cell[0] += values[0];
        cell[1] += values[1];
    }

    /// Mean square over each cell and those around it; NaN where there is nothing.
    fn means(&self) -> Vec<f32> {
        let mut out = Vec::with_capacity(self.sums.len());
        for y in 0..self.rows {
            for x in 0..self.columns {
                let (mut sum, mut weight) = (0f32, 0f32);
                for row in y.saturating_sub(AROUND)..=(y + AROUND).min(self.rows - 1) {
                    let (from, to) = (x.saturating_sub(AROUND), (x + AROUND).min(self.columns - 1));
                    for cell in &self.sums[row * self.columns + from..=row * self.columns + to] {
                        sum += cell[0];
                        weight += cell[1];
                    }
                }
                out.push(if weight > LEAST { sum / weight } else { f32::NAN });
            }
        }
        out
    }
}

/// Weight of the other views by cells, 0 to 1.
pub(super) struct OtherViewsWeight {
    columns: usize,
    rows: usize,
    values: Vec<f32>,
}

impl OtherViewsWeight {
    /// At a pixel, bilinear between the cells.
    #[inline]
    pub(super) fn at(&self, x: usize, y: usize) -> f32 {
        let among_cells = |x: usize| (x as f32 + 0.5) / CELL as f32 - 0.5;
        let cell = Cell::clamped(among_cells(x), among_cells(y), Size::new(self.columns, self.rows));
        bilinear_by_differences(cell.corners(|x, y| self.values[y * self.columns + x]), cell.fx, cell.fy)
    }
}

/// Weight from the squared residuals of the prior at the other views' samples (`prior`) and of the fit at the own ones
/// (`fitted`), and the light of the own samples, with which noise grows; `most` bounds the variance of the noise.
pub(super) fn cross_validate(prior: &Cells, fitted: &Cells, light: &Cells, most: f32) -> OtherViewsWeight {
    let (before, after, light) = (prior.means(), fitted.means(), light.means());
    let noise = noise_variance(&light, &after, most.clamp(NOISE[0], NOISE[1]));
    let values =
        before.iter().zip(&after).zip(&light).map(|((&b, &a), &l)| weight_of(b, a, noise.noise_at(l))).collect();
    OtherViewsWeight { columns: prior.columns, rows: prior.rows, values }
}

/// Number of groups of cells of like light in which the noise is estimated.
///
/// Source: chosen.
const GROUPS: usize = 12;

/// Variance of the noise over light. Most of a picture is flat: among cells of like light, a low quantile of the fit's
/// residual is noise.
fn noise_variance(light: &[f32], after: &[f32], most: f32) -> NoiseCurve {
    let cells = light.iter().zip(after).map(|(&l, &a)| (l, a)).collect();
    lower_quantiles(cells, 4, [NOISE[0], most], NOISE[1])
}

/// Mean squares over light that one in `one_in` of the pairs (light, mean square) of like light do not reach, held within
/// `bounds`; `unknown` where there are no numbers.
pub(super) fn lower_quantiles(
    mut cells: Vec<(f32, f32)>,
    one_in: usize,
    [least, most]: [f32; 2],
    unknown: f32,
) -> NoiseCurve {
    cells.retain(|(light, square)| light.is_finite() && square.is_finite());
    if cells.is_empty() {
        return NoiseCurve::constant(unknown);
    }
    cells.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let size = cells.len().div_ceil(GROUPS).max(1);
    let knots = cells.chunks_mut(size).map(|group| {
        let middle = group[group.len() / 2].0;
        group.sort_unstable_by(|a, b| a.1.total_cmp(&b.1));
        (middle, group[group.len() / one_in].1.clamp(least, most))
    });
    NoiseCurve::new(knots.collect())
}

/// 1 where the residual of the fit is noise alone, or a small part of the prior's beyond noise; 0 where either is
/// unknown.
fn weight_of(before: f32, after: f32, noise: f32) -> f32 {
    if !(before.is_finite() && after.is_finite()) {
        return 0.0;
    }
    let excess = (after - 2.0 * noise).max(0.0);
    let share = excess / ((before - noise).max(0.0) + noise);
    falling(share, UNEXPLAINED)
}

/// A weight that falls smoothly from 1 at `full` to 0 at `none`.
pub(super) fn falling(x: f32, [full, none]: [f32; 2]) -> f32 {
    let f = ((none - x) / (none - full)).clamp(0.0, 1.0);
    f * f * (3.0 - 2.0 * f)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn predicted_texture_has_weight_and_contradicted_texture_has_none() {
        let noise = 1e-4;
        assert_eq!(weight_of(1e-4, 1e-4, noise), 1.0, "noise alone");
        assert_eq!(weight_of(5e-2, 5e-3, noise), 1.0, "texture explained");
        assert_eq!(weight_of(5e-2, 5e-2, noise), 0.0, "texture contradicted");
        let half = weight_of(5e-2, 2.1e-2, noise);
        assert!(half > 0.1 && half < 0.9, "{half}");
        assert_eq!(weight_of(f32::NAN, 0.0, noise), 0.0);
    }

    #[test]
    fn noise_follows_light() {
        let light: Vec<f32> = (0..1000).map(|k| k as f32 / 1000.0).collect();
        let after: Vec<f32> =
            light.iter().enumerate().map(|(k, l)| if k % 2 == 0 { 1e-3 * l + 1e-4 } else { 0.05 }).collect();
        let noise = noise_variance(&light, &after, NOISE[1]);
        for l in [0.1, 0.5, 0.9] {
            assert!((noise.noise_at(l) / (1e-3 * l + 1e-4) - 1.0).abs() < 0.2, "{} at {l}", noise.noise_at(l));
        }
        assert!(noise.noise_at(-1.0) <= noise.noise_at(0.5) && noise.noise_at(2.0) >= noise.noise_at(0.5));
        assert!(noise_variance(&light, &after, 3e-4).noise_at(0.9) <= 3e-4);
        assert_eq!(noise_variance(&[], &[], NOISE[1]).noise_at(0.5), NOISE[1]);
    }

    #[test]
    fn the_weight_is_local_and_smooth() {
        let (w, h) = (80, 40);
        let (mut prior, mut fitted) = (Cells::new(w, h), Cells::new(w, h));
        for y in 0..h {
            for x in 0..w {
                prior.add(x, y, [0.04, 1.0]);
                fitted.add(x, y, [if x < 40 { 1e-4 } else { 0.05 }, 1.0]);
            }
        }
        let mut light = Cells::new(w, h);
        for y in 0..h {
            for x in 0..w {
                light.add(x, y, [0.5, 1.0]);
            }
        }
        let weight = cross_validate(&prior, &fitted, &light, NOISE[1]);
        assert_eq!(weight.at(10, 20), 1.0);
        assert_eq!(weight.at(70, 20), 0.0);
        for x in 1..w {
            assert!((weight.at(x, 20) - weight.at(x - 1, 20)).abs() < 0.3, "column {x}");
        }
    }
}
