//! Registration of one picture onto another, for results of tools with another geometry and exposure: an affine map A
//! by Gauss-Newton on `Σ (g·R(A x) + o − T(x))²` over luminance, coarse to fine, then gain and offset of every channel.

use crate::geometry::Size;
use ndarray::{Array2, Array3, ArrayView3};
use rayon::prelude::*;

use super::error::Error;
use crate::colour::luminance;
use crate::image::bilinear_with_slopes;
use crate::linalg::gauss_jordan;
use crate::sampling::bicubic::bicubic_at;

/// Smallest side of the coarsest level, pixels.
/// Source: chosen.
const COARSEST: usize = 48;
/// Gauss-Newton steps per level at most.
/// Source: chosen; a handful is usual.
const STEPS: usize = 30;
/// Rows per job; fixed, so that sums do not depend on the number of threads.
/// Source: chosen.
const BAND: usize = 16;
/// A smaller pivot of the normal equations means that the picture does not determine the map.
/// Source: chosen.
const LEAST_PIVOT: f64 = 1e-12;

/// The map of a picture onto another, and the relation of their values.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Alignment {
    /// Reference pixel (s, t) ↔ result pixel (a0 s + a1 t + a2, a3 s + a4 t + a5).
    pub affine: [f64; 6],
    /// Gain and offset of every channel.
    pub gain: Vec<[f64; 2]>,
}

impl Alignment {
    /// Registers `result` (t, s, c) onto `reference` (t, s, c), of any two sizes that show about the same scene.
    ///
    /// # Errors
    /// When the channels differ, a side is shorter than 16 pixels, or a value is not finite.
    ///
    /// ```
    /// use lenslet_core::geometry::Size;
    /// use lenslet_core::metrics::Alignment;
    /// use ndarray::Array3;
    ///
    /// let scene = |x: f32, y: f32| 0.5 + 0.2 * (0.31 * x).sin() + 0.2 * (0.23 * y + 0.1 * x).cos();
    /// let truth = Array3::from_shape_fn((60, 60, 1), |(t, s, _)| scene(s as f32, t as f32));
    /// let shifted = Array3::from_shape_fn((60, 60, 1), |(t, s, _)| 0.5 * scene(s as f32 + 1.5, t as f32 - 0.5));
    /// let found = Alignment::estimate(shifted.view(), truth.view())?;
    /// assert!((found.affine[2] + 1.5).abs() < 0.05 && (found.affine[5] - 0.5).abs() < 0.05);
    /// assert!((found.gain[0][0] - 2.0).abs() < 0.05);
    /// assert_eq!(found.apply(shifted.view(), Size::new(60, 60)).dim(), (60, 60, 1));
    /// # Ok::<(), lenslet_core::metrics::Error>(())
    /// ```
    pub fn estimate(result: ArrayView3<f32>, reference: ArrayView3<f32>) -> Result<Alignment, Error> {
        for picture in [&result, &reference] {
            let (height, width, _) = picture.dim();
            if height < 16 || width < 16 {
                return Err(Error::Small { height, width, least: 16 });
            }
            if picture.iter().any(|x| !x.is_finite()) {
                return Err(Error::NotFinite);
            }
        }
        if result.dim().2 != reference.dim().2 {
            return Err(Error::Shape { result: result.shape().to_vec(), reference: reference.shape().to_vec() });
        }
        let (from, to) = (pyramid(luminance(result)), pyramid(luminance(reference)));
        let levels = from.len().min(to.len());
        let ratio = |a: usize, b: usize| a as f64 / b as f64;
        let (rh, rw) = (ratio(result.dim().0, reference.dim().0), ratio(result.dim().1, reference.dim().1));
        // Same field of view to begin with: pixel centres as in `sampling`.
        let mut affine = [rw, 0.0, 0.5 * rw - 0.5, 0.0, rh, 0.5 * rh - 0.5];
        for level in (0..levels).rev() {
            let scale = f64::from(1u32 << level);
            // Position x on the full picture is (x + 0.5)/scale − 0.5 on the level.
            let mut local = affine;
            for (row, k) in [(0, 2), (3, 5)] {
                let shift = 0.5 * (scale - 1.0);
                local[k] = (affine[row] * shift + affine[row + 1] * shift + affine[k] - shift) / scale;
            }
            refine_affine(&from[level], &to[level], &mut local);
            for (row, k) in [(0, 2), (3, 5)] {
                let shift = 0.5 * (scale - 1.0);
                affine[row] = local[row];
                affine[row + 1] = local[row + 1];
                affine[k] = local[k] * scale + shift - local[row] * shift - local[row + 1] * shift;
            }
        }
        let mut alignment = Alignment { affine, gain: Vec::new() };
        let warped = warp_affine(result, &alignment.affine, Size::new(reference.dim().1, reference.dim().0));
        let rim = (reference.dim().0.min(reference.dim().1) / 18).max(1);
        for c in 0..reference.dim().2 {
            let inner = ndarray::s![rim..reference.dim().0 - rim, rim..reference.dim().1 - rim, c];
            alignment.gain.push(fit_gain_and_offset(warped.slice(inner).iter(), reference.slice(inner).iter()));
        }
        Ok(alignment)
    }

    /// `result` (t, s, c) brought onto a reference of `size`, gain and offset applied.
    pub fn apply(&self, result: ArrayView3<f32>, size: Size) -> Array3<f32> {
        let mut out = warp_affine(result, &self.affine, size);
        for (c, &[gain, offset]) in self.gain.iter().enumerate().take(out.dim().2) {
            out.index_axis_mut(ndarray::Axis(2), c).mapv_inplace(|x| (gain * f64::from(x) + offset) as f32);
        }
        out
    }
}

/// Least-squares gain and offset from x to y.
fn fit_gain_and_offset<'a>(
    x: impl Iterator<Item = &'a f32> + Clone,
    y: impl Iterator<Item = &'a f32> + Clone,
) -> [f64; 2] {
    let mean = |v: &mut dyn Iterator<Item = &'a f32>| {
        let (sum, n) = v.fold((0.0, 0.0), |(s, n), &x| (s + f64::from(x), n + 1.0));
        sum / n
    };
    let (mx, my) = (mean(&mut x.clone()), mean(&mut y.clone()));
    let (mut xx, mut xy) = (0.0, 0.0);
    for (&a, &b) in x.zip(y) {
        xx += (f64::from(a) - mx).powi(2);
        xy += (f64::from(a) - mx) * (f64::from(b) - my);
    }
    let gain = if xx > 0.0 { xy / xx } else { 1.0 };
    [gain, my - gain * mx]
}

/// The picture sampled at `a` applied to every pixel of an output of this size, bicubic.
fn warp_affine(picture: ArrayView3<f32>, a: &[f64; 6], size: Size) -> Array3<f32> {
    let Size { width, height } = size;
    let channels = picture.dim().2;
    let mut out = vec![0.0; height * width * channels];
    out.par_chunks_mut(width * channels).enumerate().for_each(|(t, row)| {
        for (s, pixel) in row.chunks_exact_mut(channels).enumerate() {
            let (x, y) = (s as f64, t as f64);
            bicubic_at(picture, a[0] * x + a[1] * y + a[2], a[3] * x + a[4] * y + a[5], pixel);
        }
    });
    Array3::from_shape_vec((height, width, channels), out).unwrap_or_else(|_| Array3::zeros((height, width, channels)))
}

/// The picture at full, half, quarter … size, each pixel the mean of 2×2 of the level before; down to [`COARSEST`].
fn pyramid(picture: Array2<f32>) -> Vec<Array2<f32>> {
    let mut levels = vec![picture];
    while let Some(last) = levels.last()
        && last.dim().0.min(last.dim().1) >= 2 * COARSEST
    {
        let half = Array2::from_shape_fn((last.dim().0 / 2, last.dim().1 / 2), |(t, s)| {
            (last[[2 * t, 2 * s]] + last[[2 * t, 2 * s + 1]] + last[[2 * t + 1, 2 * s]] + last[[2 * t + 1, 2 * s + 1]])
                / 4.0
        });
        levels.push(half);
    }
    levels
}

/// Bilinear value and slopes of a picture; `None` outside of it.
fn value_and_slopes(picture: &Array2<f32>, x: f64, y: f64) -> Option<[f64; 3]> {
    let (height, width) = picture.dim();
    if !(x >= 0.0 && y >= 0.0 && x < (width - 1) as f64 && y < (height - 1) as f64) {
        return None;
    }
    let (s, t) = (x as usize, y as usize);
    let (fx, fy) = (x - s as f64, y - t as f64);
    let p = |j: usize, i: usize| f64::from(picture[[t + j, s + i]]);
    Some(bilinear_with_slopes([p(0, 0), p(0, 1), p(1, 0), p(1, 1)], fx, fy))
}

/// Gauss-Newton over the six numbers of the map and a gain and offset.
fn refine_affine(from: &Array2<f32>, to: &Array2<f32>, affine: &mut [f64; 6]) {
    let (height, width) = to.dim();
    let rim = (height.min(width) / 18).max(1);
    // Positions in units of half the width keep the equations well scaled.
    let unit = width.max(height) as f64 / 2.0;
    let [mut g, mut o] = [1.0, 0.0];
    for step in 0..STEPS {
        let bands: Vec<[f64; 44]> = (rim..height - rim)
            .collect::<Vec<_>>()
            .par_chunks(BAND)
            .map(|rows| {
                let mut sums = [0.0; 44];
                for &t in rows {
                    for s in rim..width - rim {
                        let (x, y) = (s as f64, t as f64);
                        let (px, py) =
                            (affine[0] * x + affine[1] * y + affine[2], affine[3] * x + affine[4] * y + affine[5]);
                        let Some([value, dx, dy]) = value_and_slopes(from, px, py) else { continue };
                        let error = f64::from(to[[t, s]]) - (g * value + o);
                        let (ux, uy) = (x / unit - 1.0, y / unit - 1.0);
                        let (gx, gy) = (g * dx, g * dy);
                        let j = [gx * ux, gx * uy, gx, gy * ux, gy * uy, gy, value, 1.0];
                        let mut k = 0;
                        for a in 0..8 {
                            for b in a..8 {
                                sums[k] += j[a] * j[b];
                                k += 1;
                            }
                        }
                        for (sum, j) in sums[36..].iter_mut().zip(j) {
                            *sum += j * error;
                        }
                    }
                }
                sums
            })
            .collect();
        let mut sums = [0.0; 44];
        for band in bands {
            for (a, b) in sums.iter_mut().zip(band) {
                *a += b;
            }
        }
        let Some(d) = solve_damped(&sums) else { return };
        g += d[6];
        o += d[7];
        for (row, d) in [(0, &d[0..3]), (3, &d[3..6])] {
            affine[row] += d[0] / unit;
            affine[row + 1] += d[1] / unit;
            affine[row + 2] += d[2] - d[0] - d[1];
        }
        let moved = d[..6].iter().fold(0.0f64, |m, x| m.max(x.abs()));
        if step > 2 && moved < 1e-4 {
            return;
        }
    }
}

/// Solves the 8×8 normal equations (upper triangle row by row, then the right side), slightly damped.
fn solve_damped(sums: &[f64; 44]) -> Option<[f64; 8]> {
    let mut m = [[0.0; 9]; 8];
    let mut k = 0;
    for a in 0..8 {
        for b in a..8 {
            m[a][b] = sums[k];
            m[b][a] = sums[k];
            k += 1;
        }
        m[a][8] = sums[36 + a];
    }
    for (a, row) in m.iter_mut().enumerate() {
        row[a] = row[a] * (1.0 + 1e-9) + 1e-12;
    }
    gauss_jordan(&mut m, LEAST_PIVOT)?;
    let solution = m.map(|row| row[8]);
    solution.iter().all(|x| x.is_finite()).then_some(solution)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::psnr;

    fn scene(x: f64, y: f64, c: usize) -> f32 {
        let wave = |f: f64, a: f64, p: f64| (f * (x * a.cos() + y * a.sin()) + p).sin();
        (0.5 + 0.15 * wave(0.11, 0.3, c as f64) + 0.12 * wave(0.23, 1.4, 1.0) + 0.1 * wave(0.05, 2.2, 2.0)) as f32
    }

    #[test]
    fn a_known_map_gain_and_size_come_back() {
        let truth = Array3::from_shape_fn((200, 240, 3), |(t, s, c)| scene(s as f64, t as f64, c));
        // The result has another size, is shifted, turned by 0.006, and darker.
        let true_affine = [0.70, 0.004, 1.3, -0.004, 0.71, -0.8];
        let det = true_affine[0] * true_affine[4] - true_affine[1] * true_affine[3];
        let result = Array3::from_shape_fn((144, 170, 3), |(t, s, c)| {
            let (x, y) = (s as f64 - true_affine[2], t as f64 - true_affine[5]);
            let (sx, sy) =
                ((true_affine[4] * x - true_affine[1] * y) / det, (true_affine[0] * y - true_affine[3] * x) / det);
            0.8 * scene(sx, sy, c) + 0.05
        });
        let found = Alignment::estimate(result.view(), truth.view()).unwrap();
        for (k, (a, b)) in found.affine.iter().zip(true_affine).enumerate() {
            let tolerance = if k % 3 == 2 { 0.05 } else { 5e-4 };
            assert!((a - b).abs() < tolerance, "{found:?}");
        }
        for [gain, offset] in &found.gain {
            assert!((gain - 1.25).abs() < 0.01 && (offset + 0.0625).abs() < 0.01, "{found:?}");
        }
        let back = found.apply(result.view(), Size::new(240, 200));
        let cut = ndarray::s![12..188, 12..228, ..];
        let score = psnr(back.slice(cut), truth.slice(cut)).unwrap();
        assert!(score > 45.0, "{score}");
    }

    #[test]
    fn equal_pictures_stay_where_they_are() {
        let truth = Array3::from_shape_fn((120, 100, 1), |(t, s, c)| scene(s as f64, t as f64, c));
        let found = Alignment::estimate(truth.view(), truth.view()).unwrap();
        for (a, b) in found.affine.iter().zip([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]) {
            assert!((a - b).abs() < 1e-6, "{found:?}");
        }
        assert!(Alignment::estimate(truth.view(), Array3::zeros((10, 10, 1)).view()).is_err());
        assert!(Alignment::estimate(truth.view(), Array3::zeros((100, 100, 3)).view()).is_err());
    }
}
