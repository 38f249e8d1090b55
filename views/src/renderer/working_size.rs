//! The size at which views are reconstructed when a dictionary was trained for another pitch.

use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::sampling::MAX_PIXELS;

use crate::target::view_pitch;

/// Relative difference between the pitch of the views and that of a dictionary up to which the dictionary is used as it
/// is.
///
/// Source: chosen.
const PITCH_TOLERANCE: f64 = 0.1;

/// The size at which views of `target` are reconstructed, given the pitch of the samples on the sensor and that of the
/// model (`trained`, pixels): `target`, or the size at which the samples lie `trained` pixels apart.
#[must_use]
pub fn working_size(samples: &HexSamples, target: &Size, trained: f64) -> Size {
    let actual = view_pitch(samples, target.width);
    let ratio = trained / actual;
    if !ratio.is_finite() || (ratio - 1.0).abs() <= PITCH_TOLERANCE {
        return *target;
    }
    let side = |n: usize| ((n as f64 * ratio).round().max(1.0)) as usize;
    let (width, height) = (side(target.width), side(target.height));
    if width.checked_mul(height).is_some_and(|n| n <= MAX_PIXELS) { Size { width, height } } else { *target }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    #[test]
    fn views_of_another_pitch_are_reconstructed_at_the_trained_one() {
        let lenslets = 30 * 30;
        let samples = HexSamples {
            sensor: Size::new(300, 300),
            centres: vec![[0.0, 0.0]; lenslets],
            index: vec![[0, 0]; lenslets],
            views: 1,
            view_step: 1.0,
            weights: vec![1.0],
            values: Array3::zeros((1, lenslets, 1)),
        };
        let sensor_pitch = crate::target::mean_pitch(&samples);
        let at = |width| Size { width, height: width };
        let fit = (3.293 * 300.0 / sensor_pitch).round() as usize;
        assert_eq!(working_size(&samples, &at(fit), 3.293), at(fit));
        assert_eq!(working_size(&samples, &at(fit + 5), 3.293), at(fit + 5));
        let working = working_size(&samples, &at(2 * fit), 3.293);
        assert!(working.width.abs_diff(fit) <= 1);
    }
}
