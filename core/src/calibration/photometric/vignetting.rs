//! The vignetting pattern that decoding divides by: the white image itself or, where its own texture would ruin pictures and
//! without one, the mean micro-image, which changes smoothly over the sensor.

use rayon::prelude::*;

use super::micro_image::MicroImages;
use crate::calibration::model::{Lattice, Vignetting};
use crate::calibration::sensor_image::SensorImage;

/// Fixed-point value of 1.0.
const ONE: f32 = 32768.0;

/// The white image, scaled so that `full` (light at a lenslet centre under full illumination) is 1.
pub fn vignetting_from_white(image: &SensorImage, full: f64) -> Vignetting {
    let scale = ONE / full as f32;
    Vignetting {
        width: image.width,
        height: image.height,
        white: image.data.par_iter().map(|&v| to_fixed_point(v * scale)).collect(),
    }
}

fn to_fixed_point(v: f32) -> u16 {
    v.round().clamp(0.0, 65535.0) as u16
}

/// Mean micro-images of a pattern whose local mean is 1, which is what ordinary captures give. The illumination by the main
/// lens cannot be separated from the scenes' and is left out. The centre of a lenslet is 1.
pub fn vignetting_from_captures(pattern: &SensorImage, lattice: &Lattice) -> Vignetting {
    vignetting_from_pattern(pattern, lattice, |_, _| 1.0)
}

/// Mean micro-images of a white image times `light`, the smooth illumination by the main lens as a share of full light:
/// what it shows besides (scenes, noise) is left out.
pub fn vignetting_from_pattern(
    image: &SensorImage,
    lattice: &Lattice,
    light: impl Fn(f64, f64) -> f64 + Sync,
) -> Vignetting {
    let images = MicroImages::mean_of(image, lattice, &light);
    let (width, height) = (image.width, image.height);
    let mut white = vec![0u16; width * height];
    white.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, out) in row.iter_mut().enumerate() {
            *out = to_fixed_point(images.light_at(x, y) * light(x as f64, y as f64) as f32 * ONE);
        }
    });
    Vignetting { width, height, white }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Size;

    /// Micro-images of a hexagonal lattice: 1 at the centre, a third at the rim.
    fn pattern(lattice: &Lattice, size: Size, light: impl Fn(f64, f64) -> f64) -> SensorImage {
        let Size { width, height } = size;
        let centres = lattice.points_within(size, 12.0).centres;
        let data = (0..width * height)
            .map(|k| {
                let (x, y) = ((k % width) as f64, (k / width) as f64);
                let r2 = centres.iter().map(|c| (c[0] - x).powi(2) + (c[1] - y).powi(2)).fold(f64::INFINITY, f64::min);
                ((1.0 - 0.02 * r2) * light(x, y)) as f32
            })
            .collect();
        SensorImage { width, height, data, limit: [f32::INFINITY; 4] }
    }

    #[test]
    fn full_light_is_one_in_fixed_point() {
        let image = SensorImage { width: 3, height: 1, data: vec![0.5, 0.25, 3.0], limit: [4.0; 4] };
        let found = vignetting_from_white(&image, 0.5);
        assert_eq!((found.width, found.height, found.white), (3, 1, vec![32768, 16384, 65535]));
        assert_eq!((to_fixed_point(-3.0), to_fixed_point(7.5)), (0, 8));
    }

    #[test]
    fn the_pattern_of_a_white_image_comes_back_without_its_noise() {
        let size = Size::new(160, 120);
        let lattice = Lattice::hexagonal(10.0, 0.01, 1.0, [79.0, 61.0]);
        let light = |x: f64, _: f64| 0.9 - 0.002 * x;
        let clean = pattern(&lattice, size, light);
        let found = vignetting_from_pattern(&clean, &lattice, light);
        let mut worst = 0f64;
        for (k, (&v, &truth)) in found.white.iter().zip(&clean.data).enumerate() {
            let (x, y) = (k % 160, k / 160);
            if (12..148).contains(&x) && (12..108).contains(&y) {
                worst = worst.max((f64::from(v) / 32768.0 - f64::from(truth)).abs());
            }
        }
        assert!(worst < 0.12, "{worst}");
        let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / (160.0 * 120.0);
        let (a, b) = (
            mean(&mut found.white.iter().map(|&v| f64::from(v) / 32768.0)),
            mean(&mut clean.data.iter().map(|&v| f64::from(v))),
        );
        assert!((a / b - 1.0).abs() < 0.03, "{a} {b}");
        let flat = vignetting_from_captures(&pattern(&lattice, size, |_, _| 1.0), &lattice);
        let centre = flat.white[61 * 160 + 79];
        assert!((f64::from(centre) / 32768.0 - 1.0).abs() < 0.05, "{centre}");
    }
}
