//! One textured layer of a scene: a picture with transparency on a plane, low-passed by the lenslet's footprint.
//!
//! Positions on a layer are those of the central view, in lenslet pitches from the sensor's centre. A layer's disparity
//! is d(X) = d0 + g·X, in pitches per sensor pixel of offset: a point at X shows at P = X + d(X)·δ under offset δ
//! (sensor pixels), so P shows X = P − d·δ with d = (d0 + g·P)/(1 + g·δ). The texture is a grid of cubic B-spline
//! coefficients at a spacing of 0.8 footprint sigmas; box, Gaussian and spline together have the footprint's variance,
//! so that the layer *is* the low-passed picture, at any position.

use rayon::prelude::*;

use super::description::{Bounds, LayerSource};
use super::error::Error;
use super::texels::{MOST_TEXELS, TEXEL};

/// A rasterised, low-passed layer.
#[derive(Debug, Clone)]
pub struct Layer {
    disparity: [f64; 3],
    bounded: bool,
    origin: [f64; 2],
    per_pitch: f64,
    columns: usize,
    rows: usize,
    /// Premultiplied (r, g, b, alpha).
    texels: Vec<[f32; 4]>,
    /// Blocks of 8×8 texels a row.
    blocks: usize,
    /// Whether nothing can be seen from anywhere in a block of 8×8 texels.
    empty: Vec<bool>,
}

/// Alpha below which a texel counts as empty: a hundredth of a step of 16-bit output.
const NOTHING: f32 = 1.5e-7;

impl Layer {
    /// Rasterises `source` over its bounds, or over `canvas` where it has none.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the layer would need too many texels.
    pub fn new(source: &LayerSource, canvas: Bounds, footprint: f64) -> Result<Layer, Error> {
        let texel = TEXEL * footprint;
        let [left, top, right, bottom] = source.bounds.map_or(canvas, |b| {
            // Room for the blur and for the spline's support.
            let rim = 5.0 * footprint + 3.0 * texel;
            [b[0].max(canvas[0]) - rim, b[1].max(canvas[1]) - rim, b[2].min(canvas[2]) + rim, b[3].min(canvas[3]) + rim]
        });
        let (columns, rows) =
            (((right - left) / texel).ceil().max(4.0) + 1.0, ((bottom - top) / texel).ceil().max(4.0) + 1.0);
        if !(columns * rows <= MOST_TEXELS) {
            return Err(Error::Parameter(format!(
                "a scene of {columns:.0}x{rows:.0} texels is too large; take a smaller sensor or a wider footprint"
            )));
        }
        let (columns, rows) = (columns as usize, rows as usize);
        let mut texels = vec![[0f32; 4]; columns * rows];
        texels.par_chunks_mut(columns).enumerate().for_each(|(r, line)| {
            for (c, texel_value) in line.iter_mut().enumerate() {
                for (dx, dy) in [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)] {
                    let (x, y) = (left + (c as f64 + dx) * texel, top + (r as f64 + dy) * texel);
                    let outside = source.bounds.is_some_and(|b| x < b[0] || y < b[1] || x > b[2] || y > b[3]);
                    if outside {
                        continue;
                    }
                    let p = (source.paint)(x, y);
                    for k in 0..3 {
                        texel_value[k] += 0.25 * p[k] * p[3];
                    }
                    texel_value[3] += 0.25 * p[3];
                }
            }
        });
        // 1/16 texel² from the four positions, 1/3 from the spline; the Gaussian brings the rest.
        let sigma = (TEXEL.powi(-2) - 1.0 / 3.0 - 1.0 / 16.0).sqrt();
        blur(&mut texels, columns, rows, sigma);
        let (blocks, block_rows) = (columns.div_ceil(8), rows.div_ceil(8));
        let mut empty = vec![true; blocks * block_rows];
        for (r, line) in texels.chunks(columns).enumerate() {
            for (c, _) in line.iter().enumerate().filter(|(_, texel)| texel[3] > NOTHING) {
                // The spline at (column, row) reaches one texel back and two on.
                for row in r.saturating_sub(2) / 8..=((r + 1) / 8).min(block_rows - 1) {
                    for column in c.saturating_sub(2) / 8..=((c + 1) / 8).min(blocks - 1) {
                        empty[row * blocks + column] = false;
                    }
                }
            }
        }
        Ok(Layer {
            disparity: source.disparity,
            bounded: source.bounds.is_some(),
            origin: [left, top],
            per_pitch: 1.0 / texel,
            columns,
            rows,
            texels,
            blocks,
            empty,
        })
    }

    /// Disparity at position `p` of the view under offset `delta`.
    #[inline]
    pub fn disparity(&self, p: [f64; 2], delta: [f64; 2]) -> f64 {
        let [d0, gx, gy] = self.disparity;
        (d0 + gx * p[0] + gy * p[1]) / (1.0 + gx * delta[0] + gy * delta[1])
    }

    /// Whether anything of the layer can be seen within the rectangle `area` of a view whose offset is at most `reach`
    /// either way. Errs on the side of yes.
    pub fn reaches(&self, area: Bounds, reach: f64) -> bool {
        let [d0, gx, gy] = self.disparity;
        let far = |a: f64, b: f64| a.abs().max(b.abs());
        let slope = 1.0 - (gx.abs() + gy.abs()) * reach;
        if slope < 0.1 {
            return true;
        }
        let most = (d0.abs() + gx.abs() * far(area[0], area[2]) + gy.abs() * far(area[1], area[3])) / slope * reach;
        let texel = |value: f64, origin: f64, end: usize| {
            ((value - origin) * self.per_pitch).max(1.0).min((end - 3) as f64) as usize / 8
        };
        let columns =
            texel(area[0] - most, self.origin[0], self.columns)..=texel(area[2] + most, self.origin[0], self.columns);
        let rows = texel(area[1] - most, self.origin[1], self.rows)..=texel(area[3] + most, self.origin[1], self.rows);
        rows.into_iter().any(|row| columns.clone().any(|column| !self.empty[row * self.blocks + column]))
    }

    /// Premultiplied colour that position `p` sees under offset `delta`.
    #[inline]
    pub fn sample(&self, p: [f64; 2], delta: [f64; 2]) -> [f32; 4] {
        let d = self.disparity(p, delta);
        let tx = (p[0] - d * delta[0] - self.origin[0]) * self.per_pitch;
        let ty = (p[1] - d * delta[1] - self.origin[1]) * self.per_pitch;
        let (right, bottom) = ((self.columns - 3) as f64, (self.rows - 3) as f64);
        if self.bounded && !(tx > 1.0 && ty > 1.0 && tx < right && ty < bottom) {
            return [0.0; 4];
        }
        // max and min (not clamp) so that a NaN falls on the border.
        let (tx, ty) = (tx.max(1.0).min(right), ty.max(1.0).min(bottom));
        let (column, row) = (tx as usize, ty as usize);
        if self.empty[row / 8 * self.blocks + column / 8] {
            return [0.0; 4];
        }
        let (wx, wy) = (spline((tx - column as f64) as f32), spline((ty - row as f64) as f32));
        let mut sum = [0f32; 4];
        for (k, wy) in wy.iter().enumerate() {
            let start = (row - 1 + k) * self.columns + column - 1;
            let line = &self.texels[start..start + 4];
            let mut across = [0f32; 4];
            for (texel, wx) in line.iter().zip(&wx) {
                for c in 0..4 {
                    across[c] += wx * texel[c];
                }
            }
            for c in 0..4 {
                sum[c] += wy * across[c];
            }
        }
        sum
    }
}

/// Weights of the uniform cubic B-spline at the four neighbours of fraction `f`.
#[inline]
fn spline(f: f32) -> [f32; 4] {
    let (g, f2) = (1.0 - f, f * f);
    let f3 = f2 * f;
    [g * g * g / 6.0, (3.0 * f3 - 6.0 * f2 + 4.0) / 6.0, (3.0 * (f + f2 - f3) + 1.0) / 6.0, f3 / 6.0]
}

/// Separable Gaussian with borders repeated.
fn blur(texels: &mut [[f32; 4]], columns: usize, rows: usize, sigma: f64) {
    let reach = (4.0 * sigma).ceil() as usize;
    let mut kernel: Vec<f32> =
        (0..=2 * reach).map(|k| (-(k as f64 - reach as f64).powi(2) / (2.0 * sigma * sigma)).exp() as f32).collect();
    let total: f32 = kernel.iter().sum();
    kernel.iter_mut().for_each(|k| *k /= total);
    let mut other = vec![[0f32; 4]; texels.len()];
    other.par_chunks_mut(columns).zip(texels.par_chunks(columns)).for_each(|(to, from)| {
        for (c, to) in to.iter_mut().enumerate() {
            for (k, w) in kernel.iter().enumerate() {
                let at = from[(c + k).saturating_sub(reach).min(columns - 1)];
                for i in 0..4 {
                    to[i] += w * at[i];
                }
            }
        }
    });
    texels.par_chunks_mut(columns).enumerate().for_each(|(r, to)| {
        to.fill([0.0; 4]);
        for (k, w) in kernel.iter().enumerate() {
            let row = (r + k).saturating_sub(reach).min(rows - 1);
            for (to, from) in to.iter_mut().zip(&other[row * columns..]) {
                for i in 0..4 {
                    to[i] += w * from[i];
                }
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::description::Paint;

    const CANVAS: Bounds = [-20.0, -20.0, 20.0, 20.0];

    fn layer(disparity: [f64; 3], bounds: Option<Bounds>, paint: Box<Paint<'static>>) -> Layer {
        Layer::new(&LayerSource { disparity, bounds, paint }, CANVAS, 0.25).unwrap()
    }

    #[test]
    fn the_low_pass_is_the_footprint() {
        // A sine of frequency f leaves a Gaussian of sigma s with amplitude exp(−2π²s²f²).
        for f in [0.1f64, 0.3, 0.5] {
            let wave = move |x: f64, _: f64| {
                let v = 0.5 + 0.4 * (std::f64::consts::TAU * f * x).cos() as f32;
                [v, v, v, 1.0]
            };
            let layer = layer([0.0; 3], None, Box::new(wave));
            let expected = 0.4 * (-2.0 * (std::f64::consts::PI * 0.25 * f).powi(2)).exp();
            let (high, low) = (layer.sample([0.0, 3.3], [0.0; 2])[0], layer.sample([0.5 / f, 3.3], [0.0; 2])[0]);
            let amplitude = f64::from(high - low) / 2.0;
            assert!((amplitude / expected - 1.0).abs() < 0.02, "{f}: {amplitude} {expected}");
        }
    }

    #[test]
    fn a_point_moves_by_its_disparity_times_the_offset() {
        let spot = |x: f64, y: f64| {
            let v = (-((x - 4.0).powi(2) + (y + 3.0).powi(2)) / 2.0).exp() as f32;
            [v, v, v, 1.0]
        };
        for disparity in [[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [-0.2, 0.01, -0.015]] {
            let layer = layer(disparity, None, Box::new(spot));
            let d = disparity[0] + 4.0 * disparity[1] - 3.0 * disparity[2];
            assert!((layer.disparity([4.0, -3.0], [0.0; 2]) - d).abs() < 1e-12);
            let still = layer.sample([4.0, -3.0], [0.0; 2])[0];
            for delta in [[3.0, 0.0], [-2.0, 1.5]] {
                let p = [4.0 + d * delta[0], -3.0 + d * delta[1]];
                assert!((layer.disparity(p, delta) - d).abs() < 1e-12);
                assert!((layer.sample(p, delta)[0] - still).abs() < 1e-5);
                assert!(still > 0.9 && layer.sample([p[0] + 1.0, p[1]], delta)[0] < still - 0.2);
            }
        }
    }

    #[test]
    fn a_bounded_layer_ends_and_never_leaves_its_range() {
        let layer = layer([0.0; 3], Some([-3.0, -2.0, 3.0, 2.0]), Box::new(|_, _| [0.5, 0.25, 1.0, 1.0]));
        for k in 0..400 {
            let p = [f64::from(k % 20) * 0.5 - 5.0, f64::from(k / 20) * 0.5 - 5.0];
            let s = layer.sample(p, [0.0; 2]);
            assert!((0.0..=1.000_01).contains(&s[3]), "{s:?}");
            assert!((s[0] - 0.5 * s[3]).abs() < 1e-5);
            if p[0].abs() > 4.5 || p[1].abs() > 3.5 {
                assert!(s[3] < 1e-4, "{p:?} {s:?}");
            }
            if p[0].abs() < 1.5 && p[1].abs() < 0.5 {
                assert!(s[3] > 0.999);
            }
        }
        let edge = layer.sample([3.0, 0.0], [0.0; 2])[3];
        // The rim falls between the four positions of a texel: off by at most a quarter of one, 0.05 pitches.
        assert!((edge - 0.5).abs() < 0.09, "{edge}");
        assert!(layer.sample([f64::NAN, 0.0], [0.0; 2]).iter().all(|v| *v == 0.0));
    }

    #[test]
    fn skipping_empty_blocks_changes_nothing() {
        let dots = |x: f64, y: f64| {
            let near = (x - 7.0 * (x / 7.0).round()).hypot(y - 7.0 * (y / 7.0).round()) < 0.4;
            [0.8, 0.5, 0.2, f32::from(u8::from(near))]
        };
        let layer = layer([0.2, 0.0, 0.0], None, Box::new(dots));
        let all = Layer { empty: vec![false; layer.empty.len()], ..layer.clone() };
        assert!(layer.empty.iter().filter(|e| **e).count() > layer.empty.len() / 5);
        let mut seen = 0;
        for k in 0..40_000 {
            let p = [f64::from(k % 200) * 0.19 - 19.0, f64::from(k / 200) * 0.19 - 19.0];
            let (fast, plain) = (layer.sample(p, [1.0, -2.0]), all.sample(p, [1.0, -2.0]));
            assert!(fast.iter().zip(&plain).all(|(a, b)| (a - b).abs() < 1e-6));
            seen += usize::from(plain[3] > 0.1);
        }
        assert!(seen > 100);
    }

    #[test]
    fn too_large_a_layer_is_refused() {
        let source = LayerSource { disparity: [0.0; 3], bounds: None, paint: Box::new(|_, _| [0.0; 4]) };
        assert!(matches!(Layer::new(&source, [-1e5, -1e5, 1e5, 1e5], 0.25), Err(Error::Parameter(_))));
    }
}
