//! Planes of floats: luminance of views, sub-pixel shifts, halving, box means.

use ndarray::ArrayView3;

use super::error::Error;

/// Weights of R, G and B in luminance (ITU-R BT.601).
pub const LUMINANCE: [f32; 3] = [0.299, 0.587, 0.114];

/// One image, rows one after the other.
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width·height` values.
    pub data: Vec<f32>,
}

impl Plane {
    /// A plane of one value.
    pub fn filled(width: usize, height: usize, value: f32) -> Self {
        Plane { width, height, data: vec![value; width * height] }
    }

    /// Row `t`.
    #[inline]
    pub fn row(&self, t: usize) -> &[f32] {
        &self.data[t * self.width..(t + 1) * self.width]
    }

    /// Bilinear value at (`x`, `y`), clamped to the frame.
    #[inline]
    pub fn at(&self, x: f32, y: f32) -> f32 {
        let x = x.clamp(0.0, (self.width - 1) as f32);
        let y = y.clamp(0.0, (self.height - 1) as f32);
        let (x0, y0) = (x as usize, y as usize);
        let (fx, fy) = (x - x0 as f32, y - y0 as f32);
        let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
        let (top, bottom) = (self.row(y0), self.row(y1));
        let upper = top[x0] + fx * (top[x1] - top[x0]);
        let lower = bottom[x0] + fx * (bottom[x1] - bottom[x0]);
        upper + fy * (lower - upper)
    }

    /// Half the size: means of 2×2 pixels. Pixel (s, t) of the half lies at (2s + ½, 2t + ½) of the whole.
    pub fn halved(&self) -> Plane {
        let (w, h) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let mut out = Plane::filled(w, h, 0.0);
        for t in 0..h {
            let (a, b) = (self.row((2 * t).min(self.height - 1)), self.row((2 * t + 1).min(self.height - 1)));
            for s in 0..w {
                let (l, r) = ((2 * s).min(self.width - 1), (2 * s + 1).min(self.width - 1));
                out.data[t * w + s] = 0.25 * (a[l] + a[r] + b[l] + b[r]);
            }
        }
        out
    }
}

/// Luminance of a view (t, s, c) with one channel or three; values that are not finite count as 0.
///
/// # Errors
/// [`Error::Shape`] for any other number of channels or an empty view.
pub fn luminance(view: &ArrayView3<f32>) -> Result<Plane, Error> {
    let (height, width, channels) = view.dim();
    if height == 0 || width == 0 || !(channels == 1 || channels == 3) {
        return Err(Error::Shape(format!("a view of {width}x{height} with {channels} channels")));
    }
    let mut data = Vec::with_capacity(width * height);
    for row in view.outer_iter() {
        for pixel in row.outer_iter() {
            let value = if channels == 1 {
                pixel[0]
            } else {
                LUMINANCE[0] * pixel[0] + LUMINANCE[1] * pixel[1] + LUMINANCE[2] * pixel[2]
            };
            data.push(if value.is_finite() { value } else { 0.0 });
        }
    }
    Ok(Plane { width, height, data })
}

/// Catmull-Rom weights for the position `f` (0..1) between the second and third of four samples.
#[inline]
pub fn cubic_weights(f: f32) -> [f32; 4] {
    let (f2, f3) = (f * f, f * f * f);
    [0.5 * (-f + 2.0 * f2 - f3), 0.5 * (2.0 - 5.0 * f2 + 3.0 * f3), 0.5 * (f + 4.0 * f2 - 3.0 * f3), 0.5 * (f3 - f2)]
}

/// Row `t` of `plane` sampled at (s + dx, t + dy), by Catmull-Rom, edges repeated. `scratch` is reused between calls.
pub fn shifted_row(plane: &Plane, t: usize, dx: f32, dy: f32, scratch: &mut Vec<f32>, out: &mut [f32]) {
    let (w, h) = (plane.width as isize, plane.height as isize);
    let (ix, iy) = (dx.floor(), dy.floor());
    let (wx, wy) = (cubic_weights(dx - ix), cubic_weights(dy - iy));
    let (ix, iy) = (ix as isize, iy as isize);
    let row = |k: isize| plane.row((t as isize + iy + k).clamp(0, h - 1) as usize);
    let (a, b, c, d) = (row(-1), row(0), row(1), row(2));
    let margin = (ix.unsigned_abs() + 3).min(4 * plane.width + 3);
    scratch.resize(plane.width + 2 * margin, 0.0);
    let inner = &mut scratch[margin..margin + plane.width];
    for ((((o, &a), &b), &c), &d) in inner.iter_mut().zip(a).zip(b).zip(c).zip(d) {
        *o = wy[0] * a + wy[1] * b + wy[2] * c + wy[3] * d;
    }
    let (first, last) = (scratch[margin], scratch[margin + plane.width - 1]);
    scratch[..margin].fill(first);
    scratch[margin + plane.width..].fill(last);
    // Beyond four widths everything is the edge value anyway.
    let ix = ix.clamp(-4 * w, 4 * w);
    let start = (margin as isize + ix - 1) as usize;
    let n = out.len();
    let src = &scratch[start..start + n + 3];
    for (o, q) in out.iter_mut().zip(src.windows(4)) {
        *o = wx[0] * q[0] + wx[1] * q[1] + wx[2] * q[2] + wx[3] * q[3];
    }
}

/// Mean over the (2r+1)² box around each pixel, the part inside the frame; running sums, O(1) a pixel.
pub fn box_mean(data: &[f32], width: usize, height: usize, r: usize, out: &mut Vec<f32>) {
    out.clear();
    out.resize(width * height, 0.0);
    if width == 0 || height == 0 {
        return;
    }
    // Vertical sums of columns slide down; each row is then summed along.
    let mut columns = vec![0f32; width];
    for t in 0..r.min(height) {
        for (c, &v) in columns.iter_mut().zip(&data[t * width..(t + 1) * width]) {
            *c += v;
        }
    }
    let mut cumulative = vec![0f64; width + 1];
    for t in 0..height {
        if t + r < height {
            for (c, &v) in columns.iter_mut().zip(&data[(t + r) * width..(t + r + 1) * width]) {
                *c += v;
            }
        }
        if t > r {
            for (c, &v) in columns.iter_mut().zip(&data[(t - r - 1) * width..(t - r) * width]) {
                *c -= v;
            }
        }
        let rows = (t + r).min(height - 1) - t.saturating_sub(r) + 1;
        let mut sum = 0f64;
        for (s, &c) in columns.iter().enumerate() {
            sum += f64::from(c);
            cumulative[s + 1] = sum;
        }
        let row = &mut out[t * width..(t + 1) * width];
        for (s, o) in row.iter_mut().enumerate() {
            let (lo, hi) = (s.saturating_sub(r), (s + r).min(width - 1) + 1);
            *o = ((cumulative[hi] - cumulative[lo]) / ((hi - lo) * rows) as f64) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(w: usize, h: usize) -> Plane {
        let data = (0..w * h).map(|k| 0.01 * (k % w) as f32 + 0.02 * (k / w) as f32).collect();
        Plane { width: w, height: h, data }
    }

    #[test]
    fn a_shifted_ramp_is_the_ramp_plus_the_shift() {
        let p = ramp(40, 30);
        let mut out = vec![0.0; 40];
        shifted_row(&p, 15, 1.3, -2.6, &mut Vec::new(), &mut out);
        for (s, o) in out.iter().enumerate().take(35).skip(5) {
            let expected = 0.01 * (s as f32 + 1.3) + 0.02 * (15.0 - 2.6);
            assert!((o - expected).abs() < 1e-5, "{s}: {o} against {expected}");
        }
    }

    #[test]
    fn huge_shifts_give_edge_values() {
        let p = ramp(7, 5);
        let mut out = vec![9.0; 7];
        shifted_row(&p, 2, 1e9, 1e9, &mut Vec::new(), &mut out);
        assert!(out.iter().all(|o| (o - p.row(4)[6]).abs() < 1e-6));
        shifted_row(&p, 2, -1e9, -1e9, &mut Vec::new(), &mut out);
        assert!(out.iter().all(|o| (o - p.row(0)[0]).abs() < 1e-6));
    }

    #[test]
    fn box_means_equal_the_plain_loop() {
        let (w, h, r) = (13, 9, 3);
        let data: Vec<f32> = (0..w * h).map(|k| ((k * 7919) % 101) as f32 / 101.0).collect();
        let mut fast = Vec::new();
        box_mean(&data, w, h, r, &mut fast);
        for t in 0..h {
            for s in 0..w {
                let (mut sum, mut n) = (0.0, 0.0);
                for y in t.saturating_sub(r)..=(t + r).min(h - 1) {
                    for x in s.saturating_sub(r)..=(s + r).min(w - 1) {
                        sum += data[y * w + x];
                        n += 1.0;
                    }
                }
                assert!((fast[t * w + s] - sum / n).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn halving_keeps_the_mean() {
        let p = ramp(8, 6);
        let mean = |p: &Plane| p.data.iter().sum::<f32>() / p.data.len() as f32;
        assert!((mean(&p) - mean(&p.halved())).abs() < 1e-6);
    }
}
