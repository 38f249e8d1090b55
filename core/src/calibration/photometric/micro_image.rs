//! The mean micro-image, a smooth function of the place on the sensor.
//!
//! A lenslet's cell is divided into bins. The mean of the pixels that fall into a bin, taken over regions of the sensor,
//! follows a polynomial over the sensor, bin by bin: all lenslets determine it, so that neither the scenes of single regions
//! nor noise stay in it, and it has no seams.

use crate::geometry::Size;
use rayon::prelude::*;

use crate::calibration::model::Lattice;
use crate::calibration::sensor_image::SensorImage;
use crate::image::bilinear_shares;
use crate::linalg::gauss_with_back_substitution;

/// Regions a side of the sensor, whose means the polynomials are fitted to.
/// Source: chosen; more of them change nothing.
const REGIONS: usize = 9;
/// Terms of the polynomials over the sensor: degree 2.
/// Source: chosen: pupil shift is linear and cat's-eye vignetting quadratic at first order; higher degrees follow scenes.
const TERMS: usize = 6;
/// Weight of a flat field, as a share of the pixels of a bin.
/// Source: chosen: it decides only where lenslets are few.
const FLAT: f64 = 0.01;
/// Bins a pixel.
/// Source: chosen: bilinear bins of two thirds of a pixel and more flatten the micro-image.
const BINS_PER_PIXEL: f64 = 2.4;

/// Bins that a lattice period is divided into, 8 to 48.
fn bins_per_period(lattice: &Lattice) -> usize {
    ((BINS_PER_PIXEL * lattice.pitch()) as usize).clamp(8, 48)
}

/// Mean micro-images over a sensor: a polynomial a bin.
pub struct MicroImages<'a> {
    lattice: &'a Lattice,
    size: Size,
    steps: usize,
    /// Coefficients of each bin.
    bins: Vec<[f32; TERMS]>,
}

impl<'a> MicroImages<'a> {
    /// The means of `image` divided by `light`.
    pub fn mean_of(image: &SensorImage, lattice: &'a Lattice, light: &(impl Fn(f64, f64) -> f64 + Sync)) -> Self {
        let steps = bins_per_period(lattice);
        let sums = region_sums(image, lattice, steps, light);
        let size = Size::new(image.width, image.height);
        let mut total = vec![[0f64; 2]; steps * steps];
        for region in sums.chunks_exact(steps * steps) {
            for (t, s) in total.iter_mut().zip(region) {
                *t = [t[0] + s[0], t[1] + s[1]];
            }
        }
        let mean = fill_bins(&total, steps);
        let bins = (0..steps * steps).map(|bin| fit_bin(&sums, steps * steps, bin, mean[bin])).collect();
        MicroImages { lattice, size, steps, bins }
    }

    /// Light at a pixel as a share of that at the centre of a lenslet there.
    pub fn light_at(&self, x: usize, y: usize) -> f32 {
        let unit = |p: usize, n: usize| (2.0 * (p as f64 + 0.5) / n as f64 - 1.0) as f32;
        let terms = terms_at(unit(x, self.size.width), unit(y, self.size.height));
        let [u, w] = cell_position(self.lattice, x, y);
        (self.read(&terms, u, w) / self.read(&terms, 0.0, 0.0).max(1e-3)).max(0.0)
    }

    #[inline]
    fn read(&self, terms: &[f32; TERMS], u: f64, w: f64) -> f32 {
        let bin = |cell: usize| self.bins[cell].iter().zip(terms).map(|(c, t)| c * t).sum::<f32>();
        bilinear_bins(self.steps, u, w).into_iter().map(|(cell, share)| share * bin(cell)).sum()
    }
}

#[inline]
fn terms_at(x: f32, y: f32) -> [f32; TERMS] {
    [1.0, x, y, x * x - 1.0 / 3.0, x * y, y * y - 1.0 / 3.0]
}

/// Sums of light and of shares by region and bin.
fn region_sums(
    image: &SensorImage,
    lattice: &Lattice,
    steps: usize,
    light: &(impl Fn(f64, f64) -> f64 + Sync),
) -> Vec<[f64; 2]> {
    let (width, height) = (image.width, image.height);
    // A row of regions each, so that the sums do not depend on the number of threads.
    let band = |r: usize| {
        let mut sums = vec![[0f64; 2]; REGIONS * steps * steps];
        for y in (r * height).div_ceil(REGIONS)..((r + 1) * height).div_ceil(REGIONS) {
            for (x, &v) in image.row(y).iter().enumerate() {
                let here = light(x as f64, y as f64);
                if v >= image.limit[(y & 1) * 2 + (x & 1)] || here <= 0.0 {
                    continue;
                }
                let first = x * REGIONS / width * steps * steps;
                let [u, w] = cell_position(lattice, x, y);
                for (cell, share) in bilinear_bins(steps, u, w) {
                    let sum = &mut sums[first + cell];
                    sum[0] += f64::from(share) * f64::from(v) / here;
                    sum[1] += f64::from(share);
                }
            }
        }
        sums
    };
    (0..REGIONS).into_par_iter().map(band).collect::<Vec<_>>().concat()
}

/// The polynomial nearest to the regions' means of one bin, towards `mean` where they are few.
fn fit_bin(sums: &[[f64; 2]], bins: usize, bin: usize, mean: f32) -> [f32; TERMS] {
    const N: usize = TERMS + 1;
    let mut system = [0f64; TERMS * N];
    let mut weight = 0.0;
    for (region, s) in sums.iter().skip(bin).step_by(bins).enumerate() {
        let middle = |k: usize| 2.0 * (k as f32 + 0.5) / REGIONS as f32 - 1.0;
        let terms = terms_at(middle(region % REGIONS), middle(region / REGIONS)).map(f64::from);
        for i in 0..TERMS {
            for j in 0..TERMS {
                system[i * N + j] += s[1] * terms[i] * terms[j];
            }
            system[i * N + TERMS] += terms[i] * (s[0] - s[1] * f64::from(mean));
        }
        weight += s[1];
    }
    for i in 0..TERMS {
        system[i * N + i] += FLAT * weight + 1e-9;
    }
    let mut found = [0f32; TERMS];
    if gauss_with_back_substitution(&mut system, TERMS, N, 1e-12).is_some() {
        (0..TERMS).for_each(|i| found[i] = system[i * N + TERMS] as f32);
    }
    found[0] += mean;
    found
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Grid;

    /// Discs of light whose middle moves with the place on the sensor, under scenes that differ from place to place.
    #[test]
    fn the_micro_image_is_found_under_scenes_and_moves_with_the_place() {
        let (width, height) = (900, 800);
        let lattice = Lattice { grid: Grid::HexRows, origin: [449.6, 400.3], a: [9.93, 0.02], b: [4.95, 8.6] };
        let disc = |x: f64, y: f64| {
            let [i, j] = lattice.coordinates(x, y);
            let mut best = f64::INFINITY;
            for (di, dj) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
                let c = lattice.centre((i.floor() + di) as i32, (j.floor() + dj) as i32);
                let shift = [(c[0] - 450.0) / 900.0, (c[1] - 400.0) / 900.0];
                best = best.min((x - c[0] - shift[0]).powi(2) + (y - c[1] - shift[1]).powi(2));
            }
            1.0 - 0.8 * best / 24.6
        };
        let scene = |x: f64, y: f64| 1.0 + 0.3 * (x / 31.0).sin() * (y / 23.0).cos();
        let data = (0..width * height).map(|k| ((k % width) as f64, (k / width) as f64));
        let data = data.map(|(x, y)| (disc(x, y) * scene(x, y)) as f32).collect();
        let image = SensorImage { width, height, data, limit: [f32::INFINITY; 4] };
        let found = MicroImages::mean_of(&image, &lattice, &|_, _| 1.0);
        let (mut sum, mut n) = (0.0, 0);
        for y in (20..height - 20).step_by(7) {
            for x in (20..width - 20).step_by(5) {
                let [i, j] = lattice.coordinates(x as f64, y as f64).map(f64::round);
                let c = lattice.centre(i as i32, j as i32);
                let full = disc(c[0], c[1]);
                let r = (x as f64 - c[0]).hypot(y as f64 - c[1]);
                if r < 3.5 {
                    sum += (f64::from(found.light_at(x, y)) - disc(x as f64, y as f64) / full).powi(2);
                    n += 1;
                }
            }
        }
        let rms = (sum / f64::from(n)).sqrt();
        assert!(rms < 0.01, "{rms}");
    }

    #[test]
    fn saturated_pixels_are_left_out_by_the_limit_of_their_place() {
        let lattice = Lattice { grid: Grid::Square, origin: [20.0, 20.0], a: [10.0, 0.0], b: [0.0, 10.0] };
        for place in 0..4 {
            let mut limit = [1.0; 4];
            limit[place] = 0.5;
            let image = SensorImage { width: 40, height: 40, data: vec![0.75; 1600], limit };
            let sums = region_sums(&image, &lattice, 8, &|x, y| {
                // Nothing is left at the place, and all of the others.
                if (y as usize & 1) * 2 + (x as usize & 1) == place { 1000.0 } else { 1.0 }
            });
            let [light, shares] = sums.iter().fold([0.0; 2], |t, s| [t[0] + s[0], t[1] + s[1]]);
            assert!((shares - 1200.0).abs() < 0.01 && (light - 900.0).abs() < 0.01, "{place}: {light} {shares}");
        }
    }

    #[test]
    fn a_bin_follows_the_regions() {
        // Light 2 + x over a sensor from −1 to 1.
        let middle = |k: usize| (2 * k + 1) as f64 / REGIONS as f64 - 1.0;
        let sums: Vec<[f64; 2]> = (0..REGIONS * REGIONS).map(|r| [2.0 + middle(r % REGIONS), 1.0]).collect();
        let found = fit_bin(&sums, 1, 0, 2.0);
        assert!((found[0] - 2.0).abs() < 0.01 && (found[1] - 1.0).abs() < 0.05, "{found:?}");
        assert!(found[2..].iter().all(|c| c.abs() < 0.01), "{found:?}");
    }

    #[test]
    fn an_empty_bin_takes_the_mean_of_its_neighbours() {
        // Rows of 0, 1, 2 and 3, and one bin of the row of 2 without a pixel.
        let mut sums: Vec<[f64; 2]> = (0..16).map(|k| [(k / 4) as f64, 1.0]).collect();
        sums[9] = [0.0; 2];
        let found = fill_bins(&sums, 4);
        assert!((found[9] - 2.0).abs() < 0.05, "{found:?}");
    }
}
