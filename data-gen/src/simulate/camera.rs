//! The simulated lenslet camera: size of its sensor, grid of lenslets, optics, response to light, metadata.
//!
//! The light at distance r from the centre of a lenslet, in half pitches, is
//! `max(floor, 1 − falloff·r²)` (parabolic) or `floor + (1 − floor)·exp(−r²/(2 sigma²))` (Gaussian).
//! Where the lenslets are is described in [`Lenslets`](super::Lenslets).

use lenslet_core::container::{CameraProfile, Cfa, ColourFacts};
use lenslet_core::geometry::Size;
use serde::{Deserialize, Serialize};

use super::error::Error;
use super::imperfections::Imperfections;
use super::texels::{MOST_TEXELS, TEXEL};

/// Radial light profile of a micro-image; r in half pitches.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LightProfile {
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

/// The hexagonal grid of lenslets before the sensor. The default is that of a Lytro F01.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LensletGrid {
    /// Distance between neighbouring lenslets of a row, sensor pixels, 4..=64; default 9.9276.
    pub pitch: f64,
    /// Radians, positive = clockwise on screen, at most π/6 either way; default 0.00193.
    pub rotation: f64,
    /// Row distance over its ideal pitch·√3/2, 0.9..=1.1; default 1.0005.
    pub row_stretch: f64,
    /// Lenslet (0, 0) minus the sensor's centre, (x, y) in pixels; default (2.37, −1.61).
    pub offset: [f64; 2],
    /// Standard deviation of each lenslet's own error in x and in y, pixels, 0..=a tenth of the pitch; default 0.05.
    pub jitter: f64,
}

impl Default for LensletGrid {
    fn default() -> Self {
        LensletGrid { pitch: 9.9276, rotation: 0.00193, row_stretch: 1.0005, offset: [2.37, -1.61], jitter: 0.05 }
    }
}

/// What main lens and lenslets do to the light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Optics {
    /// Light over a micro-image; default parabolic with a falloff of 0.8.
    pub profile: LightProfile,
    /// Light between micro-images as a share of that at their centres, 0..1; default 0.06.
    pub floor: f64,
    /// Standard deviation of the optical blur on the sensor, pixels, 0..=2; default 0.6.
    pub psf: f64,
    /// Main-lens vignetting: share of the light lost in the corners, 0..=0.9; default 0.5.
    pub vignetting: f64,
    /// Low-pass of the lenslet's own aperture: standard deviation of a Gaussian, in pitches, 0.1..=1. The default, a
    /// quarter, has the variance of a disc one pitch across.
    pub footprint: f64,
}

/// Least footprint, pitches: with pixels a third of a pitch wide, half a pixel.
///
/// Source: chosen; twice the texels an axis of the usual footprint.
const SHARP: f64 = 0.1;

impl Default for Optics {
    fn default() -> Self {
        Optics {
            profile: LightProfile::Parabolic { falloff: 0.8 },
            floor: 0.06,
            psf: 0.6,
            vignetting: 0.5,
            footprint: 0.25,
        }
    }
}

/// How the sensor turns light into numbers. The default is that of a Lytro F01.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SensorResponse {
    /// White balance, colour matrix, gamma: those of the capture's metadata, which the simulated sensor follows
    /// exactly.
    pub colour: ColourFacts,
    /// Share of full scale that R, G, B of a white image reach (its light is not the scene's), 0.01..=1.
    pub white_response: [f64; 3],
    /// Colour filters; [`Cfa::Mono`] is refused.
    pub cfa: Cfa,
    /// Black and saturation (DN), 0 <= black < saturation <= 65535.
    pub levels: [u16; 2],
    /// Light of the scene as a share of a full exposure, 0.001..=1; default 1. White images are exposed in full.
    #[serde(default = "full_exposure")]
    pub exposure: f64,
}

fn full_exposure() -> f64 {
    1.0
}

impl Default for SensorResponse {
    fn default() -> Self {
        SensorResponse {
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
            exposure: full_exposure(),
        }
    }
}

/// The metadata that the camera writes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraIdentity {
    /// Model in its metadata; default F01.
    pub model: String,
    /// Exposure bias its metadata states (EV); default −1.
    pub exposure_bias: f64,
    /// Whether its captures carry a white image; default no.
    pub white_inside: bool,
}

impl Default for CameraIdentity {
    fn default() -> Self {
        CameraIdentity { model: "F01".to_owned(), exposure_bias: -1.0, white_inside: false }
    }
}

/// Everything about the camera. [`Camera::default`] is close to a Lytro F01. In JSON the groups are one flat object.
///
/// ```
/// use lenslet_data_gen::simulate::{Camera, LensletGrid};
/// let camera = Camera {
///     lenslets: LensletGrid { pitch: 14.0, ..LensletGrid::default() },
///     ..Camera::with_sensor(256)
/// };
/// assert!(camera.check().is_ok());
/// assert_eq!(serde_json::to_value(&camera)?["pitch"], 14.0);
/// assert!(Camera::with_sensor(63).check().is_err());
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Sensor (width, height) in pixels, both even, 64..=16384; default 3280×3280.
    pub sensor: Size,
    /// Where the lenslets are.
    #[serde(flatten)]
    pub lenslets: LensletGrid,
    /// Main lens and lenslets.
    #[serde(flatten)]
    pub optics: Optics,
    /// The sensor.
    #[serde(flatten)]
    pub response: SensorResponse,
    /// The metadata.
    #[serde(flatten)]
    pub identity: CameraIdentity,
    /// What the ideal camera does not do; default none. Absent in JSON where there are none.
    #[serde(default, skip_serializing_if = "Imperfections::is_ideal")]
    pub imperfections: Imperfections,
}

impl Default for Camera {
    fn default() -> Self {
        Camera {
            sensor: Size::new(3280, 3280),
            lenslets: LensletGrid::default(),
            optics: Optics::default(),
            response: SensorResponse::default(),
            identity: CameraIdentity::default(),
            imperfections: Imperfections::default(),
        }
    }
}

impl Camera {
    /// The default camera with a square sensor of `side` pixels: a smaller piece of the scene at the same detail.
    pub fn with_sensor(side: usize) -> Camera {
        Camera { sensor: Size::new(side, side), ..Camera::default() }
    }

    /// The camera whose lenslets would gather as little as can be drawn: scenes drawn for it are sharp, for the truth.
    ///
    /// ```
    /// use lenslet_data_gen::simulate::Camera;
    /// let camera = Camera::with_sensor(400);
    /// assert!(camera.sharp().optics.footprint < 0.5 * camera.optics.footprint);
    /// ```
    #[must_use]
    pub fn sharp(&self) -> Camera {
        // A sensor of very many lenslets would need too many texels.
        let across = |side: usize| side as f64 / self.lenslets.pitch + 2.0 * (self.lenslets.pitch + 4.0);
        let texel = (across(self.sensor.width) * across(self.sensor.height) / (0.9 * MOST_TEXELS)).sqrt();
        let footprint = SHARP.max(texel / TEXEL).min(self.optics.footprint);
        Camera { optics: Optics { footprint, ..self.optics.clone() }, ..self.clone() }
    }

    /// A camera with the sensor, lenslets and colours of a profile (those of its measured body where it has one); the
    /// rest is that of [`Camera::default`].
    pub fn from_profile(profile: &CameraProfile) -> Camera {
        let default = Camera::default();
        let sensor = &profile.sensor;
        let measured = profile.measured.as_ref();
        let mla = measured.map(|m| &m.lenslets).or(profile.lenslets.as_ref());
        let mut colour = profile.colour();
        if let Some(m) = measured {
            colour.white_balance = m.white_balance;
            colour.ccm = m.ccm;
        }
        Camera {
            sensor: Size::new(sensor.width, sensor.height),
            lenslets: LensletGrid {
                pitch: mla.map_or(default.lenslets.pitch, |m| m.pitch),
                row_stretch: mla.map_or(default.lenslets.row_stretch, |m| m.row_stretch),
                ..default.lenslets
            },
            optics: default.optics,
            response: SensorResponse {
                colour,
                cfa: sensor.cfa,
                // A profile's levels lie within what its packing holds.
                levels: [sensor.black[1] as u16, sensor.white[1] as u16],
                ..default.response
            },
            identity: CameraIdentity {
                model: profile.models.first().cloned().unwrap_or_default(),
                // What brings captures to the brightness they were taken with.
                exposure_bias: -sensor.exposure_offset,
                white_inside: profile.white_inside,
            },
            imperfections: default.imperfections,
        }
    }

    /// The same camera with another offset (up to 5 pixels either way) and rotation (up to 0.004 radians either way) of
    /// its lenslets for every `seed`.
    ///
    /// ```
    /// use lenslet_data_gen::simulate::Camera;
    /// let [a, b] = [1, 2].map(|seed| Camera::with_sensor(256).perturbed(seed).lenslets);
    /// assert!(a.offset != b.offset && a.rotation != b.rotation && a.pitch == b.pitch);
    /// assert!(b.offset.iter().all(|o| o.abs() <= 5.0) && b.rotation.abs() <= 0.004);
    /// ```
    #[must_use]
    pub fn perturbed(mut self, seed: u64) -> Camera {
        // Multiples of three primes, so that neighbouring seeds differ in all three values.
        let share = |prime: u64| ((seed.wrapping_mul(prime) % 1000) as f64) / 1000.0;
        self.lenslets.offset = [10.0 * share(617) - 5.0, 10.0 * share(389) - 5.0];
        self.lenslets.rotation = 0.008 * share(751) - 0.004;
        self
    }

    /// Refuses what cannot be simulated.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the first value out of range.
    pub fn check(&self) -> Result<(), Error> {
        for side in [self.sensor.width, self.sensor.height] {
            if !(64..=16384).contains(&side) || side % 2 != 0 {
                return Err(Error::Parameter(format!(
                    "the sensor's sides must be even and lie in 64..=16384, not {side}"
                )));
            }
        }
        let grid = &self.lenslets;
        within("the pitch", grid.pitch, 4.0, 64.0)?;
        let count = self.sensor.width as f64 * self.sensor.height as f64 / (grid.pitch * grid.pitch);
        if count > 4e6 {
            return Err(Error::Parameter(format!("{count:.0} lenslets are too many: at most 4000000")));
        }
        within("the rotation (radians)", grid.rotation, -std::f64::consts::FRAC_PI_6, std::f64::consts::FRAC_PI_6)?;
        within("the row stretch", grid.row_stretch, 0.9, 1.1)?;
        within("the offset", grid.offset[0], -1e4, 1e4)?;
        within("the offset", grid.offset[1], -1e4, 1e4)?;
        within("the jitter", grid.jitter, 0.0, 0.1 * grid.pitch)?;
        self.optics.check()?;
        self.imperfections.check()?;
        if self.identity.white_inside && self.imperfections.jpeg.is_some() {
            return Err(Error::Parameter("a JPEG holds no white image, and this camera's captures do".to_owned()));
        }
        self.response.check()
    }

    /// The middle of the sensor (x, y), pixel centres at integers.
    #[inline]
    pub fn middle(&self) -> [f64; 2] {
        [(self.sensor.width as f64 - 1.0) / 2.0, (self.sensor.height as f64 - 1.0) / 2.0]
    }

    /// How much farther from the middle of the sensor micro-images lie than their lenslets, under a pupil shift in
    /// pitches ([`Imperfections::pupil_shift`]).
    #[inline]
    pub fn pupil_scale(&self, shift: f64) -> f64 {
        let [x, y] = self.middle();
        1.0 + shift * self.lenslets.pitch / x.hypot(y)
    }

    /// Light at squared distance `d2` (pixels²) from a lenslet centre, as a share of that at the centre.
    #[inline]
    pub fn light_at(&self, d2: f64) -> f64 {
        let r2 = d2 * 4.0 / (self.lenslets.pitch * self.lenslets.pitch);
        let floor = self.optics.floor;
        match self.optics.profile {
            LightProfile::Parabolic { falloff } => (1.0 - falloff * r2).max(floor),
            LightProfile::Gaussian { sigma } => floor + (1.0 - floor) * (-r2 / (2.0 * sigma * sigma)).exp(),
        }
    }

    /// Main-lens vignetting at a pixel: 1 in the centre, `1 − vignetting` in the corners.
    #[inline]
    pub fn vignetting_at(&self, x: f64, y: f64) -> f64 {
        let (cx, cy) = ((self.sensor.width as f64 - 1.0) / 2.0, (self.sensor.height as f64 - 1.0) / 2.0);
        1.0 - self.optics.vignetting * ((x - cx).powi(2) + (y - cy).powi(2)) / (cx * cx + cy * cy)
    }
}

impl Optics {
    fn check(&self) -> Result<(), Error> {
        within("the floor", self.floor, 0.0, 1.0)?;
        within("the optical blur", self.psf, 0.0, 2.0)?;
        within("the main-lens vignetting", self.vignetting, 0.0, 0.9)?;
        within("the lenslet footprint", self.footprint, SHARP, 1.0)?;
        match self.profile {
            LightProfile::Parabolic { falloff } => within("the falloff", falloff, 0.0, 1.0),
            LightProfile::Gaussian { sigma } => within("the profile's sigma", sigma, 0.05, 10.0),
        }
    }
}

impl SensorResponse {
    fn check(&self) -> Result<(), Error> {
        if self.levels[0] >= self.levels[1] || self.cfa == Cfa::Mono {
            return Err(Error::Parameter(
                "the sensor needs colour filters and a black level below saturation".to_owned(),
            ));
        }
        within("the exposure", self.exposure, 0.001, 1.0)?;
        for response in self.white_response {
            within("the white response", response, 0.01, 1.0)?;
        }
        for gain in self.colour.white_balance {
            within("a white balance gain", f64::from(gain), 0.1, 10.0)?;
        }
        inverse(&self.colour.ccm)
            .map(|_| ())
            .ok_or_else(|| Error::Parameter("the colour matrix cannot be inverted".to_owned()))
    }

    /// Linear sRGB → share of full scale of R, Gr, Gb, B: the inverse colour matrix, then the inverse white balance.
    pub fn filter_responses(&self) -> [[f32; 3]; 4] {
        let inverse = inverse(&self.colour.ccm).unwrap_or([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        std::array::from_fn(|plane| {
            let row = [0, 1, 1, 2][plane];
            std::array::from_fn(|c| (inverse[3 * row + c] / f64::from(self.colour.white_balance[plane])) as f32)
        })
    }
}

fn within(name: &str, value: f64, low: f64, high: f64) -> Result<(), Error> {
    if value >= low && value <= high {
        Ok(())
    } else {
        Err(Error::Parameter(format!("{name} must lie in {low}..={high}, not {value}")))
    }
}

/// Inverse of a row-major 3×3 matrix.
fn inverse(m: &[f32; 9]) -> Option<[f64; 9]> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn responses_undo_white_balance_and_colour_matrix() {
        let camera = Camera::default();
        let planes = camera.response.filter_responses();
        for colour in [[1.0f32, 1.0, 1.0], [0.7, 0.2, 0.1], [0.1, 0.4, 0.9]] {
            let raw: [f32; 4] = std::array::from_fn(|p| (0..3).map(|c| planes[p][c] * colour[c]).sum());
            assert!((raw[1] - raw[2]).abs() < 1e-6);
            let balanced = [0, 1, 3].map(|p| raw[p] * camera.response.colour.white_balance[p]);
            for row in 0..3 {
                let back: f32 = (0..3).map(|c| camera.response.colour.ccm[3 * row + c] * balanced[c]).sum();
                assert!((back - colour[row]).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn values_out_of_range_are_refused() {
        let grid = |lenslets| Camera { lenslets, ..Camera::default() };
        let optics = |optics| Camera { optics, ..Camera::default() };
        let response = |response| Camera { response, ..Camera::default() };
        let black = ColourFacts { ccm: [0.0; 9], ..SensorResponse::default().colour };
        for bad in [
            Camera { sensor: Size::new(63, 64), ..Camera::default() },
            Camera { sensor: Size::new(20000, 64), ..Camera::default() },
            grid(LensletGrid { pitch: f64::NAN, ..LensletGrid::default() }),
            grid(LensletGrid { pitch: 1.0, ..LensletGrid::default() }),
            grid(LensletGrid { jitter: 3.0, ..LensletGrid::default() }),
            grid(LensletGrid { rotation: 1.0, ..LensletGrid::default() }),
            optics(Optics { footprint: 0.0, ..Optics::default() }),
            response(SensorResponse { levels: [1023, 1023], ..SensorResponse::default() }),
            response(SensorResponse { colour: black, ..SensorResponse::default() }),
        ] {
            assert!(matches!(bad.check(), Err(Error::Parameter(_))), "{bad:?}");
        }
    }

    #[test]
    fn the_default_is_the_measured_f01() {
        let f01 = CameraProfile::find("lytro-f01").unwrap();
        assert_eq!(Camera::from_profile(&f01), Camera::default());
    }

    #[test]
    fn in_json_a_camera_is_one_flat_object() {
        let text = serde_json::to_string(&Camera::default()).unwrap();
        let order = "sensor pitch rotation row_stretch offset jitter profile floor psf vignetting footprint colour \
                     white_response cfa levels exposure model exposure_bias white_inside";
        let keys: Vec<_> = order.split_whitespace().map(|key| text.find(&format!("\"{key}\":")).unwrap()).collect();
        assert!(keys.is_sorted(), "{text}");
        assert_eq!(serde_json::from_str::<Camera>(&text).unwrap(), Camera::default());
    }
}
