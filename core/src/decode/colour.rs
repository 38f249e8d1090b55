//! Colour: white balance and the camera's matrix. The sRGB curve is [`crate::lightfield::colour`].

use ndarray::Array3;
use rayon::prelude::*;

use super::develop::Mosaic;
use crate::container::{CameraFacts, CameraProfile, Cfa};

/// Multiplies every colour of `values` (…, …, 3) by `matrix` (row-major, rows = output R, G, B).
pub fn apply_matrix(values: &mut Array3<f32>, matrix: &[f32; 9]) {
    if values.dim().2 != 3 {
        return;
    }
    if let Some(flat) = values.as_slice_mut() {
        flat.par_chunks_mut(3 * 4096).for_each(|part| {
            for p in part.chunks_exact_mut(3) {
                let [r, g, b] = [p[0], p[1], p[2]];
                for (k, o) in p.iter_mut().enumerate() {
                    *o = matrix[3 * k] * r + matrix[3 * k + 1] * g + matrix[3 * k + 2] * b;
                }
            }
        });
    }
}

/// The exposure bias (EV) that brings a capture to the brightness its camera meant: what the file states, plus what the
/// camera's profile says its files are off by (see `exposure_offset` there). 0 where the file states none.
pub fn exposure_bias(camera: &CameraFacts) -> f32 {
    let Some(stated) = camera.exposure_bias else { return 0.0 };
    let known = camera.model.as_deref().and_then(CameraProfile::of_model);
    let offset = known.map_or(0.0, |p| p.sensor.exposure_offset);
    ((stated + offset) as f32).clamp(-8.0, 8.0)
}

/// Multiplies by 2^`ev`.
pub fn brighten(values: &mut Array3<f32>, ev: f32) {
    if ev != 0.0 {
        let factor = ev.exp2();
        values.mapv_inplace(|v| v * factor);
    }
}

/// White balance guessed from a mosaic, as gains of red, green, blue with the least at 1.
///
/// Shades of grey: the sixth-power means of the three colours are made equal, over blocks of 16×16 pixels that are
/// neither dark nor saturated. Bright surfaces decide, as they do for an eye, but no single highlight does.
pub fn estimate_gains(mosaic: &Mosaic, cfa: Cfa) -> [f32; 3] {
    const BLOCK: usize = 16;
    let (width, height) = (mosaic.width, mosaic.height);
    let bands: Vec<[f64; 3]> = (0..height / BLOCK)
        .into_par_iter()
        .map(|by| {
            let mut sums = [0f64; 3];
            for bx in 0..width / BLOCK {
                let mut mean = [0f64; 3];
                let mut most = 0f32;
                for y in by * BLOCK..(by + 1) * BLOCK {
                    for x in bx * BLOCK..(bx + 1) * BLOCK {
                        let value = mosaic.data[y * width + x];
                        most = most.max(value);
                        mean[cfa.colour(x, y)] += f64::from(value.max(0.0));
                    }
                }
                let count = (BLOCK * BLOCK / 4) as f64;
                let mean = [mean[0] / count, mean[1] / (2.0 * count), mean[2] / count];
                if most < 0.95 && mean[1] > 0.01 {
                    for (s, m) in sums.iter_mut().zip(mean) {
                        *s += m.powi(6);
                    }
                }
            }
            sums
        })
        .collect();
    let mut total = [0f64; 3];
    for band in bands {
        for (t, b) in total.iter_mut().zip(band) {
            *t += b;
        }
    }
    if total.iter().any(|&t| t <= 0.0) {
        return [1.0; 3];
    }
    let norm = total.map(|t| t.powf(1.0 / 6.0));
    let most = norm.iter().copied().fold(0.0, f64::max);
    norm.map(|n| ((most / n) as f32).min(16.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_matrix_is_applied_by_rows() {
        let mut values = Array3::from_shape_vec((1, 2, 3), vec![1.0, 2.0, 3.0, 0.0, 1.0, 0.0]).unwrap();
        apply_matrix(&mut values, &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]);
        assert_eq!(values.as_slice().unwrap(), &[1.0, 3.0, 6.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn a_colour_cast_is_found() {
        let cast = [0.5f32, 1.0, 0.25];
        let (width, height) = (64, 64);
        let data = (0..width * height)
            .map(|k| {
                let (x, y) = (k % width, k / width);
                cast[Cfa::Bggr.colour(x, y)] * (0.2 + 0.6 * (x / 16) as f32 / 4.0)
            })
            .collect();
        let gains = estimate_gains(&Mosaic { width, height, data }, Cfa::Bggr);
        for c in 0..3 {
            assert!((gains[c] * cast[c] - 1.0).abs() < 1e-3, "{gains:?}");
        }
        let dark = Mosaic { width, height, data: vec![0.0; width * height] };
        assert_eq!(estimate_gains(&dark, Cfa::Bggr), [1.0; 3]);
    }
}
