//! The lattice over the whole sensor from the phases of its two fundamentals in small tiles: min over slope and offset
//! of Σ ρ(phase − slope·x − offset) for each fundamental. It is within a few hundredths of a pixel everywhere and
//! robust against dead lenslets, dust and scratches. (Beyond paper section 3.2, which rotates by the peak's bin alone.)

use rayon::prelude::*;

use super::rotation::{Fundamentals, lattice_vectors};
use crate::calibration::error::Error;
use crate::calibration::model::Lattice;
use crate::calibration::sensor_image::SensorImage;
use crate::geometry::Size;
use crate::linalg::solve_small;

/// Most tiles a side.
/// Source: chosen
const TILES: usize = 24;
/// Tile side in lattice periods.
/// Source: chosen
const PERIODS: f64 = 8.0;
/// Least coherence of the tile phases with a lattice (1 = perfect, about 1/√tiles by chance).
/// Source: chosen
const LEAST_COHERENCE: f64 = 0.5;

/// Scale of the robust fit: a residual phase of this many turns halves a tile's weight.
/// Source: chosen
const PHASE_SCALE: f64 = 0.03;

/// The lattice that fits the phases.
#[derive(Debug, Clone, Copy)]
pub struct PhaseFit {
    /// The lattice.
    pub lattice: Lattice,
    /// Coherence: length of the mean phasor of the tiles after the fit, 0 to 1, the lesser of both fundamentals.
    pub coherence: f64,
}

#[derive(Clone, Copy)]
struct Tile {
    x: f64,
    y: f64,
    z: [(f64, f64); 2],
}

/// How an image is cut into tiles.
struct Tiling {
    side: usize,
    nx: usize,
    ny: usize,
    middle: [f64; 2],
}

impl Tiling {
    fn new(image: &SensorImage, period: f64) -> Self {
        let side = ((PERIODS * period) as usize).clamp(16, image.width.min(image.height));
        let count = |length: usize| (length / side).clamp(1, TILES);
        let middle = [(image.width as f64 - 1.0) / 2.0, (image.height as f64 - 1.0) / 2.0];
        Tiling { side, nx: count(image.width), ny: count(image.height), middle }
    }

    /// Phases of every tile at both frequencies.
    fn tiles(&self, image: &SensorImage, f: &[[f64; 2]; 2]) -> Vec<Tile> {
        let (side, nx, ny) = (self.side, self.nx, self.ny);
        let corner = |k: usize, n: usize, length: usize| {
            if n == 1 { (length - side) / 2 } else { k * (length - side) / (n - 1) }
        };
        (0..nx * ny)
            .into_par_iter()
            .map(|k| {
                demodulate_tile(
                    image,
                    corner(k % nx, nx, image.width),
                    corner(k / nx, ny, image.height),
                    side,
                    f,
                    self.middle,
                )
            })
            .collect()
    }
}

/// How well the pattern of an image agrees with a lattice: 1 if every tile is in phase with it, about 0 by chance,
/// negative where the pattern lies between its lenslets.
pub fn phase_agreement(image: &SensorImage, lattice: &Lattice) -> f64 {
    use std::f64::consts::PI;
    let (a, b) = (lattice.a, lattice.b);
    let det = a[0] * b[1] - a[1] * b[0];
    let f = [[b[1] / det, -b[0] / det], [-a[1] / det, a[0] / det]];
    let tiling = Tiling::new(image, 1.0 / f[0][0].hypot(f[0][1]));
    let tiles = tiling.tiles(image, &f);
    let off = [tiling.middle[0] - lattice.origin[0], tiling.middle[1] - lattice.origin[1]];
    let along = |w: usize| {
        let (s, c) = (2.0 * PI * (f[w][0] * off[0] + f[w][1] * off[1])).sin_cos();
        tiles.iter().map(|t| t.z[w].0 * c + t.z[w].1 * s).sum::<f64>() / tiles.len() as f64
    };
    along(0).min(along(1))
}

/// Fits the lattice to the phases of its fundamentals.
///
/// # Errors
/// [`Error::NoPattern`] when the phases of the tiles do not agree on one lattice.
pub fn fit_phases(image: &SensorImage, start: &Fundamentals) -> Result<PhaseFit, Error> {
    let mut f = [start.f1, start.f2];
    let tiling = Tiling::new(image, 1.0 / f[0][0].hypot(f[0][1]));
    let (nx, ny, middle) = (tiling.nx, tiling.ny, tiling.middle);
    let mut phase = [0f64; 2];
    let mut coherence = 0.0;
    // Round one demodulates with the peaks of the spectrum, round two with the corrected frequencies.
    for _ in 0..2 {
        let tiles = tiling.tiles(image, &f);
        coherence = 1.0;
        for w in 0..2 {
            let fit = fit_phase_plane(&tiles, w, nx, ny);
            f[w][0] += fit.slope[0];
            f[w][1] += fit.slope[1];
            phase[w] = fit.phase;
            coherence = fit.coherence.min(coherence);
        }
    }
    if coherence < LEAST_COHERENCE {
        return Err(Error::NoPattern {
            reason: format!("the pattern's phases agree to {:.0} % only over the image", 100.0 * coherence),
        });
    }
    let (grid, a, b) = lattice_vectors(start.square, f[0], f[1]);
    // Light ~ cos 2π f·(p − c): the phase at the sensor's centre m is f·(m − c).
    let det = f[0][0] * f[1][1] - f[0][1] * f[1][0];
    let turns = [-phase[0], -phase[1]];
    let c = [
        middle[0] + (turns[0] * f[1][1] - turns[1] * f[0][1]) / det,
        middle[1] + (f[0][0] * turns[1] - f[1][0] * turns[0]) / det,
    ];
    let lattice = Lattice { grid, origin: c, a, b }.centred_on(Size::new(image.width, image.height));
    Ok(PhaseFit { lattice, coherence })
}

/// Phasors of one tile at both frequencies, unit length, phases referred to the sensor's centre.
fn demodulate_tile(
    image: &SensorImage,
    x0: usize,
    y0: usize,
    side: usize,
    f: &[[f64; 2]; 2],
    middle: [f64; 2],
) -> Tile {
    use std::f64::consts::PI;
    let window: Vec<f32> =
        (0..side).map(|k| 0.5 - 0.5 * (2.0 * std::f32::consts::PI * (k as f32 + 0.5) / side as f32).cos()).collect();
    let (cx, cy) = (x0 as f64 + (side as f64 - 1.0) / 2.0, y0 as f64 + (side as f64 - 1.0) / 2.0);
    let mut mean = 0f64;
    for y in 0..side {
        mean += image.row(y0 + y)[x0..x0 + side].iter().map(|&v| f64::from(v)).sum::<f64>();
    }
    let mean = (mean / (side * side) as f64) as f32;
    let z = [0, 1].map(|w| {
        let columns: Vec<(f32, f32)> = (0..side)
            .map(|x| {
                let (s, c) = (-2.0 * PI * f[w][0] * ((x0 + x) as f64 - cx)).sin_cos();
                (c as f32 * window[x], s as f32 * window[x])
            })
            .collect();
        let (mut re, mut im) = (0f64, 0f64);
        for (y, &weight) in window.iter().enumerate() {
            let row = &image.row(y0 + y)[x0..x0 + side];
            let (mut r, mut i) = (0f32, 0f32);
            for (&v, &(c, s)) in row.iter().zip(&columns) {
                r += (v - mean) * c;
                i += (v - mean) * s;
            }
            let (s, c) = (-2.0 * PI * f[w][1] * ((y0 + y) as f64 - cy)).sin_cos();
            let k = f64::from(weight);
            re += k * (f64::from(r) * c - f64::from(i) * s);
            im += k * (f64::from(r) * s + f64::from(i) * c);
        }
        // Unit length (bright and dark tiles have the same weight), rotated to the phase at the sensor's centre.
        let length = re.hypot(im).max(1e-30);
        let (s, c) = (-2.0 * PI * (f[w][0] * (cx - middle[0]) + f[w][1] * (cy - middle[1]))).sin_cos();
        ((re * c - im * s) / length, (re * s + im * c) / length)
    });
    Tile { x: cx - middle[0], y: cy - middle[1], z }
}

struct PhasePlane {
    /// Change of phase, turns per pixel.
    slope: [f64; 2],
    /// Phase at the sensor's centre, turns.
    phase: f64,
    coherence: f64,
}

/// Phase as a linear function over the sensor: slopes from neighbouring tiles first (their phases differ by less than
/// half a turn), then eight rounds of a robust fit.
fn fit_phase_plane(tiles: &[Tile], w: usize, nx: usize, ny: usize) -> PhasePlane {
    use std::f64::consts::PI;
    let mut slope = [0f64; 2];
    for (axis, step, n) in [(0, 1, nx), (1, nx, ny)] {
        let (mut re, mut im) = (0f64, 0f64);
        for k in 0..tiles.len().saturating_sub(step) {
            if axis == 0 && k % nx == nx - 1 {
                continue;
            }
            let (p, q) = (tiles[k].z[w], tiles[k + step].z[w]);
            re += p.0 * q.0 + p.1 * q.1;
            im += p.0 * q.1 - p.1 * q.0;
        }
        if n > 1 {
            let gap = if axis == 0 { tiles[1].x - tiles[0].x } else { tiles[step].y - tiles[0].y };
            slope[axis] = im.atan2(re) / (2.0 * PI * gap);
        }
    }
    let mut phase = 0.0;
    let mut weights = vec![1f64; tiles.len()];
    let mut coherence = 0.0;
    for _ in 0..8 {
        let (mut re, mut im) = (0f64, 0f64);
        let turned: Vec<(f64, f64)> = tiles
            .iter()
            .map(|t| {
                let (s, c) = (-2.0 * PI * (slope[0] * t.x + slope[1] * t.y)).sin_cos();
                (t.z[w].0 * c - t.z[w].1 * s, t.z[w].0 * s + t.z[w].1 * c)
            })
            .collect();
        for (z, &k) in turned.iter().zip(&weights) {
            re += k * z.0;
            im += k * z.1;
        }
        phase = im.atan2(re) / (2.0 * PI);
        let plain = turned.iter().fold((0f64, 0f64), |s, z| (s.0 + z.0, s.1 + z.1));
        coherence = plain.0.hypot(plain.1) / tiles.len() as f64;
        // Residual phase in turns, wrapped to ±½; then a weighted linear fit to it.
        let mut sums = [0f64; 9];
        for ((t, z), weight) in tiles.iter().zip(&turned).zip(weights.iter_mut()) {
            let rest = (z.1.atan2(z.0) / (2.0 * PI) - phase + 0.5).rem_euclid(1.0) - 0.5;
            *weight = 1.0 / (1.0 + (rest / PHASE_SCALE).powi(2));
            let k = *weight;
            for (slot, v) in sums.iter_mut().zip([
                k,
                k * t.x,
                k * t.y,
                k * t.x * t.x,
                k * t.x * t.y,
                k * t.y * t.y,
                k * rest,
                k * rest * t.x,
                k * rest * t.y,
            ]) {
                *slot += v;
            }
        }
        let [n, sx, sy, sxx, sxy, syy, r, rx, ry] = sums;
        let matrix = [[n, sx, sy], [sx, sxx, sxy], [sy, sxy, syy]];
        if nx > 1
            && ny > 1
            && let Some(fit) = solve_small(matrix, [r, rx, ry])
        {
            slope[0] += fit[1];
            slope[1] += fit[2];
            phase += fit[0];
        }
    }
    PhasePlane { slope, phase, coherence }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::model::Grid;
    use rand::{RngExt, SeedableRng};

    /// The waves of a lattice.
    fn waves(lattice: &Lattice) -> [[f64; 2]; 2] {
        let (a, b) = (lattice.a, lattice.b);
        let det = a[0] * b[1] - a[1] * b[0];
        [[b[1] / det, -b[0] / det], [-a[1] / det, a[0] / det]]
    }

    /// Light that is 1 at the lenslets of a hexagonal lattice, brighter to the right.
    fn pattern(lattice: &Lattice, width: usize, height: usize) -> SensorImage {
        let [f1, f2] = waves(lattice);
        let data = (0..width * height)
            .map(|k| {
                let (x, y) = ((k % width) as f64 - lattice.origin[0], (k / width) as f64 - lattice.origin[1]);
                let wave = |f: [f64; 2]| (2.0 * std::f64::consts::PI * (f[0] * x + f[1] * y)).cos();
                let sum = wave(f1) + wave(f2) + wave([f1[0] + f2[0], f1[1] + f2[1]]);
                ((0.4 + 0.2 * sum) * (0.5 + 0.5 * (k % width) as f64 / width as f64)) as f32
            })
            .collect();
        SensorImage { width, height, data, limit: [f32::INFINITY; 4] }
    }

    fn distance(p: [f64; 2], q: [f64; 2]) -> f64 {
        (p[0] - q[0]).hypot(p[1] - q[1])
    }

    #[test]
    fn the_lattice_of_the_waves_comes_back_from_a_rough_start() {
        for (width, height) in [(420, 300), (300, 500)] {
            let middle = [(width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0];
            let truth = Lattice::hexagonal(10.0, 0.03, 1.001, [middle[0] + 1.3, middle[1] - 2.2]);
            let image = pattern(&truth, width, height);
            let [f1, f2] = waves(&truth);
            let start = Fundamentals {
                square: false,
                f1: [f1[0] + 0.0008, f1[1] - 0.0006],
                f2: [f2[0] - 0.0005, f2[1] + 0.0007],
                prominence: 100.0,
                power: 1.0,
            };
            let found = fit_phases(&image, &start).unwrap();
            assert_eq!(found.lattice.grid, Grid::HexRows);
            assert!(found.coherence > 0.99, "{}", found.coherence);
            // Up to whole lenslets.
            let place = |l: &Lattice, p: [f64; 2]| {
                let [i, j] = l.coordinates(p[0], p[1]).map(|v| v.round() as i32);
                l.centre(i, j)
            };
            for p in [[0.0, 0.0], [width as f64, 0.0], middle, [0.0, height as f64], [width as f64, height as f64]] {
                let at = place(&truth, p);
                assert!(distance(place(&found.lattice, at), at) < 0.05, "{:?} {truth:?}", found.lattice);
            }
            assert!(distance(found.lattice.a, truth.a) < 2e-3 && distance(found.lattice.b, truth.b) < 2e-3);
        }
    }

    #[test]
    fn agreement_is_one_in_phase_and_negative_between_the_lenslets() {
        let truth = Lattice::hexagonal(10.0, 0.03, 1.001, [203.0, 151.0]);
        let image = pattern(&truth, 420, 300);
        assert!(phase_agreement(&image, &truth) > 0.99);
        // Half a period along the first wave, along the second: the lesser of both counts.
        for half in [truth.a, truth.b] {
            let between =
                Lattice { origin: [truth.origin[0] + half[0] / 2.0, truth.origin[1] + half[1] / 2.0], ..truth };
            assert!(phase_agreement(&image, &between) < -0.99);
        }
        let quarter =
            Lattice { origin: [truth.origin[0] + truth.b[0] / 4.0, truth.origin[1] + truth.b[1] / 4.0], ..truth };
        assert!(phase_agreement(&image, &quarter).abs() < 0.05);
        let other = Lattice::hexagonal(11.0, -0.05, 1.0, truth.origin);
        assert!(phase_agreement(&image, &other).abs() < 0.5);
    }

    #[test]
    fn a_small_image_is_one_tile_in_its_middle() {
        let truth = Lattice::hexagonal(10.0, 0.0, 1.0, [50.2, 49.7]);
        let image = pattern(&truth, 100, 100);
        let tiling = Tiling::new(&image, 10.0 * 0.75f64.sqrt());
        assert_eq!((tiling.side, tiling.nx, tiling.ny), (69, 1, 1));
        let tiles = tiling.tiles(&image, &waves(&truth));
        // A tile from 15 to 83; the middle of the image is at 49.5.
        assert!((tiles[0].x + 0.5).abs() < 1e-9 && (tiles[0].y + 0.5).abs() < 1e-9, "{} {}", tiles[0].x, tiles[0].y);
        assert!(phase_agreement(&image, &truth) > 0.99);
        let wide = Tiling { side: 20, nx: 3, ny: 2, middle: [49.5, 49.5] };
        let places: Vec<[f64; 2]> = wide.tiles(&image, &waves(&truth)).iter().map(|t| [t.x, t.y]).collect();
        assert_eq!(places, [[-40.0, -40.0], [0.0, -40.0], [40.0, -40.0], [-40.0, 40.0], [0.0, 40.0], [40.0, 40.0]]);
    }

    #[test]
    fn noise_has_no_lattice() {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(8);
        let data = (0..300 * 300).map(|_| rng.random::<f32>()).collect();
        let image = SensorImage { width: 300, height: 300, data, limit: [f32::INFINITY; 4] };
        let [f1, f2] = waves(&Lattice::hexagonal(10.0, 0.03, 1.0, [0.0; 2]));
        let start = Fundamentals { square: false, f1, f2, prominence: 20.0, power: 1.0 };
        assert!(matches!(fit_phases(&image, &start), Err(Error::NoPattern { .. })));
    }
}
