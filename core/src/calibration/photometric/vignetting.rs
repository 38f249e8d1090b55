//! The vignetting pattern that decoding divides by: the white image itself or, without one, the mean micro-image of the
//! captures, region by region.

use rayon::prelude::*;

use crate::calibration::model::{Lattice, Vignetting};
use crate::calibration::sensor_image::SensorImage;
use crate::image::{bilinear_by_weights, bilinear_shares};

/// Fixed-point value of 1.0.
const ONE: f32 = 32768.0;
/// Regions a side of the sensor, each with its own mean micro-image.
/// Source: chosen
const REGIONS: usize = 5;

/// Bins that a lattice period is divided into: about two thirds of a pixel each, 8 to 48.
fn bins_per_period(lattice: &Lattice) -> usize {
    ((1.5 * lattice.pitch()) as usize).clamp(8, 48)
}

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

/// Mean micro-images, region by region, of a pattern whose local mean is 1, which is what ordinary captures give. The
/// illumination by the main lens cannot be separated from the scenes' and is left out. The centre of a lenslet is 1.
pub fn vignetting_from_captures(pattern: &SensorImage, lattice: &Lattice) -> Vignetting {
    let (width, height) = (pattern.width, pattern.height);
    let steps = bins_per_period(lattice);
    let cells = REGIONS * REGIONS * steps * steps;
    // Bands of rows, summed in order, so that the sums do not depend on the number of threads.
    let band = 128;
    let bands: Vec<Vec<[f32; 2]>> = (0..height.div_ceil(band))
        .into_par_iter()
        .map(|n| {
            let mut sums = vec![[0f32; 2]; cells];
            for y in n * band..((n + 1) * band).min(height) {
                for (x, &v) in pattern.row(y).iter().enumerate() {
                    if v >= pattern.limit[(y & 1) * 2 + (x & 1)] {
                        continue;
                    }
                    let region = (y * REGIONS / height) * REGIONS + x * REGIONS / width;
                    let [u, w] = cell_position(lattice, x, y);
                    for (cell, share) in bilinear_bins(steps, u, w) {
                        let sum = &mut sums[region * steps * steps + cell];
                        sum[0] += share * v;
                        sum[1] += share;
                    }
                }
            }
            sums
        })
        .collect();
    let mut sums = vec![[0f64; 2]; cells];
    for one in &bands {
        for (sum, v) in sums.iter_mut().zip(one) {
            sum[0] += f64::from(v[0]);
            sum[1] += f64::from(v[1]);
        }
    }
    let images: Vec<Vec<f32>> = sums.chunks(steps * steps).map(|one| fill_bins(one, steps)).collect();
    // Brightness at the centre of a lenslet: the lattice's integer points, where u and w are 0.
    let tops: Vec<f32> = images.iter().map(|i| sample_micro_image(i, steps, 0.0, 0.0).max(1e-3)).collect();
    let mut white = vec![0u16; width * height];
    white.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        let (r0, r1, fy) = neighbouring_regions(y, height);
        for (x, out) in row.iter_mut().enumerate() {
            let (c0, c1, fx) = neighbouring_regions(x, width);
            let [u, w] = cell_position(lattice, x, y);
            let of = |r: usize, c: usize| {
                let region = r * REGIONS + c;
                sample_micro_image(&images[region], steps, u, w) / tops[region]
            };
            let corners = [of(r0, c0), of(r0, c1), of(r1, c0), of(r1, c1)];
            *out = to_fixed_point(bilinear_by_weights(corners, fx, fy) * ONE);
        }
    });
    Vignetting { width, height, white }
}

/// Position within the lattice's cell, 0 to 1 along a and b.
fn cell_position(lattice: &Lattice, x: usize, y: usize) -> [f64; 2] {
    lattice.coordinates(x as f64, y as f64).map(|v| v.rem_euclid(1.0))
}

/// The four bins around a position and their bilinear weights; periodic, the bins' centres are at half steps.
#[inline]
fn bilinear_bins(steps: usize, u: f64, w: f64) -> [(usize, f32); 4] {
    let (pu, pw) = (u * steps as f64 + steps as f64 - 0.5, w * steps as f64 + steps as f64 - 0.5);
    let (u0, w0) = (pu as usize, pw as usize);
    let (fu, fw) = ((pu - u0 as f64) as f32, (pw - w0 as f64) as f32);
    let at = |w: usize, u: usize| (w % steps) * steps + u % steps;
    let bins = [at(w0, u0), at(w0, u0 + 1), at(w0 + 1, u0), at(w0 + 1, u0 + 1)];
    let shares = bilinear_shares(fu, fw);
    std::array::from_fn(|k| (bins[k], shares[k]))
}

fn sample_micro_image(image: &[f32], steps: usize, u: f64, w: f64) -> f32 {
    bilinear_bins(steps, u, w).iter().map(|&(cell, share)| share * image[cell]).sum()
}

/// Means of the bins. Bins with few or no pixels, which occur where lattice and pixel raster are commensurate, are
/// smoothed towards their neighbours.
fn fill_bins(sums: &[[f64; 2]], steps: usize) -> Vec<f32> {
    let total: [f64; 2] = sums.iter().fold([0.0; 2], |s, v| [s[0] + v[0], s[1] + v[1]]);
    if total[1] <= 0.0 {
        return vec![1.0; sums.len()];
    }
    let usual = 0.1 * total[1] / sums.len() as f64;
    let mut values: Vec<f64> =
        sums.iter().map(|s| if s[1] > 0.0 { s[0] / s[1] } else { total[0] / total[1] }).collect();
    for _ in 0..2 * steps {
        values = (0..sums.len())
            .map(|k| {
                let (r, c) = (k / steps, k % steps);
                let around = values[(r + 1) % steps * steps + c]
                    + values[(r + steps - 1) % steps * steps + c]
                    + values[r * steps + (c + 1) % steps]
                    + values[r * steps + (c + steps - 1) % steps];
                (sums[k][0] + usual * 0.25 * around) / (sums[k][1] + usual)
            })
            .collect();
    }
    values.into_iter().map(|v| v as f32).collect()
}

/// The regions on either side of a pixel, and the weight of the second, 0 to 1.
fn neighbouring_regions(p: usize, length: usize) -> (usize, usize, f32) {
    let at = ((p as f64 + 0.5) / length as f64 * REGIONS as f64 - 0.5).clamp(0.0, (REGIONS - 1) as f64);
    let low = at as usize;
    (low, (low + 1).min(REGIONS - 1), (at - low as f64) as f32)
}
