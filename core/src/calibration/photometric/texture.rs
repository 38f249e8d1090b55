//! Whether a scene shows in an image given as white: neighbouring micro-images of an evenly lit surface are equally
//! bright but for noise and the smooth fall-off of the main lens; those of a scene are not.
//!
//! The light of each micro-image is taken from the middle of it, twice, from two halves of its pixels: what both halves
//! have in common is no noise. It is compared with the mean of the two lenslets on either side, which leaves out any
//! linear change of light.

use std::collections::HashMap;

use rayon::prelude::*;

use crate::calibration::model::{Lattice, Lenslet};
use crate::calibration::sensor_image::SensorImage;

/// Radius of the middle of a micro-image, pitches.
/// Source: chosen.
const MIDDLE: f64 = 0.22;
/// Distance of the lenslets that are compared, as a share of the number of lenslets across the sensor, at most
/// [`FARTHEST`].
/// Source: chosen.
const APART: f64 = 1.0 / 16.0;
/// Largest distance of the lenslets that are compared.
/// Source: chosen.
const FARTHEST: i32 = 4;
/// Light (share of the mean) below which lenslets are not compared.
/// Source: chosen.
const DIM: f64 = 0.05;
/// Variance of the difference of one from the mean of two, that of one being 1.
const OF_DIFFERENCE: f64 = 1.5;

/// Standard deviation of the light of a lenslet about that of its neighbours, relative to it, noise not counted: near 0
/// for a white image. `image` has a mean of 1 at every place of the 2×2 tile.
pub fn scene_texture(image: &SensorImage, lattice: &Lattice, lenslets: &[Lenslet]) -> f64 {
    let pitch = lattice.pitch();
    let radius = (MIDDLE * pitch).max(1.5);
    let across = image.width.min(image.height) as f64 / pitch;
    let step = ((across * APART) as i32).clamp(1, FARTHEST);
    let light: Vec<Option<[f64; 2]>> = lenslets.par_iter().map(|l| middle_light(image, [l.x, l.y], radius)).collect();
    let at: HashMap<(i32, i32), [f64; 2]> =
        lenslets.iter().zip(&light).filter_map(|(l, light)| Some(((l.i, l.j), (*light)?))).collect();
    let (mut sum, mut count) = (0.0, 0u64);
    for (l, own) in lenslets.iter().zip(&light) {
        // Dead lenslets are dark, and no scene.
        let lit = |light: &[f64; 2]| light[0] > DIM && light[1] > DIM;
        let Some(own) = own.filter(lit) else { continue };
        for (di, dj) in [(step, 0), (0, step)] {
            let (Some(one), Some(other)) = (at.get(&(l.i - di, l.j - dj)), at.get(&(l.i + di, l.j + dj))) else {
                continue;
            };
            if lit(one) && lit(other) {
                let around = [0, 1].map(|h| 0.5 * (one[h] + other[h]));
                let off = [0, 1].map(|h| (own[h] / around[h] - 1.0).clamp(-1.0, 1.0));
                sum += off[0] * off[1];
                count += 1;
            }
        }
    }
    if count == 0 { 0.0 } else { (sum / count as f64 / OF_DIFFERENCE).max(0.0).sqrt() }
}

/// Mean light of two halves of the pixels within `radius` of a centre, whole tiles alternating; `None` where saturated.
fn middle_light(image: &SensorImage, [cx, cy]: [f64; 2], radius: f64) -> Option<[f64; 2]> {
    let range =
        |c: f64, n: usize| ((c - radius).ceil().max(0.0) as usize, ((c + radius).floor().max(0.0) as usize).min(n - 1));
    let ((x0, x1), (y0, y1)) = (range(cx, image.width), range(cy, image.height));
    let mut sums = [[0f64; 2]; 2];
    for y in y0..=y1 {
        for x in x0..=x1 {
            if (x as f64 - cx).hypot(y as f64 - cy) > radius {
                continue;
            }
            let value = image.at(x, y);
            if value >= image.limit[(y & 1) * 2 + (x & 1)] {
                return None;
            }
            let half = &mut sums[((x >> 1) + (y >> 1)) & 1];
            half[0] += f64::from(value);
            half[1] += 1.0;
        }
    }
    (sums[0][1] > 0.0 && sums[1][1] > 0.0).then(|| sums.map(|[sum, n]| sum / n))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Grid, Size};
    use crate::random::standard_normal;
    use rand::SeedableRng;
    use rand::rngs::ChaCha8Rng;

    /// Squares of light `scene(x, y)` with noise of standard deviation `noise`; returns what is measured.
    fn measured(scene: impl Fn(f64, f64) -> f64, noise: f64) -> f64 {
        let (width, height) = (600, 500);
        let lattice = Lattice { grid: Grid::Square, origin: [250.3, 250.7], a: [10.0, 0.1], b: [-0.1, 10.0] };
        let points = lattice.points_within(Size::new(width, height), 0.0);
        let lenslets: Vec<Lenslet> = points
            .index
            .iter()
            .map(|&[i, j]| {
                let [x, y] = lattice.centre(i, j);
                Lenslet { i, j, x, y, trust: 1.0 }
            })
            .collect();
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut data = vec![0f32; width * height];
        for y in 0..height {
            for x in 0..width {
                let [u, v] = lattice.coordinates(x as f64, y as f64);
                let [cx, cy] = lattice.centre(u.round() as i32, v.round() as i32);
                let r = (x as f64 - cx).hypot(y as f64 - cy) / 10.0;
                data[y * width + x] = (scene(cx, cy) * (1.0 - 1.5 * r * r) + noise * standard_normal(&mut rng)) as f32;
            }
        }
        scene_texture(&SensorImage { width, height, data, limit: [f32::INFINITY; 4] }, &lattice, &lenslets)
    }

    #[test]
    fn scenes_are_measured_and_noise_and_vignetting_are_not() {
        let fall_off = |x: f64, y: f64| 1.0 - 0.7 * ((x - 300.0).powi(2) + (y - 250.0).powi(2)) / 152_500.0;
        assert!(measured(fall_off, 0.0) < 0.02);
        assert!(measured(fall_off, 0.2) < 0.03);
        let check = |x: f64, y: f64| if ((x / 10.0) as i32 + (y / 10.0) as i32) % 5 < 2 { 1.3 } else { 0.7 };
        let (clean, noisy) = (measured(check, 0.0), measured(check, 0.2));
        assert!(clean > 0.2 && noisy > 0.2, "{clean} {noisy}");
    }

    #[test]
    fn lenslets_that_differ_by_a_tenth_have_a_texture_of_a_tenth() {
        // The same number for all pixels of a lenslet, uniform with a standard deviation of 0.1.
        let scene = |x: f64, y: f64| {
            let mut rng =
                ChaCha8Rng::seed_from_u64((x * 100.0).round() as u64 * 1_000_003 + (y * 100.0).round() as u64);
            1.0 + 0.1 * 12f64.sqrt() * (rand::RngExt::random::<f64>(&mut rng) - 0.5)
        };
        let found = measured(scene, 0.0);
        assert!((found - 0.1).abs() < 0.01, "{found}");
    }

    #[test]
    fn light_is_that_of_two_halves_or_none() {
        let image = |limit: f32| {
            let data = (0..32).map(|k| if (k % 8 / 2 + k / 16) % 2 == 0 { 1.0 } else { 3.0 }).collect();
            SensorImage { width: 8, height: 4, data, limit: [limit; 4] }
        };
        assert_eq!(middle_light(&image(9.0), [3.5, 1.5], 2.0), Some([1.0, 3.0]));
        assert_eq!(middle_light(&image(3.0), [3.5, 1.5], 2.0), None);
        // A single tile, and no pixel of the other half.
        assert_eq!(middle_light(&image(9.0), [0.5, 0.5], 0.9), None);
    }
}
