//! Means over square boxes.
//!
//! Two functions: [`box_mean`] runs on one thread, for the many planes of a cost volume, with f64 sums, accurate even
//! over long rows; [`box_mean_in_bands`] filters a single picture on all threads. Their rounding differs.

use crate::geometry::Size;
use ndarray::{Array2, Axis};
use rayon::prelude::*;

/// Mean over the box of 2`r` + 1 pixels a side around each pixel, or its part inside the frame, into `out`. Running
/// sums, along the rows in f64, so the time does not depend on `r`. Runs on the calling thread.
///
/// ```
/// use lenslet_core::image::box_mean;
/// use lenslet_core::geometry::Size;
/// let mut mean = Vec::new();
/// box_mean(&[0.0, 3.0, 6.0], Size::new(3, 1), 1, &mut mean);
/// assert_eq!(mean, [1.5, 3.0, 4.5]);
/// ```
pub fn box_mean(data: &[f32], size: Size, r: usize, out: &mut Vec<f32>) {
    let Size { width, height } = size;
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

/// Rows whose means are made together; fixed, so that running sums do not depend on threads.
/// Source: chosen; a few rows are summed anew at the start of each band.
const BAND: usize = 64;

/// As [`box_mean`], with sums in f32, on all threads of the caller's pool; the result does not depend on their number.
///
/// ```
/// use lenslet_core::image::box_mean_in_bands;
/// let mean = box_mean_in_bands(ndarray::array![[0.0, 3.0, 6.0]], 1);
/// assert_eq!(mean, ndarray::array![[1.5, 3.0, 4.5]]);
/// ```
#[must_use]
pub fn box_mean_in_bands(mut plane: Array2<f32>, radius: usize) -> Array2<f32> {
    let (h, w) = plane.dim();
    if h == 0 || w == 0 {
        return plane;
    }
    plane.axis_chunks_iter_mut(Axis(0), BAND).into_par_iter().for_each(|mut band| {
        let mut line = vec![0.0; w];
        for mut row in band.rows_mut() {
            if let Some(row) = row.as_slice_mut() {
                row_means(row, radius, &mut line);
                row.copy_from_slice(&line);
            }
        }
    });
    // Vertical sums, one row at a time.
    let mut out = Array2::zeros((h, w));
    out.axis_chunks_iter_mut(Axis(0), BAND).into_par_iter().enumerate().for_each(|(k, mut band)| {
        let first = k * BAND;
        let mut sums = vec![0.0f32; w];
        let add = |sums: &mut [f32], y: usize, sign: f32| {
            sums.iter_mut().zip(plane.row(y)).for_each(|(s, v)| *s += sign * v);
        };
        for y in first.saturating_sub(radius)..(first + radius).min(h) {
            add(&mut sums, y, 1.0);
        }
        for (y, mut row) in (first..).zip(band.rows_mut()) {
            if y + radius < h {
                add(&mut sums, y + radius, 1.0);
            }
            if y > first && y > radius {
                add(&mut sums, y - radius - 1, -1.0);
            }
            let count = ((y + radius).min(h - 1) + 1 - y.saturating_sub(radius)) as f32;
            row.iter_mut().zip(&sums).for_each(|(o, s)| *o = s / count);
        }
    });
    out
}

fn row_means(row: &[f32], radius: usize, out: &mut [f32]) {
    let n = row.len();
    let mut sum: f32 = row[..radius.min(n)].iter().sum();
    for x in 0..n {
        if x + radius < n {
            sum += row[x + radius];
        }
        if x > radius {
            sum -= row[x - radius - 1];
        }
        out[x] = sum / ((x + radius).min(n - 1) + 1 - x.saturating_sub(radius)) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn box_means_equal_the_plain_loop() {
        let (w, h, r) = (13, 9, 3);
        let data: Vec<f32> = (0..w * h).map(|k| ((k * 7919) % 101) as f32 / 101.0).collect();
        let mut fast = Vec::new();
        box_mean(&data, Size::new(w, h), r, &mut fast);
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
    fn window_means_equal_their_definition() {
        let plane = Array2::from_shape_fn((150, 12), |(y, x)| ((5 * y + 3 * x * x) % 13) as f32);
        for radius in [1, 3, 20, 70] {
            let found = box_mean_in_bands(plane.clone(), radius);
            for ((y, x), v) in found.indexed_iter() {
                let rows = y.saturating_sub(radius)..(y + radius + 1).min(150);
                let columns = x.saturating_sub(radius)..(x + radius + 1).min(12);
                let part = plane.slice(ndarray::s![rows, columns]);
                assert!((v - part.mean().unwrap()).abs() < 1e-4);
            }
        }
    }
}
