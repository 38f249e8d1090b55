//! Colour of samples: the camera's matrix and exposure.

use ndarray::Array3;
use rayon::prelude::*;

use crate::container::{CameraFacts, CameraProfile};

/// Multiplies every colour of `values` (…, …, 3) by `matrix` (row-major, rows = output R, G, B).
pub(super) fn apply_matrix(values: &mut Array3<f32>, matrix: &[f32; 9]) {
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

/// The exposure bias (EV) that gives a capture its intended brightness: that of the file plus `exposure_offset` of the
/// camera's profile; 0 where the file has none.
pub(super) fn exposure_bias(camera: &CameraFacts) -> f32 {
    let Some(stated) = camera.exposure_bias else { return 0.0 };
    let known = camera.model.as_deref().and_then(CameraProfile::of_model);
    let offset = known.map_or(0.0, |p| p.sensor.exposure_offset);
    ((stated + offset) as f32).clamp(-8.0, 8.0)
}

/// Multiplies by 2^`ev`.
pub(super) fn brighten(values: &mut Array3<f32>, ev: f32) {
    if ev != 0.0 {
        let factor = ev.exp2();
        values.mapv_inplace(|v| v * factor);
    }
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
}
