//! The simulated lenslet camera: a hexagonal lattice of lenslets with small individual errors, and the light a lenslet throws.
//!
//! Lenslet (i, j) of the unturned lattice sits at ((i + (j mod 2)/2)·pitch, j·pitch·√3/2·stretch); it is turned by
//! `rotation` (positive = clockwise on screen), moved to the sensor's centre plus `offset`, and moved once more by its own
//! normally distributed error of standard deviation `jitter` in x and y. A pixel belongs to the nearest lenslet.
//! The light at distance r from the centre, in half pitches, is
//! `max(floor, 1 − falloff·r²)` (parabolic) or `floor + (1 − floor)·exp(−r²/(2 sigma²))` (Gaussian).

use lenslet_core::container::{CameraProfile, Cfa, ColourFacts};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

use super::Error;
use super::draw::below;

/// Radial light profile of a micro-image; r in half pitches.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Profile {
    /// `max(floor, 1 − falloff·r²)`
    Parabolic {
        /// Loss at r = 1, 0..1.
        falloff: f64,
    },
    /// `floor + (1 − floor)·exp(−r²/(2 sigma²))`
    Gaussian {
        /// Width in half pitches, over 0.
        sigma: f64,
    },
}

/// Everything about the camera. [`Camera::default`] is close to a Lytro F01.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Sensor (width, height), even, 64..=16384.
    pub sensor: (usize, usize),
    /// Distance between neighbouring lenslets of a row, sensor pixels, 4..=64.
    pub pitch: f64,
    /// Radians, positive = clockwise on screen, at most π/6 either way.
    pub rotation: f64,
    /// Row distance over its ideal pitch·√3/2, 0.9..=1.1.
    pub row_stretch: f64,
    /// Lenslet (0, 0) minus the sensor's centre, pixels.
    pub offset: [f64; 2],
    /// Standard deviation of each lenslet's own error in x and in y, pixels, 0..=a tenth of the pitch.
    pub jitter: f64,
    /// Light over a micro-image.
    pub profile: Profile,
    /// Light between micro-images, 0..1.
    pub floor: f64,
    /// Standard deviation of the optical blur on the sensor, pixels, 0..=2.
    pub psf: f64,
    /// Main-lens vignetting: share of the light lost in the corners, 0..=0.9.
    pub vignetting: f64,
    /// Low-pass of the lenslet's own aperture: standard deviation of a Gaussian, in pitches, 0.15..=1. A quarter has the
    /// variance of a disc one pitch across.
    pub footprint: f64,
    /// White balance, colour matrix, gamma; what the capture's metadata says is what the sensor does.
    pub colour: ColourFacts,
    /// Share of full scale that R, G, B of a white image reach (its light is not the scene's).
    pub white_response: [f64; 3],
    /// Colour filters.
    pub cfa: Cfa,
    /// Black and saturation (DN), 0 <= black < saturation <= 65535.
    pub levels: [u16; 2],
    /// Model, as its metadata says.
    pub model: String,
    /// Exposure bias its metadata states (EV).
    pub exposure_bias: f64,
    /// Whether its captures carry a white image.
    pub white_inside: bool,
}

impl Default for Camera {
    fn default() -> Self {
        Camera {
            sensor: (3280, 3280),
            pitch: 9.9276,
            rotation: 0.00193,
            row_stretch: 1.0005,
            offset: [2.37, -1.61],
            jitter: 0.05,
            profile: Profile::Parabolic { falloff: 0.8 },
            floor: 0.06,
            psf: 0.6,
            vignetting: 0.5,
            footprint: 0.25,
            colour: ColourFacts {
                white_balance: [1.0, 1.117_187_5, 1.117_187_5, 1.722_656_3],
                ccm: [
                    3.1115828, -1.9393929, -0.1721899, -0.3629056, 1.6408804, -0.2779748, 0.078967, -1.1558043,
                    2.0768373,
                ],
                gamma: Some(0.416_66),
            },
            white_response: [0.69, 0.9, 0.67],
            cfa: Cfa::Bggr,
            levels: [168, 4095],
            model: "F01".to_owned(),
            exposure_bias: -1.0,
            white_inside: false,
        }
    }
}

impl Camera {
    /// The default camera with another sensor and a pitch that keeps everything else in proportion.
    pub fn with_sensor(side: usize) -> Camera {
        Camera { sensor: (side, side), ..Camera::default() }
    }

    /// A camera with the sensor, lenslets and colours of a profile (those of its measured body where it has one); the rest is
    /// that of [`Camera::default`].
    pub fn of_profile(profile: &CameraProfile) -> Camera {
        let usual = Camera::default();
        let sensor = &profile.sensor;
        let measured = profile.measured.as_ref();
        let mla = measured.map(|m| &m.lenslets).or(profile.lenslets.as_ref());
        let mut colour = profile.colour();
        if let Some(m) = measured {
            colour.white_balance = m.white_balance;
        }
        Camera {
            sensor: (sensor.width, sensor.height),
            pitch: mla.map_or(usual.pitch, |m| m.pitch),
            row_stretch: mla.map_or(usual.row_stretch, |m| m.row_stretch),
            colour,
            cfa: sensor.cfa,
            // A profile's levels lie within what its packing holds.
            levels: [sensor.black[1] as u16, sensor.white[1] as u16],
            model: profile.models.first().cloned().unwrap_or_default(),
            // What brings captures to the brightness they were taken with.
            exposure_bias: -sensor.exposure_offset,
            white_inside: profile.white_inside,
            ..usual
        }
    }

    /// Refuses what cannot be simulated.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the first value out of range.
    pub fn check(&self) -> Result<(), Error> {
        let within = |name: &str, value: f64, low: f64, high: f64| {
            if value >= low && value <= high {
                Ok(())
            } else {
                Err(Error::Parameter(format!("{name} must lie in {low}..={high}, not {value}")))
            }
        };
        for side in [self.sensor.0, self.sensor.1] {
            if !(64..=16384).contains(&side) || side % 2 != 0 {
                return Err(Error::Parameter(format!(
                    "the sensor's sides must be even and lie in 64..=16384, not {side}"
                )));
            }
        }
        within("the pitch", self.pitch, 4.0, 64.0)?;
        let count = self.sensor.0 as f64 * self.sensor.1 as f64 / (self.pitch * self.pitch);
        if count > 4e6 {
            return Err(Error::Parameter(format!("{count:.0} lenslets are too many: at most 4000000")));
        }
        within("the rotation (radians)", self.rotation, -std::f64::consts::FRAC_PI_6, std::f64::consts::FRAC_PI_6)?;
        within("the row stretch", self.row_stretch, 0.9, 1.1)?;
        within("the offset", self.offset[0], -1e4, 1e4)?;
        within("the offset", self.offset[1], -1e4, 1e4)?;
        within("the jitter", self.jitter, 0.0, 0.1 * self.pitch)?;
        within("the floor", self.floor, 0.0, 1.0)?;
        within("the optical blur", self.psf, 0.0, 2.0)?;
        within("the main-lens vignetting", self.vignetting, 0.0, 0.9)?;
        within("the lenslet footprint", self.footprint, 0.15, 1.0)?;
        match self.profile {
            Profile::Parabolic { falloff } => within("the falloff", falloff, 0.0, 1.0)?,
            Profile::Gaussian { sigma } => within("the profile's sigma", sigma, 0.05, 10.0)?,
        }
        if self.levels[0] >= self.levels[1] || self.cfa == Cfa::Mono {
            return Err(Error::Parameter(
                "the sensor needs colour filters and a black level below saturation".to_owned(),
            ));
        }
        for response in self.white_response {
            within("the white response", response, 0.01, 1.0)?;
        }
        for gain in self.colour.white_balance {
            within("a white balance gain", f64::from(gain), 0.1, 10.0)?;
        }
        invert(&self.colour.ccm)
            .map(|_| ())
            .ok_or_else(|| Error::Parameter("the colour matrix cannot be inverted".to_owned()))
    }

    /// Light at squared distance `d2` (pixels²) from a lenslet centre.
    #[inline]
    pub fn light(&self, d2: f64) -> f64 {
        let r2 = d2 * 4.0 / (self.pitch * self.pitch);
        match self.profile {
            Profile::Parabolic { falloff } => (1.0 - falloff * r2).max(self.floor),
            Profile::Gaussian { sigma } => self.floor + (1.0 - self.floor) * (-r2 / (2.0 * sigma * sigma)).exp(),
        }
    }

    /// Main-lens vignetting at a pixel: 1 in the centre, `1 − vignetting` in the corners.
    #[inline]
    pub fn field(&self, x: f64, y: f64) -> f64 {
        let (cx, cy) = ((self.sensor.0 as f64 - 1.0) / 2.0, (self.sensor.1 as f64 - 1.0) / 2.0);
        1.0 - self.vignetting * ((x - cx).powi(2) + (y - cy).powi(2)) / (cx * cx + cy * cy)
    }

    /// Linear sRGB → share of full scale of R, Gr, Gb, B: the inverse colour matrix, then the inverse white balance.
    pub fn responses(&self) -> [[f32; 3]; 4] {
        let inverse = invert(&self.colour.ccm).unwrap_or([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        std::array::from_fn(|plane| {
            let row = [0, 1, 1, 2][plane];
            std::array::from_fn(|c| (inverse[3 * row + c] / f64::from(self.colour.white_balance[plane])) as f32)
        })
    }
}

/// Inverse of a row-major 3×3 matrix.
fn invert(m: &[f32; 9]) -> Option<[f64; 9]> {
    let m: [f64; 9] = m.map(f64::from);
    let minor = |a: usize, b: usize, c: usize, d: usize| m[a] * m[d] - m[b] * m[c];
    let det = m[0] * minor(4, 5, 7, 8) - m[1] * minor(3, 5, 6, 8) + m[2] * minor(3, 4, 6, 7);
    if !det.is_finite() || det.abs() < 1e-6 {
        return None;
    }
    let adjugate = [
        minor(4, 5, 7, 8),
        -minor(1, 2, 7, 8),
        minor(1, 2, 4, 5),
        -minor(3, 5, 6, 8),
        minor(0, 2, 6, 8),
        -minor(0, 2, 3, 5),
        minor(3, 4, 6, 7),
        -minor(0, 1, 6, 7),
        minor(0, 1, 3, 4),
    ];
    Some(adjugate.map(|a| a / det))
}

/// The lenslets of one camera, errors included.
#[derive(Debug, Clone)]
pub struct Lenslets {
    centre: [f64; 2],
    cos: f64,
    sin: f64,
    pitch: f64,
    row: f64,
    sensor: (usize, usize),
    /// First lattice index (column, row) of the table.
    first: [i32; 2],
    /// Table size (columns, rows).
    size: [usize; 2],
    centres: Vec<[f64; 2]>,
}

impl Lenslets {
    /// Places every lenslet that can reach the sensor. The errors depend on `seed` and the lenslet's indices only.
    ///
    /// # Errors
    /// As [`Camera::check`].
    pub fn new(camera: &Camera, seed: u64) -> Result<Lenslets, Error> {
        camera.check()?;
        let (w, h) = camera.sensor;
        let centre = [(w as f64 - 1.0) / 2.0 + camera.offset[0], (h as f64 - 1.0) / 2.0 + camera.offset[1]];
        let (sin, cos) = camera.rotation.sin_cos();
        let (pitch, row) = (camera.pitch, camera.pitch * 3f64.sqrt() / 2.0 * camera.row_stretch);
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
        for r in low[1]..=high[1] {
            for c in low[0]..=high[0] {
                let along = (f64::from(c) + 0.5 * f64::from(r.rem_euclid(2))) * pitch;
                let down = f64::from(r) * row;
                let [ex, ey] = if camera.jitter > 0.0 { error(seed, c, r) } else { [0.0; 2] };
                centres.push([
                    centre[0] + cos * along - sin * down + camera.jitter * ex,
                    centre[1] + sin * along + cos * down + camera.jitter * ey,
                ]);
            }
        }
        Ok(Lenslets { centre, cos, sin, pitch, row, sensor: (w, h), first: low, size, centres })
    }

    /// Centre of the lenslet nearest to (`x`, `y`), and the squared distance.
    #[inline]
    pub fn nearest(&self, x: f64, y: f64) -> ([f64; 2], f64) {
        let (dx, dy) = (x - self.centre[0], y - self.centre[1]);
        let along = (self.cos * dx + self.sin * dy) / self.pitch;
        let down = (self.cos * dy - self.sin * dx) / self.row;
        let above = below(down);
        let mut best = ([x, y], f64::INFINITY);
        for r in [above, above + 1] {
            let c = below(along - 0.5 * f64::from(r & 1) + 0.5);
            let column = (c - self.first[0]).clamp(0, self.size[0] as i32 - 1) as usize;
            let line = (r - self.first[1]).clamp(0, self.size[1] as i32 - 1) as usize;
            let at = self.centres[line * self.size[0] + column];
            let d2 = (x - at[0]) * (x - at[0]) + (y - at[1]) * (y - at[1]);
            if d2 < best.1 {
                best = (at, d2);
            }
        }
        best
    }

    /// Centres (x, y) that lie on the sensor (0..=width−1, 0..=height−1), row by row.
    pub fn on_sensor(&self) -> Vec<[f64; 2]> {
        let (w, h) = (self.sensor.0 as f64 - 1.0, self.sensor.1 as f64 - 1.0);
        self.centres.iter().copied().filter(|c| (0.0..=w).contains(&c[0]) && (0.0..=h).contains(&c[1])).collect()
    }
}

/// Two standard normal numbers that belong to lenslet (`c`, `r`).
fn error(seed: u64, c: i32, r: i32) -> [f64; 2] {
    let mut generator = ChaCha8Rng::seed_from_u64(seed ^ 0x6c65_6e73_6c65_7473);
    generator.set_stream((u64::from(c as u32) << 32) | u64::from(r as u32));
    normal(&mut generator)
}

/// Two standard normal numbers (Box and Muller 1958).
#[inline]
pub(super) fn normal(generator: &mut ChaCha8Rng) -> [f64; 2] {
    let radius = (-2.0 * (1.0 - generator.random::<f64>()).ln()).sqrt();
    let (sin, cos) = (std::f64::consts::TAU * generator.random::<f64>()).sin_cos();
    [radius * cos, radius * sin]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera { sensor: (200, 160), pitch: 9.7, rotation: 0.05, jitter: 0.3, ..Camera::default() }
    }

    #[test]
    fn the_default_is_the_measured_f01() {
        let f01 = CameraProfile::find("lytro-f01").unwrap();
        assert_eq!(Camera::of_profile(&f01), Camera::default());
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
        let lenslets = Lenslets::new(&Camera { jitter: 0.0, ..camera() }, 3).unwrap();
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
    fn errors_have_the_size_asked_for_and_follow_the_seed() {
        let still = Lenslets::new(&Camera { jitter: 0.0, ..camera() }, 3).unwrap();
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

    #[test]
    fn responses_undo_white_balance_and_colour_matrix() {
        let camera = Camera::default();
        let planes = camera.responses();
        for colour in [[1.0f32, 1.0, 1.0], [0.7, 0.2, 0.1], [0.1, 0.4, 0.9]] {
            let raw: [f32; 4] = std::array::from_fn(|p| (0..3).map(|c| planes[p][c] * colour[c]).sum());
            assert!((raw[1] - raw[2]).abs() < 1e-6);
            let balanced = [0, 1, 3].map(|p| raw[p] * camera.colour.white_balance[p]);
            for row in 0..3 {
                let back: f32 = (0..3).map(|c| camera.colour.ccm[3 * row + c] * balanced[c]).sum();
                assert!((back - colour[row]).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn values_out_of_range_are_refused() {
        for bad in [
            Camera { sensor: (63, 64), ..Camera::default() },
            Camera { sensor: (20000, 64), ..Camera::default() },
            Camera { pitch: f64::NAN, ..Camera::default() },
            Camera { pitch: 1.0, ..Camera::default() },
            Camera { jitter: 3.0, ..Camera::default() },
            Camera { rotation: 1.0, ..Camera::default() },
            Camera { footprint: 0.0, ..Camera::default() },
            Camera { levels: [1023, 1023], ..Camera::default() },
            Camera { colour: ColourFacts { ccm: [0.0; 9], ..Camera::default().colour }, ..Camera::default() },
        ] {
            assert!(matches!(Lenslets::new(&bad, 0), Err(Error::Parameter(_))), "{bad:?}");
        }
    }
}
