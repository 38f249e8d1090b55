//! Luminance of views as planes, and sub-pixel shifts of their rows.

use lenslet_core::colour::LUMINANCE;
use lenslet_core::image::{Plane, catmull_rom_weights};
use ndarray::ArrayView3;

use super::error::Error;

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

/// Row `t` of `plane` sampled at (s + dx, t + dy), by Catmull-Rom, edges repeated. `scratch` is reused between calls.
pub fn shifted_row(plane: &Plane, t: usize, dx: f32, dy: f32, scratch: &mut Vec<f32>, out: &mut [f32]) {
    let (weights, neighbours) = neighbours_of_shifted_row(plane, t, dx, dy, scratch);
    for (o, q) in out.iter_mut().zip(neighbours.windows(4)) {
        *o = weighted_sum(&weights, q);
    }
}

/// What [`shifted_row`] interpolates along the row: its value s is the sum of the four values from s on, with these weights.
#[inline(always)]
pub fn neighbours_of_shifted_row<'a>(
    plane: &Plane,
    t: usize,
    dx: f32,
    dy: f32,
    scratch: &'a mut Vec<f32>,
) -> ([f32; 4], &'a [f32]) {
    let (w, h) = (plane.width as isize, plane.height as isize);
    let (ix, iy) = (dx.floor(), dy.floor());
    let (along, across) = (catmull_rom_weights(dx - ix), catmull_rom_weights(dy - iy));
    let (ix, iy) = (ix as isize, iy as isize);
    let row = |k: isize| plane.row((t as isize + iy + k).clamp(0, h - 1) as usize);
    let (a, b, c, d) = (row(-1), row(0), row(1), row(2));
    let margin = (ix.unsigned_abs() + 3).min(4 * plane.width + 3);
    scratch.resize(plane.width + 2 * margin, 0.0);
    let inner = &mut scratch[margin..margin + plane.width];
    for ((((o, &a), &b), &c), &d) in inner.iter_mut().zip(a).zip(b).zip(c).zip(d) {
        *o = weighted_sum(&across, &[a, b, c, d]);
    }
    let (first, last) = (scratch[margin], scratch[margin + plane.width - 1]);
    scratch[..margin].fill(first);
    scratch[margin + plane.width..].fill(last);
    // Beyond four widths everything is the edge value anyway.
    let ix = ix.clamp(-4 * w, 4 * w);
    let start = (margin as isize + ix - 1) as usize;
    (along, &scratch[start..start + plane.width + 3])
}

/// Σ weight · value, in this order.
#[inline(always)]
pub fn weighted_sum(weights: &[f32; 4], values: &[f32]) -> f32 {
    weights[0] * values[0] + weights[1] * values[1] + weights[2] * values[2] + weights[3] * values[3]
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
}
