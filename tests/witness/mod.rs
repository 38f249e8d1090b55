//! A second generator of raw captures, which shares nothing with the simulator of `lenslet simulate`: rays through a
//! thin main lens, a grid of lenslets and a sensor at their focal distance (sections 3 and 4 of the paper), summed over
//! every lenslet's aperture and every pixel's area.
//!
//! All lengths are sensor pixels. The sensor lies one lenslet focal length f behind the lenslets, the main lens's pupil
//! (diameter A) the distance L before them. What reaches the sensor at p through the lenslet at c travels along
//! (c − p)/f before it, whatever point q of the lenslet it passes, and comes from the pupil at m = q + (c − p)·L/f: there
//! is light where |m| < A/2. So the micro-image's middle is not c but c·(1 + f/L), and its radius A·f/(2L).
//!
//! A plane of the scene is in focus the share s of L before the lenslets. The ray meets it at q + s·(m − q), so a pixel δ
//! off the middle sees the picture at q − s·c − d·δ with d = s·L/f, averaged over the lenslet's aperture.

#![allow(clippy::unwrap_used)] // of tests

use std::f64::consts::{PI, TAU};
use std::path::Path;

use image::{ImageBuffer, Luma};
use rayon::prelude::*;

/// Black level and saturation of a 12-bit sensor.
const BLACK: f64 = 168.0;
const FULL: f64 = 4095.0;

/// The camera; see the module's text.
pub struct Camera {
    pub side: usize,
    pub pitch: f64,
    pub rotation: f64,
    /// Deviation of every lenslet's own place.
    pub jitter: f64,
    /// f.
    pub focal: f64,
    /// L.
    pub pupil_distance: f64,
    /// A.
    pub pupil: f64,
    /// Light lost towards the rim of a micro-image, by (r/R)².
    pub falloff: f64,
    /// Deviation of the sensor's own blur.
    pub blur: f64,
    /// Share of full scale of a white surface in the middle of the sensor.
    pub exposure: f64,
    /// Electrons at full scale (shot noise), and read noise in digital numbers; 0 electrons: no noise.
    pub electrons: f64,
    pub read_noise: f64,
    pub seed: u64,
}

impl Default for Camera {
    fn default() -> Self {
        // Lenslets of 14 µm and f/2 before pixels of 1.4 µm, a pupil 35 mm away: an F01 but for the size of its sensor.
        Camera {
            side: 640,
            pitch: 10.0,
            rotation: 0.004,
            jitter: 0.05,
            focal: 20.0,
            pupil_distance: 25_000.0,
            pupil: 11_900.0,
            falloff: 0.7,
            blur: 0.45,
            exposure: 0.85,
            electrons: 12_000.0,
            read_noise: 2.0,
            seed: 77,
        }
    }
}

/// A generator of numbers of its own (xorshift*), uniform in 0..1.
pub struct Dice(u64);

impl Dice {
    pub fn new(seed: u64) -> Dice {
        Dice(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    pub fn roll(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.roll()).ln()).sqrt() * (TAU * self.roll()).cos()
    }
}

/// A picture: waves of 13 to 160 pixels, discs and stripes with hard edges; linear light in 0.05..=0.95. Drawn once on
/// a grid of half pixels, then read between its points.
pub struct Picture {
    values: Vec<[f32; 3]>,
}

impl Picture {
    /// Half the side of the picture, pixels.
    const HALF: usize = 420;
    const ACROSS: usize = 4 * Self::HALF + 1;

    pub fn new(seed: u64) -> Picture {
        let mut dice = Dice::new(seed);
        let waves: Vec<[f64; 6]> = (0..24)
            .map(|_| {
                let length = 13.0 * 12.3f64.powf(dice.roll());
                let (angle, phase) = (PI * dice.roll(), TAU * dice.roll());
                let k = TAU / length;
                let mut own = || 0.055 * (length / 40.0).sqrt().min(1.3) * (0.6 + 0.4 * dice.roll());
                [k * angle.cos(), k * angle.sin(), phase, own(), own(), own()]
            })
            .collect();
        let discs: Vec<[f64; 6]> = (0..50)
            .map(|_| {
                let mut place = || 800.0 * (dice.roll() - 0.5);
                let at = [place(), place()];
                [at[0], at[1], 8.0 + 30.0 * dice.roll(), dice.roll(), dice.roll(), dice.roll()]
            })
            .collect();
        let drawn = |x: f64, y: f64| {
            let mut colour = [0.48; 3];
            for w in &waves {
                let wave = (w[0] * x + w[1] * y + w[2]).sin();
                (0..3).for_each(|c| colour[c] += w[3 + c] * wave);
            }
            for d in &discs {
                if (x - d[0]).powi(2) + (y - d[1]).powi(2) < d[2] * d[2] {
                    // A third of them are striped.
                    let dark = d[3] < 0.33 && ((x + 0.4 * y) / 17.0).rem_euclid(1.0) < 0.5;
                    (0..3).for_each(|c| colour[c] = if dark { 0.1 } else { 0.15 + 0.7 * d[3 + c] });
                }
            }
            colour.map(|v| v.clamp(0.05, 0.95) as f32)
        };
        let place = |k: usize| 0.5 * k as f64 - Self::HALF as f64;
        let points = (0..Self::ACROSS * Self::ACROSS).into_par_iter();
        Picture { values: points.map(|k| drawn(place(k % Self::ACROSS), place(k / Self::ACROSS))).collect() }
    }

    /// What is at (x, y), pixels from the optical axis, in one colour.
    fn at(&self, x: f64, y: f64, colour: usize) -> f64 {
        let place = |v: f64| (2.0 * (v + Self::HALF as f64)).clamp(0.0, (Self::ACROSS - 2) as f64);
        let (x, y) = (place(x), place(y));
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x - column as f64, y - row as f64);
        let read = |dx: usize, dy: usize| f64::from(self.values[(row + dy) * Self::ACROSS + column + dx][colour]);
        let (top, bottom) = (read(0, 0) + fx * (read(1, 0) - read(0, 0)), read(0, 1) + fx * (read(1, 1) - read(0, 1)));
        top + fy * (bottom - top)
    }
}

impl Camera {
    fn middle(&self) -> f64 {
        (self.side as f64 - 1.0) / 2.0
    }

    /// Lenslet (column, row), from the optical axis.
    fn lenslet(&self, column: i64, row: i64) -> [f64; 2] {
        let (u, v) = (
            (column as f64 + if row.rem_euclid(2) == 1 { 0.5 } else { 0.0 }) * self.pitch + 1.7,
            row as f64 * self.pitch * 0.75f64.sqrt() - 2.9,
        );
        let mut dice = Dice::new(self.seed ^ ((column + 5000) as u64 * 10_007 + (row + 5000) as u64));
        // The first rolls of neighbouring seeds are alike.
        (0..5).for_each(|_| {
            dice.roll();
        });
        let own = [self.jitter * dice.normal(), self.jitter * dice.normal()];
        let (s, c) = self.rotation.sin_cos();
        [c * u - s * v + own[0], s * u + c * v + own[1]]
    }

    /// All lenslets that can send light to the sensor, by row.
    fn grid(&self) -> (i64, Vec<[f64; 2]>) {
        let half = (0.75 * self.side as f64 / (self.pitch * 0.75f64.sqrt())).ceil() as i64 + 4;
        let all = (-half..=half).flat_map(|row| (-half..=half).map(move |column| (column, row)));
        (half, all.map(|(column, row)| self.lenslet(column, row)).collect())
    }

    /// How much farther out a micro-image's middle is than its lenslet.
    fn spread(&self) -> f64 {
        1.0 + self.focal / self.pupil_distance
    }

    /// Middles of the micro-images on the sensor, (x, y) with pixel centres at integers.
    pub fn micro_image_middles(&self) -> Vec<[f64; 2]> {
        let end = self.side as f64 - 1.0;
        let on_sensor = |c: &[f64; 2]| c.map(|v| v * self.spread() + self.middle());
        let all = self.grid().1;
        all.iter().map(on_sensor).filter(|c| c.iter().all(|v| (0.0..=end).contains(v))).collect()
    }

    /// Points of a lenslet's aperture, a disc of one pitch: rings of equal area.
    fn aperture(&self, rings: usize, spokes: usize) -> Vec<[f64; 2]> {
        let ring = |k: usize| 0.5 * self.pitch * ((k as f64 + 0.5) / rings as f64).sqrt();
        (0..rings * spokes)
            .map(|n| {
                let (k, angle) = (n / spokes, TAU * ((n % spokes) as f64 + 0.5 * (n / spokes) as f64) / spokes as f64);
                [ring(k) * angle.cos(), ring(k) * angle.sin()]
            })
            .collect()
    }

    /// Light on every pixel, by colour filter BGGR: of the `scene` (a picture and its share s), or of a white surface.
    fn expose(&self, scene: Option<(&Picture, f64)>) -> Vec<f64> {
        let (half, lenslets) = self.grid();
        let across = 2 * half + 1;
        let aperture = self.aperture(2, 6);
        let (reach, ratio) = (0.5 * self.pupil, self.pupil_distance / self.focal);
        let radius = reach / ratio;
        let (sin, cos) = self.rotation.sin_cos();
        // Pixel area and blur together: a four-point rule in x and in y with the variance of both.
        let deviation = (1.0 / 12.0 + self.blur * self.blur).sqrt();
        let rule = [(-2.334_414, 0.045_876), (-0.741_964, 0.454_124), (0.741_964, 0.454_124), (2.334_414, 0.045_876)];
        let full = 1.0 - self.falloff * 2.0 * deviation * deviation / (radius * radius);
        let mut light = vec![0.0; self.side * self.side];
        light.par_iter_mut().enumerate().for_each(|(k, out)| {
            let (px, py) = (k % self.side, k / self.side);
            let channel = [[2, 1], [1, 0]][py % 2][px % 2];
            let field =
                ((px as f64 - self.middle()).powi(2) + (py as f64 - self.middle()).powi(2)) / self.middle().powi(2);
            let mut sum = 0.0;
            for (dy, wy) in rule {
                for (dx, wx) in rule {
                    let p = [px as f64 - self.middle() + deviation * dx, py as f64 - self.middle() + deviation * dy];
                    let (u, v) = (cos * p[0] + sin * p[1] - 1.7, cos * p[1] - sin * p[0] + 2.9);
                    let row = (v / (self.pitch * 0.75f64.sqrt())).round() as i64;
                    for row in row - 1..=row + 1 {
                        let shift = if row.rem_euclid(2) == 1 { 0.5 } else { 0.0 };
                        let column = (u / self.pitch - shift).round() as i64;
                        let c = lenslets[((row + half) * across + column + half) as usize];
                        let chief = [(c[0] - p[0]) * ratio + c[0], (c[1] - p[1]) * ratio + c[1]];
                        let from_middle = chief[0].hypot(chief[1]) / reach;
                        // A soft rim: the pupil is seen past the lenslet's whole aperture, and diffraction softens it.
                        let open = ((1.0 - from_middle) / 0.08 + 0.5).clamp(0.0, 1.0);
                        if open == 0.0 {
                            continue;
                        }
                        let seen = scene.map_or(1.0, |(picture, s)| {
                            let at = |q: &[f64; 2]| {
                                let q = [c[0] + q[0], c[1] + q[1]];
                                let m = [(c[0] - p[0]) * ratio, (c[1] - p[1]) * ratio];
                                picture.at(q[0] + s * m[0], q[1] + s * m[1], channel)
                            };
                            aperture.iter().map(at).sum::<f64>() / aperture.len() as f64
                        });
                        sum += wx * wy * open * (1.0 - self.falloff * from_middle * from_middle).max(0.0) * seen;
                    }
                }
            }
            *out = sum / full * (1.0 - 0.18 * field);
        });
        light
    }

    /// Digital numbers; every row has its own noise.
    fn record(&self, light: &[f64], gains: [f64; 3], frame: u64) -> Vec<u16> {
        let mut dice = Dice::new(self.seed * 31 + frame);
        let number = |(k, light): (usize, &f64)| {
            let channel = [[2, 1], [1, 0]][k / self.side % 2][k % self.side % 2];
            let signal = light * self.exposure * gains[channel] * (FULL - BLACK);
            let shot = if self.electrons > 0.0 { signal * (FULL - BLACK) / self.electrons } else { 0.0 };
            let read = if self.electrons > 0.0 { self.read_noise } else { 0.0 };
            (BLACK + signal + (shot.max(0.0) + read * read).sqrt() * dice.normal()).round().clamp(0.0, FULL) as u16
        };
        light.iter().enumerate().map(number).collect()
    }

    fn save(&self, numbers: Vec<u16>, path: &Path) {
        let side = self.side as u32;
        ImageBuffer::<Luma<u16>, _>::from_raw(side, side, numbers).unwrap().save(path).unwrap();
    }

    /// Writes a white image as a 16-bit picture of the mosaic. Its light is not the scene's: red and blue are weaker.
    pub fn save_white(&self, path: &Path) {
        self.save(self.record(&self.expose(None), [0.76, 1.0, 0.74], 1), path);
    }

    /// Writes a capture of a picture in focus the share `s` of L before the lenslets.
    pub fn save_scene(&self, picture: &Picture, s: f64, path: &Path) {
        self.save(self.record(&self.expose(Some((picture, s))), [1.0; 3], 2), path);
    }

    /// Disparity d of such a picture: sensor pixels a pixel of offset.
    pub fn disparity(&self, s: f64) -> f64 {
        s * self.pupil_distance / self.focal
    }

    /// The picture as a lenslet would see it wherever its micro-image's middle is, at the offset (`u`, `v`), on a square
    /// view of `side` pixels: rows of RGB, shares of full scale.
    pub fn true_view(&self, picture: &Picture, s: f64, [u, v]: [f64; 2], side: usize) -> Vec<[f64; 3]> {
        let aperture = self.aperture(3, 10);
        let step = self.side as f64 / side as f64;
        let d = self.disparity(s);
        (0..side * side)
            .map(|k| {
                let at = |k: usize| (k as f64 + 0.5) * step - 0.5 - self.middle();
                let c = [at(k % side) / self.spread(), at(k / side) / self.spread()];
                // p − c = (spread − 1)·c + δ, so that s·m = −d·((spread − 1)·c + δ) = −s·c − d·δ.
                let middle = [c[0] - s * c[0] - d * u, c[1] - s * c[1] - d * v];
                let mut sum = [0.0; 3];
                for q in &aperture {
                    let seen = |c| picture.at(middle[0] + q[0], middle[1] + q[1], c);
                    (0..3).for_each(|c| sum[c] += self.exposure * seen(c) / aperture.len() as f64);
                }
                sum
            })
            .collect()
    }
}
