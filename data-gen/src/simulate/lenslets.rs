//! Where the lenslets of a camera are, each with a small position error.
//!
//! Lenslet (i, j) of the unturned lattice sits at ((i + (j mod 2)/2)·pitch, j·pitch·√3/2·stretch); it is turned by
//! `rotation` (positive = clockwise on screen), moved to the sensor's centre plus `offset`, and moved once more by a
//! normally distributed error of standard deviation `jitter` in x and y. A pixel belongs to the nearest lenslet.

use lenslet_core::geometry::Size;
use lenslet_core::random::standard_normal_pair;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;

use super::camera::Camera;
use super::draw::floor_i32;
use super::error::Error;

/// The lenslets of one camera, errors included.
#[derive(Debug, Clone)]
pub struct Lenslets {
    centre: [f64; 2],
    cos: f64,
    sin: f64,
    pitch: f64,
    row: f64,
    sensor: Size,
    /// First lattice index (column, row) of the table.
    first: [i32; 2],
    /// Table size (columns, rows).
    size: [usize; 2],
    centres: Vec<[f64; 2]>,
    /// Each lenslet's blur over the camera's; empty where all are 1.
    spots: Vec<f32>,
}

/// The lenslets' blur stays between these shares of the camera's.
/// Source: chosen.
const SPOTS: [f64; 2] = [0.5, 1.5];

impl Lenslets {
    /// Places every lenslet that can reach the sensor. The errors depend on `seed` and the lenslet's indices only.
    ///
    /// # Errors
    /// As [`Camera::check`].
    pub fn new(camera: &Camera, seed: u64) -> Result<Lenslets, Error> {
        camera.check()?;
        let Size { width: w, height: h } = camera.sensor;
        let grid = &camera.lenslets;
        let centre = [(w as f64 - 1.0) / 2.0 + grid.offset[0], (h as f64 - 1.0) / 2.0 + grid.offset[1]];
        let (sin, cos) = grid.rotation.sin_cos();
        let (pitch, row) = (grid.pitch, grid.pitch * 3f64.sqrt() / 2.0 * grid.row_stretch);
        let (mut low, mut high) = ([i32::MAX; 2], [i32::MIN; 2]);
        for (x, y) in [(0.0, 0.0), (w as f64, 0.0), (0.0, h as f64), (w as f64, h as f64)] {
            let (x, y) = (x - centre[0], y - centre[1]);
            let at = [(cos * x + sin * y) / pitch, (cos * y - sin * x) / row];
            for axis in 0..2 {
                low[axis] = low[axis].min(at[axis].floor() as i32 - 3);
                high[axis] = high[axis].max(at[axis].ceil() as i32 + 3);
            }
        }
        let size = [(high[0] - low[0] + 1) as usize, (high[1] - low[1] + 1) as usize];
        let mut centres = Vec::with_capacity(size[0] * size[1]);
        let mut spots = Vec::new();
        let spread = camera.imperfections.focal_spot;
        for r in low[1]..=high[1] {
            for c in low[0]..=high[0] {
                let along = (f64::from(c) + 0.5 * f64::from(r.rem_euclid(2))) * pitch;
                let down = f64::from(r) * row;
                let [ex, ey] = if grid.jitter > 0.0 { two_normals(seed, c, r) } else { [0.0; 2] };
                centres.push([
                    centre[0] + cos * along - sin * down + grid.jitter * ex,
                    centre[1] + sin * along + cos * down + grid.jitter * ey,
                ]);
                if spread > 0.0 {
                    let [own, _] = two_normals(seed ^ SPOT_SALT, c, r);
                    spots.push((1.0 + spread * own).clamp(SPOTS[0], SPOTS[1]) as f32);
                }
            }
        }
        Ok(Lenslets { centre, cos, sin, pitch, row, sensor: camera.sensor, first: low, size, centres, spots })
    }

    /// The same with lenslets at measured places: each of `centres` (x, y in sensor pixels) becomes the centre of the
    /// lenslet it is nearest to, where that is less than half a pitch away.
    #[must_use]
    pub fn moved_to(mut self, centres: &[[f64; 2]]) -> Lenslets {
        let placed = self.clone();
        for &[x, y] in centres {
            let (k, d2) = placed.nearest_index(x, y);
            if d2 < 0.25 * self.pitch * self.pitch {
                self.centres[k] = [x, y];
            }
        }
        self
    }

    /// Centre of the lenslet nearest to (`x`, `y`), and the squared distance.
    #[inline]
    pub fn nearest(&self, x: f64, y: f64) -> ([f64; 2], f64) {
        let (k, d2) = self.nearest_index(x, y);
        (self.centres[k], d2)
    }

    /// [`Lenslets::nearest`], and the lenslet's optical blur over the camera's.
    #[inline]
    pub fn nearest_with_spot(&self, x: f64, y: f64) -> ([f64; 2], f64, f64) {
        let (k, d2) = self.nearest_index(x, y);
        (self.centres[k], d2, self.spots.get(k).map_or(1.0, |s| f64::from(*s)))
    }

    /// Index of the lenslet nearest to (`x`, `y`), and the squared distance.
    #[inline]
    fn nearest_index(&self, x: f64, y: f64) -> (usize, f64) {
        let (dx, dy) = (x - self.centre[0], y - self.centre[1]);
        let along = (self.cos * dx + self.sin * dy) / self.pitch;
        let down = (self.cos * dy - self.sin * dx) / self.row;
        let above = floor_i32(down);
        let mut best = (0, f64::INFINITY);
        for r in [above, above + 1] {
            let c = floor_i32(along - 0.5 * f64::from(r & 1) + 0.5);
            let column = (c - self.first[0]).clamp(0, self.size[0] as i32 - 1) as usize;
            let line = (r - self.first[1]).clamp(0, self.size[1] as i32 - 1) as usize;
            let k = line * self.size[0] + column;
            let at = self.centres[k];
            let d2 = (x - at[0]) * (x - at[0]) + (y - at[1]) * (y - at[1]);
            if d2 < best.1 {
                best = (k, d2);
            }
        }
        best
    }

    /// All centres, those beyond the sensor that reach it included, row by row.
    pub(super) fn all_centres(&self) -> &[[f64; 2]] {
        &self.centres
    }

    /// Centres (x, y) that lie on the sensor (0..=width−1, 0..=height−1), row by row.
    pub fn centres_on_sensor(&self) -> Vec<[f64; 2]> {
        let (w, h) = (self.sensor.width as f64 - 1.0, self.sensor.height as f64 - 1.0);
        self.centres.iter().copied().filter(|c| (0.0..=w).contains(&c[0]) && (0.0..=h).contains(&c[1])).collect()
    }
}

/// What distinguishes the blur's numbers from the positions'.
const SPOT_SALT: u64 = 0x7370_6f74_0000_0000;

/// Two standard normal numbers that belong to lenslet (`c`, `r`).
fn two_normals(seed: u64, c: i32, r: i32) -> [f64; 2] {
    let mut generator = ChaCha8Rng::seed_from_u64(seed ^ 0x6c65_6e73_6c65_7473);
    generator.set_stream((u64::from(c as u32) << 32) | u64::from(r as u32));
    standard_normal_pair(&mut generator)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::LensletGrid;

    fn camera() -> Camera {
        let lenslets = LensletGrid { pitch: 9.7, rotation: 0.05, jitter: 0.3, ..LensletGrid::default() };
        Camera { sensor: Size::new(200, 160), lenslets, ..Camera::default() }
    }

    fn still() -> Camera {
        let lenslets = LensletGrid { jitter: 0.0, ..camera().lenslets };
        Camera { lenslets, ..camera() }
    }

    #[test]
    fn nearest_is_the_nearest_of_all() {
        let lenslets = Lenslets::new(&camera(), 3).unwrap();
        for k in 0..2000u32 {
            let (x, y) = (f64::from(k * 37 % 2000) / 10.0 - 0.4, f64::from(k * 91 % 1600) / 10.0 - 0.4);
            let plain =
                lenslets.centres.iter().map(|c| (c[0] - x).powi(2) + (c[1] - y).powi(2)).fold(f64::INFINITY, f64::min);
            let (_, d2) = lenslets.nearest(x, y);
            // Rounding in the unjittered lattice may pick a neighbour where two are almost equally far.
            assert!(d2.sqrt() <= plain.sqrt() + 1.5, "{x} {y}: {d2} {plain}");
            if plain.sqrt() < 3.0 {
                assert_eq!(d2, plain);
            }
        }
    }

    #[test]
    fn lattice_has_the_pitch_rotation_and_stretch_asked_for() {
        let lenslets = Lenslets::new(&still(), 3).unwrap();
        let at = |c: i32, r: i32| {
            lenslets.centres[(r - lenslets.first[1]) as usize * lenslets.size[0] + (c - lenslets.first[0]) as usize]
        };
        let (o, a, b) = (at(0, 0), at(1, 0), at(0, 1));
        let a = [a[0] - o[0], a[1] - o[1]];
        let b = [b[0] - o[0], b[1] - o[1]];
        assert!((a[0].hypot(a[1]) - 9.7).abs() < 1e-9);
        assert!((a[1].atan2(a[0]) - 0.05).abs() < 1e-9);
        let stretch = (a[0] * b[1] - a[1] * b[0]) / (9.7 * 9.7 * 3f64.sqrt() / 2.0);
        assert!((stretch - 1.0005).abs() < 1e-9);
        assert!((o[0] - (99.5 + 2.37)).abs() < 1e-9 && (o[1] - (79.5 - 1.61)).abs() < 1e-9);
    }

    #[test]
    fn focal_spots_have_the_spread_asked_for_and_move_no_lenslet() {
        let imperfections = crate::simulate::Imperfections { focal_spot: 0.15, ..Default::default() };
        let varied = Lenslets::new(&Camera { imperfections, ..camera() }, 3).unwrap();
        assert_eq!(varied.centres, Lenslets::new(&camera(), 3).unwrap().centres);
        let n = varied.spots.len() as f64;
        assert_eq!(varied.spots.len(), varied.centres.len());
        let mean = varied.spots.iter().map(|s| f64::from(*s)).sum::<f64>() / n;
        let spread = (varied.spots.iter().map(|s| (f64::from(*s) - mean).powi(2)).sum::<f64>() / n).sqrt();
        assert!((mean - 1.0).abs() < 0.02 && (spread - 0.15).abs() < 0.015, "{mean} {spread}");
        assert_eq!(Lenslets::new(&camera(), 3).unwrap().nearest_with_spot(50.0, 50.0).2, 1.0);
    }

    #[test]
    fn errors_have_the_size_asked_for_and_follow_the_seed() {
        let still = Lenslets::new(&still(), 3).unwrap();
        let moved = Lenslets::new(&camera(), 3).unwrap();
        let n = still.centres.len() as f64;
        let rms = (still
            .centres
            .iter()
            .zip(&moved.centres)
            .map(|(a, b)| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2))
            .sum::<f64>()
            / (2.0 * n))
            .sqrt();
        assert!((rms - 0.3).abs() < 0.03, "{rms}");
        assert_eq!(moved.centres, Lenslets::new(&camera(), 3).unwrap().centres);
        assert_ne!(moved.centres, Lenslets::new(&camera(), 4).unwrap().centres);
    }
}
