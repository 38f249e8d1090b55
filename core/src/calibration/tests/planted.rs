//! White images with planted lenslets, for tests: calibration must find the planted centres.

use rand::{SeedableRng, rngs::ChaCha8Rng};
use rayon::prelude::*;

use crate::calibration::model::{Grid, Lattice};
use crate::container::{Capture, Cfa, Levels, RawMosaic};
use crate::random::standard_normal;

/// A true lenslet: lattice index and centre.
pub type Planted = ([i32; 2], [f64; 2]);

/// A camera whose white image shows planted lenslets.
#[derive(Debug, Clone)]
pub struct PlantedCamera {
    pub width: usize,
    pub height: usize,
    pub grid: Grid,
    pub pitch: f64,
    pub rotation: f64,
    pub stretch: f64,
    /// Offset of lenslet (0, 0) from the sensor's centre, pixels.
    pub offset: [f64; 2],
    /// Standard deviation of the lenslets' position errors, pixels per axis.
    pub jitter: f64,
    /// Share of light lost in the corners, 0 to 1.
    pub vignetting: f64,
    /// Share of the full scale at the brightest pixel.
    pub exposure: f64,
    /// 0 none, 1 one electron per DN and 3 DN read noise.
    pub noise: f64,
    pub seed: u64,
}

impl Default for PlantedCamera {
    fn default() -> Self {
        PlantedCamera {
            width: 640,
            height: 640,
            grid: Grid::HexRows,
            pitch: 10.0,
            rotation: 0.003,
            stretch: 1.0004,
            offset: [2.37, -1.61],
            jitter: 0.0,
            vignetting: 0.5,
            exposure: 0.9,
            noise: 0.7,
            seed: 5,
        }
    }
}

pub const BLACK: f64 = 168.0;
pub const WHITE: f64 = 4095.0;

impl PlantedCamera {
    pub fn lattice(&self) -> Lattice {
        let (s, c) = self.rotation.sin_cos();
        let (p, row) = match self.grid {
            Grid::Square => (0.0, self.pitch * self.stretch),
            _ => (0.5 * self.pitch, self.pitch * 3f64.sqrt() / 2.0 * self.stretch),
        };
        let origin =
            [(self.width as f64 - 1.0) / 2.0 + self.offset[0], (self.height as f64 - 1.0) / 2.0 + self.offset[1]];
        let turn = |v: [f64; 2]| [c * v[0] - s * v[1], s * v[0] + c * v[1]];
        // Columns: the rows' grid turned by 90 degrees.
        let quarter = |v: [f64; 2]| if self.grid == Grid::HexColumns { [-v[1], v[0]] } else { v };
        Lattice { grid: self.grid, origin, a: turn(quarter([self.pitch, 0.0])), b: turn(quarter([p, row])) }
    }

    /// The white image, and the true centres (with their position errors) by lattice index.
    pub fn white_image(&self) -> (Capture, Vec<Planted>) {
        let lattice = self.lattice();
        let reach = 2 * (self.width.max(self.height) as f64 / self.pitch) as i32 + 12;
        let side = (2 * reach + 1) as usize;
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let centres: Vec<[f64; 2]> = (0..side * side)
            .map(|k| {
                let [x, y] = lattice.centre((k % side) as i32 - reach, (k / side) as i32 - reach);
                [x + self.jitter * standard_normal(&mut rng), y + self.jitter * standard_normal(&mut rng)]
            })
            .collect();
        let at = |i: i32, j: i32| centres[(j + reach) as usize * side + (i + reach) as usize];
        let radius = 0.5 * self.pitch;
        let light = |x: f64, y: f64| {
            let [u, w] = lattice.coordinates(x, y);
            let (i, j) = (u.floor() as i32, w.floor() as i32);
            let mut least = f64::INFINITY;
            for dj in -1..=2 {
                for di in -1..=2 {
                    let c = at(i + di, j + dj);
                    least = least.min((x - c[0]).powi(2) + (y - c[1]).powi(2));
                }
            }
            (1.0 - 0.8 * least / (radius * radius)).max(0.06)
        };
        let (w, h) = (self.width, self.height);
        let middle = [(w as f64 - 1.0) / 2.0, (h as f64 - 1.0) / 2.0];
        let response = [0.7630647, 1.0, 1.0, 0.7447674];
        let data: Vec<u16> = (0..h)
            .into_par_iter()
            .flat_map_iter(|y| {
                let mut rng = ChaCha8Rng::seed_from_u64(self.seed.wrapping_mul(7919).wrapping_add(y as u64));
                (0..w)
                    .map(|x| {
                        // Nine points over a pixel and half: the pixel's extent and a little blur.
                        let mut sum = 0.0;
                        for sy in [-0.55, 0.0, 0.55] {
                            for sx in [-0.55, 0.0, 0.55] {
                                sum += light(x as f64 + sx, y as f64 + sy);
                            }
                        }
                        let far = ((x as f64 - middle[0]).powi(2) + (y as f64 - middle[1]).powi(2))
                            / (middle[0].powi(2) + middle[1].powi(2));
                        let v = sum / 9.0
                            * (1.0 - self.vignetting * far)
                            * response[Cfa::Bggr.plane(x, y)]
                            * self.exposure
                            * (WHITE - BLACK);
                        let noisy = v + self.noise
                            * (v.max(0.0).sqrt() * standard_normal(&mut rng) + 3.0 * standard_normal(&mut rng));
                        (BLACK + noisy).round().clamp(0.0, WHITE) as u16
                    })
                    .collect::<Vec<u16>>()
            })
            .collect();
        let mut truth = Vec::new();
        for j in -reach..=reach {
            for i in -reach..=reach {
                let c = at(i, j);
                if c[0] >= 0.0 && c[1] >= 0.0 && c[0] <= (w - 1) as f64 && c[1] <= (h - 1) as f64 {
                    truth.push(([i, j], c));
                }
            }
        }
        (capture(w, h, data), truth)
    }
}

/// A capture with the black and white levels of a Lytro F01.
pub fn capture(width: usize, height: usize, data: Vec<u16>) -> Capture {
    let levels = Levels { black: [BLACK as f32; 4], white: [WHITE as f32; 4] };
    Capture { source_sha256: "planted".into(), ..Capture::bare(RawMosaic { width, height, data }, Cfa::Bggr, levels) }
}
