//! A capture without its scene: each pixel divided by the local mean of its colour.

use rayon::prelude::*;

use crate::calibration::average;
use crate::calibration::error::Error;
use crate::calibration::photometric::hot_pixels;
use crate::calibration::sensor_image::SensorImage;
use crate::container::Capture;

/// Half the side of the box of the local mean, pixels; the box holds a lenslet of the largest pitch looked for.
/// Source: chosen
const BOX: usize = 24;
/// Local light (share of full scale) at which a pixel's weight is ½; dark regions are mostly noise.
/// Source: chosen
const DIM: f32 = 0.02;

/// A capture, each pixel divided by the local mean of its colour, and the weight of each pixel (0 to 1; 0 where
/// saturated or dark).
pub fn flatten_capture(capture: &Capture, hot: &[u32]) -> Result<(SensorImage, Vec<f32>), Error> {
    let mut image = average::average_captures(std::slice::from_ref(capture), |v| v)?;
    hot_pixels::fill_hot_pixels(&mut image, hot);
    let means = local_means(&image, BOX);
    let mut weights = vec![0f32; image.data.len()];
    image.data.par_iter_mut().zip(weights.par_iter_mut()).zip(&means).for_each(|((v, w), &mean)| {
        let saturated = *v >= 0.999;
        let light = mean.max(0.0);
        *w = if saturated || light < 1e-3 { 0.0 } else { light / (light + DIM) };
        // A highlight within a dark box must not dominate the pattern.
        *v = if light < 1e-3 { 1.0 } else { (*v / light).min(4.0) };
    });
    image.limit = [f32::INFINITY; 4];
    Ok((image, weights))
}

/// Mean of the pixels of the same place of the 2×2 tile within `half` pixels in x and y.
fn local_means(image: &SensorImage, half: usize) -> Vec<f32> {
    let (width, height) = (image.width, image.height);
    let reach = half / 2;
    let mut rows = vec![0f32; width * height];
    rows.par_chunks_mut(width).zip(image.data.par_chunks(width)).for_each(|(out, row)| {
        for parity in 0..2.min(width) {
            let like: Vec<f32> = row[parity..].iter().step_by(2).copied().collect();
            for (k, mean) in sliding_means(&like, reach).into_iter().enumerate() {
                out[parity + 2 * k] = mean;
            }
        }
    });
    // Columns in strips of 64, so that memory is read along rows.
    let mut out = vec![0f32; width * height];
    for parity in 0..2.min(height) {
        let lines = (height - parity).div_ceil(2);
        let strips: Vec<(usize, Vec<f32>)> = (0..width.div_ceil(64))
            .into_par_iter()
            .map(|s| {
                let (x0, x1) = (s * 64, ((s + 1) * 64).min(width));
                let mut strip = vec![0f32; lines * (x1 - x0)];
                let mut sums = vec![0f64; x1 - x0];
                let line = |k: usize| &rows[(parity + 2 * k) * width + x0..(parity + 2 * k) * width + x1];
                let (mut low, mut high) = (0, 0);
                for k in 0..lines {
                    while high < lines && high <= k + reach {
                        sums.iter_mut().zip(line(high)).for_each(|(s, &v)| *s += f64::from(v));
                        high += 1;
                    }
                    while low + reach < k {
                        sums.iter_mut().zip(line(low)).for_each(|(s, &v)| *s -= f64::from(v));
                        low += 1;
                    }
                    let share = 1.0 / (high - low) as f64;
                    let target = &mut strip[k * (x1 - x0)..(k + 1) * (x1 - x0)];
                    target.iter_mut().zip(&sums).for_each(|(t, &s)| *t = (s * share) as f32);
                }
                (x0, strip)
            })
            .collect();
        for (x0, strip) in strips {
            let w = strip.len() / lines;
            for (k, part) in strip.chunks(w).enumerate() {
                let at = (parity + 2 * k) * width + x0;
                out[at..at + w].copy_from_slice(part);
            }
        }
    }
    out
}

/// Means over `reach` items to either side.
fn sliding_means(values: &[f32], reach: usize) -> Vec<f32> {
    let mut sum = 0f64;
    let (mut low, mut high) = (0, 0);
    (0..values.len())
        .map(|k| {
            while high < values.len() && high <= k + reach {
                sum += f64::from(values[high]);
                high += 1;
            }
            while low + reach < k {
                sum -= f64::from(values[low]);
                low += 1;
            }
            (sum / (high - low) as f64) as f32
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn local_means_are_the_sums_written_out() {
        let (w, h) = (67, 23);
        let data: Vec<f32> = (0..w * h).map(|k| ((k * 7919) % 101) as f32).collect();
        let image = SensorImage { width: w, height: h, data, limit: [f32::MAX; 4] };
        let fast = local_means(&image, 6);
        for (x, y) in [(0, 0), (66, 22), (30, 11), (31, 11), (5, 20)] {
            let (mut sum, mut n) = (0f64, 0f64);
            for yy in 0..h as i64 {
                for xx in 0..w as i64 {
                    let (dx, dy) = (xx - x as i64, yy - y as i64);
                    if dx % 2 == 0 && dy % 2 == 0 && dx.abs() <= 6 && dy.abs() <= 6 {
                        sum += f64::from(image.at(xx as usize, yy as usize));
                        n += 1.0;
                    }
                }
            }
            assert!((f64::from(fast[y * w + x]) - sum / n).abs() < 1e-3, "{x},{y}");
        }
    }

    #[test]
    fn dark_and_saturated_pixels_weigh_nothing() {
        use crate::container::{Cfa, Levels, RawMosaic};
        let levels = || Levels { black: [0.0; 4], white: [1000.0; 4] };
        let flat = |level: u16, odd: u16| {
            let mut data = vec![level; 80 * 80];
            data[40 * 80 + 40] = odd;
            flatten_capture(&Capture::bare(RawMosaic { width: 80, height: 80, data }, Cfa::Bggr, levels()), &[])
                .unwrap()
        };
        // Light 0.5: the weight is 0.5/0.52; a saturated pixel among it has none.
        let (image, weights) = flat(500, 1000);
        assert!((weights[10 * 80 + 11] - 0.5 / 0.52).abs() < 1e-5 && (image.data[10 * 80 + 11] - 1.0).abs() < 1e-5);
        assert_eq!(weights[40 * 80 + 40], 0.0);
        let (image, weights) = flat(500, 998);
        assert!(weights[40 * 80 + 40] > 0.9 && image.data[40 * 80 + 40] > 1.9);
        // Half of the picture is dark.
        let data = (0..160 * 80).map(|k| if k % 160 < 80 { 0 } else { 500 }).collect();
        let half = Capture::bare(RawMosaic { width: 160, height: 80, data }, Cfa::Bggr, levels());
        let (image, weights) = flatten_capture(&half, &[]).unwrap();
        assert_eq!((weights[40 * 160 + 20], image.data[40 * 160 + 20]), (0.0, 1.0));
        assert!(weights[40 * 160 + 140] > 0.9);
    }
}
