//! Algorithm 1, procedure 1, "find local maxima in the frequency domain": Hann-windowed power spectrum, averaged over
//! crops.

use rayon::prelude::*;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex;

use crate::calibration::sensor_image::SensorImage;

/// Largest side of a crop, pixels. The phases over the whole sensor refine the peaks afterwards.
/// Source: chosen; larger crops locate peaks better and take longer
const LARGEST: usize = 512;

/// Power over a square of `side` bins; frequency (0,0) is at (0,0), negative ones at the end.
#[derive(Debug, Clone)]
pub struct Spectrum {
    /// Bins a side.
    pub side: usize,
    /// `side²` values, row-major.
    pub power: Vec<f32>,
}

/// A local maximum of the spectrum, refined below a bin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Frequency (x, y) in cycles per pixel.
    pub frequency: [f64; 2],
    /// Power.
    pub power: f64,
    /// Power over the median power at that distance from zero frequency.
    pub prominence: f64,
}

impl Spectrum {
    /// Power at integer bins, wrapped around.
    #[inline]
    pub fn at(&self, kx: i64, ky: i64) -> f32 {
        let n = self.side as i64;
        self.power[(ky.rem_euclid(n) * n + kx.rem_euclid(n)) as usize]
    }
}

/// Largest size ≤ `limit` whose only prime factors are 2, 3 and 5 (the FFT's fast sizes), even.
pub fn fft_size(limit: usize) -> usize {
    (1..=limit / 2)
        .rev()
        .map(|h| h * 2)
        .find(|&n| {
            let mut m = n;
            for p in [2, 3, 5] {
                while m % p == 0 {
                    m /= p;
                }
            }
            m == 1
        })
        .unwrap_or(limit)
}

/// Mean power spectrum of up to nine Hann-windowed crops spread over the image, each divided by its own mean.
pub fn power_spectrum(image: &SensorImage) -> Spectrum {
    let side = fft_size(image.width.min(image.height).min(LARGEST));
    let places = |length: usize| -> Vec<usize> {
        let room = length - side;
        match room / (side / 2) {
            0 => vec![room / 2],
            1 => vec![0, room],
            // Near the centre of each third: the corners of a sensor are the darkest.
            _ => vec![room / 6, room / 2, room - room / 6],
        }
    };
    let crops: Vec<(usize, usize)> =
        places(image.height).iter().flat_map(|&y| places(image.width).into_iter().map(move |x| (x, y))).collect();
    let powers: Vec<Vec<f32>> = crops.par_iter().map(|&(x, y)| crop_power(image, x, y, side)).collect();
    let mut power = vec![0f32; side * side];
    for one in &powers {
        for (sum, v) in power.iter_mut().zip(one) {
            *sum += v / powers.len() as f32;
        }
    }
    Spectrum { side, power }
}

fn crop_power(image: &SensorImage, x0: usize, y0: usize, side: usize) -> Vec<f32> {
    let window: Vec<f32> =
        (0..side).map(|k| 0.5 - 0.5 * (2.0 * std::f32::consts::PI * (k as f32 + 0.5) / side as f32).cos()).collect();
    let mut sum = 0f64;
    for y in 0..side {
        sum += image.row(y0 + y)[x0..x0 + side].iter().map(|&v| f64::from(v)).sum::<f64>();
    }
    let mean = (sum / (side * side) as f64).max(1e-9) as f32;
    let mut data: Vec<Complex<f32>> = Vec::with_capacity(side * side);
    for y in 0..side {
        let row = &image.row(y0 + y)[x0..x0 + side];
        data.extend(row.iter().zip(&window).map(|(&v, &w)| Complex::new((v / mean - 1.0) * w * window[y], 0.0)));
    }
    let fft = FftPlanner::new().plan_fft_forward(side);
    fft.process(&mut data);
    let mut turned = vec![Complex::new(0.0, 0.0); side * side];
    for y in 0..side {
        for x in 0..side {
            turned[x * side + y] = data[y * side + x];
        }
    }
    fft.process(&mut turned);
    let norm = 1.0 / (side * side) as f32;
    // `turned` is transposed: put power back in (ky, kx) order.
    let mut power = vec![0f32; side * side];
    for x in 0..side {
        for y in 0..side {
            power[y * side + x] = turned[x * side + y].norm_sqr() * norm;
        }
    }
    power
}

/// Local maxima with frequencies between `lowest` and `highest` cycles per pixel, strongest first, at most `most`.
/// Of each pair ±f only the one with y > 0 (or y = 0, x > 0) is given.
pub fn spectral_peaks(spectrum: &Spectrum, lowest: f64, highest: f64, most: usize) -> Vec<Peak> {
    let n = spectrum.side as i64;
    let half = ((highest * n as f64).ceil() as i64).min(n / 2 - 2);
    // The median at each distance from zero frequency: scenes and dust are strong near zero and must not count as
    // peaks.
    let mut rings: Vec<Vec<f32>> = vec![Vec::new(); (half as usize * 3) / 2 + 2];
    let mut found = Vec::new();
    for ky in 0..=half {
        for kx in -half..=half {
            let ring = (kx as f64).hypot(ky as f64).round() as usize;
            let v = spectrum.at(kx, ky);
            if let Some(r) = rings.get_mut(ring) {
                r.push(v);
            }
            let f = (kx as f64).hypot(ky as f64) / n as f64;
            if f < lowest || f > highest || (ky == 0 && kx < 0) {
                continue;
            }
            let top = (-1..=1).all(|dy| (-1..=1).all(|dx| (dx, dy) == (0, 0) || spectrum.at(kx + dx, ky + dy) <= v));
            if top && v > 0.0 {
                found.push((kx, ky, v, ring));
            }
        }
    }
    let floors: Vec<f64> = rings
        .iter_mut()
        .map(|r| {
            r.sort_by(f32::total_cmp);
            r.get(r.len() / 2).map_or(0.0, |&v| f64::from(v))
        })
        .collect();
    found.sort_by(|a, b| b.2.total_cmp(&a.2).then(a.1.cmp(&b.1)).then(a.0.cmp(&b.0)));
    found.truncate(most);
    found
        .into_iter()
        .map(|(kx, ky, v, ring)| {
            let offset = |dx: i64, dy: i64| {
                let log = |v: f32| f64::from(v.max(f32::MIN_POSITIVE)).ln();
                let (before, at, after) =
                    (log(spectrum.at(kx - dx, ky - dy)), log(v), log(spectrum.at(kx + dx, ky + dy)));
                let bend = before - 2.0 * at + after;
                if bend < 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 }
            };
            Peak {
                frequency: [(kx as f64 + offset(1, 0)) / n as f64, (ky as f64 + offset(0, 1)) / n as f64],
                power: f64::from(v),
                prominence: f64::from(v) / floors.get(ring).copied().unwrap_or(0.0).max(1e-30),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(side: usize, f: [f64; 2]) -> SensorImage {
        let data = (0..side * side)
            .map(|k| {
                let (x, y) = ((k % side) as f64, (k / side) as f64);
                (1.0 + 0.5 * (2.0 * std::f64::consts::PI * (f[0] * x + f[1] * y)).cos()) as f32
            })
            .collect();
        SensorImage { width: side, height: side, data, limit: [f32::MAX; 4] }
    }

    #[test]
    fn sizes_are_products_of_small_primes() {
        assert_eq!([fft_size(3280), fft_size(512), fft_size(161), fft_size(77)], [3240, 512, 160, 72]);
    }

    #[test]
    fn fast_transform_agrees_with_the_sum_written_out() {
        let image = wave(64, [0.11, 0.07]);
        let fast = power_spectrum(&image);
        let n = 64usize;
        let hann = |k: usize| 0.5 - 0.5 * (2.0 * std::f64::consts::PI * (k as f64 + 0.5) / n as f64).cos();
        let mean = image.data.iter().map(|&v| f64::from(v)).sum::<f64>() / (n * n) as f64;
        for (kx, ky) in [(7i64, 4i64), (0, 0), (-3, 5), (8, 4)] {
            let mut sum = Complex::new(0f64, 0.0);
            for y in 0..n {
                for x in 0..n {
                    let turn = -2.0 * std::f64::consts::PI * (kx as f64 * x as f64 + ky as f64 * y as f64) / n as f64;
                    sum += Complex::from_polar((f64::from(image.at(x, y)) / mean - 1.0) * hann(x) * hann(y), turn);
                }
            }
            let slow = sum.norm_sqr() / (n * n) as f64;
            assert!((f64::from(fast.at(kx, ky)) - slow).abs() < 1e-4 * (1.0 + slow), "{kx},{ky}");
        }
    }

    #[test]
    fn a_wave_is_found_below_a_bin() {
        for f in [[0.1013, 0.0], [0.0377, 0.0791], [-0.0713, 0.1017]] {
            let found = spectral_peaks(&power_spectrum(&wave(512, f)), 0.02, 0.25, 5);
            let p = found[0].frequency;
            assert!((p[0] - f[0]).hypot(p[1] - f[1]) * 512.0 < 0.05, "{f:?} found at {p:?}");
            assert!(found[0].prominence > 1e3);
        }
    }
}
