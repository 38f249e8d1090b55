//! What the pixels do to the light before it is counted: crosstalk and a response that bends below saturation.

use rayon::prelude::*;

use super::camera::Camera;

/// The signal (share of full scale, row-major) after crosstalk and the bend of `camera`'s imperfections. At the border
/// a pixel keeps what neighbours beyond it would have received.
pub fn disturb_signal(signal: Vec<f32>, camera: &Camera) -> Vec<f32> {
    let (crosstalk, knee) = (camera.imperfections.crosstalk as f32, camera.imperfections.saturation as f32);
    let mut signal = if crosstalk > 0.0 { mix_neighbours(&signal, camera.sensor.width, crosstalk) } else { signal };
    if knee < 1.0 {
        signal.par_iter_mut().for_each(|s| *s = bent(*s, knee));
    }
    signal
}

/// Every pixel gives `share` of its signal to each of its four neighbours.
fn mix_neighbours(signal: &[f32], width: usize, share: f32) -> Vec<f32> {
    let height = signal.len() / width.max(1);
    let mut mixed = vec![0f32; signal.len()];
    mixed.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, line)| {
        let row = |y: usize| &signal[y * width..(y + 1) * width];
        let (above, here, below) = (row(y.saturating_sub(1)), row(y), row((y + 1).min(height - 1)));
        for (x, to) in line.iter_mut().enumerate() {
            let around = here[x.saturating_sub(1)] + here[(x + 1).min(width - 1)] + above[x] + below[x];
            *to = here[x] + share * (around - 4.0 * here[x]);
        }
    });
    mixed
}

/// The response to `signal` above the knee approaches 1 and never reaches it; its slope has no jump.
fn bent(signal: f32, knee: f32) -> f32 {
    if signal <= knee {
        return signal;
    }
    let room = 1.0 - knee;
    knee + room * (1.0 - (-(signal - knee) / room).exp())
}

#[cfg(test)]
mod tests {
    use lenslet_core::geometry::Size;

    use super::*;
    use crate::simulate::Imperfections;

    fn camera(imperfections: Imperfections) -> Camera {
        Camera { sensor: Size::new(8, 6), imperfections, ..Camera::default() }
    }

    #[test]
    fn crosstalk_spreads_a_point_and_loses_nothing() {
        let camera = camera(Imperfections { crosstalk: 0.02, ..Imperfections::default() });
        let mut point = vec![0f32; 48];
        (point[2 * 8 + 3], point[0]) = (1.0, 0.5);
        let out = disturb_signal(point, &camera);
        assert!((out[19] - 0.92).abs() < 1e-6);
        for k in [18, 20, 11, 27] {
            assert!((out[k] - 0.02).abs() < 1e-6);
        }
        assert!((out[0] - 0.48).abs() < 1e-6 && (out[1] - 0.01).abs() < 1e-6 && (out[8] - 0.01).abs() < 1e-6);
        assert!((out.iter().sum::<f32>() - 1.5).abs() < 1e-5);
    }

    #[test]
    fn the_response_bends_above_the_knee_only() {
        let camera = camera(Imperfections { saturation: 0.8, ..Imperfections::default() });
        let ramp: Vec<f32> = (0..48).map(|k| k as f32 / 40.0).collect();
        let out = disturb_signal(ramp.clone(), &camera);
        for (k, (from, to)) in ramp.iter().zip(&out).enumerate() {
            if *from <= 0.8 {
                assert_eq!(from, to);
            } else {
                assert!(to < from && *to < 1.0 && to > &out[k - 1], "{from} {to}");
            }
        }
        // 1 − 0.2·e⁻¹
        assert!((out[40] - 0.926_424).abs() < 1e-5);
        assert_eq!(disturb_signal(ramp.clone(), &self::camera(Imperfections::default())), ramp);
    }
}
