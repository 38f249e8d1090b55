//! Algorithm 1, "contrast stretching": the darkest and brightest hundredths of the image become 0 and 1.

use crate::calibration::sensor_image::SensorImage;

/// Share of pixels clipped at each end.
/// Source: chosen; the paper gives none
const CLIPPED: f64 = 0.01;
/// Bins of the histogram.
/// Source: chosen
const STEPS: usize = 4096;

/// Stretches the values so that all but a hundredth at each end fill 0 to 1; a constant image stays as it is.
pub fn stretch_contrast(image: &mut SensorImage) {
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for &v in &image.data {
        low = low.min(v);
        high = high.max(v);
    }
    if !(low.is_finite() && high > low) {
        return;
    }
    let scale = (STEPS - 1) as f32 / (high - low);
    let mut counts = vec![0usize; STEPS];
    for &v in &image.data {
        counts[((v - low) * scale) as usize] += 1;
    }
    let clipped = (image.data.len() as f64 * CLIPPED) as usize;
    let step = |n: usize| low + n as f32 / scale;
    let mut sum = 0;
    let bottom = step(
        counts
            .iter()
            .position(|c| {
                sum += c;
                sum > clipped
            })
            .unwrap_or(0),
    );
    sum = 0;
    let top = step(
        STEPS
            - 1
            - counts
                .iter()
                .rev()
                .position(|c| {
                    sum += c;
                    sum > clipped
                })
                .unwrap_or(0),
    );
    let gain = 1.0 / (top - bottom).max(1e-6);
    for v in &mut image.data {
        *v = ((*v - bottom) * gain).clamp(0.0, 1.0);
    }
    image.limit = [f32::INFINITY; 4];
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_are_clipped_and_the_rest_fills_the_range() {
        let data: Vec<f32> = (0..10_000).map(|k| 3.0 + 0.0002 * k as f32).collect();
        let mut image = SensorImage { width: 100, height: 100, data, limit: [1.0; 4] };
        stretch_contrast(&mut image);
        assert!(image.data[..90].iter().all(|&v| v == 0.0) && image.data[9910..].iter().all(|&v| v == 1.0));
        // A hundredth at each end and no more; between them a straight line.
        assert!(image.data[110] > 0.0 && image.data[9889] < 1.0);
        for (k, &v) in image.data.iter().enumerate().skip(110).take(9780) {
            assert!((v - (k as f32 - 100.0) / 9800.0).abs() < 0.001, "{k}: {v}");
        }
        assert_eq!(image.limit, [f32::INFINITY; 4]);
        // One far value does not decide the range.
        let mut spike =
            SensorImage { width: 100, height: 1, data: (0..100).map(|k| k as f32).collect(), limit: [1.0; 4] };
        spike.data[99] = 10_000.0;
        stretch_contrast(&mut spike);
        assert!(spike.data[98] > 0.9, "{}", spike.data[98]);
        let mut flat = SensorImage { width: 2, height: 1, data: vec![0.4; 2], limit: [1.0; 4] };
        stretch_contrast(&mut flat);
        assert_eq!(flat.data, [0.4; 2]);
    }

    #[test]
    fn a_small_range_far_from_zero_is_stretched_as_well() {
        let data: Vec<f32> = (0..10_000).map(|k| 1000.0 + k as f32 / 1024.0).collect();
        let mut image = SensorImage { width: 100, height: 100, data, limit: [1.0; 4] };
        stretch_contrast(&mut image);
        for (k, &v) in image.data.iter().enumerate() {
            assert!((v - ((k as f32 - 100.0) / 9800.0).clamp(0.0, 1.0)).abs() < 0.005, "{k}: {v}");
        }
    }
}
