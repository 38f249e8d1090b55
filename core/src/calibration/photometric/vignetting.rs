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
