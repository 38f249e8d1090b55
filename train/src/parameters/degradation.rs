//! Parameters of what the camera makes of a sharp crop.

use lenslet_core::dictionary::Footprint;
use lenslet_core::interpolation::Interpolation;
use lenslet_data_gen::pairs::{CameraLattice, Degradation};

use super::range::within;
use crate::error::Error;

/// What the camera makes of a sharp crop.
///
/// | name | default | purpose | range |
/// |---|---|---|---|
/// | `footprints` | lenslet, point | what a sample is, one model for each; grid: a rectangular grid | 1 to 4 of them |
/// | `base` | by footprint | interpolation of the low images: barycentric; bicubic for grids; or multiview | |
/// | `pitch` | 1080/328 | distance of the samples, output pixels | 1 … 64 |
/// | `rotation` | 0.002 | rotation of the lattice, radians | −π … π |
/// | `noise` | 0 | standard deviation of noise on the samples (range 0..1) | 0 … 1 |
/// | `lattice` | none | the lenslets of a calibrated camera instead of `pitch` and `rotation`; in JSON the SHA-256 of their centres, which names them but cannot stand for them | |
///
/// The base `multiview` is for [`crate::train_on_crops`], whose crops the caller makes.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs)] // in the table above
pub struct DegradationParameters {
    pub footprints: Vec<Footprint>,
    pub base: Option<Interpolation>,
    pub pitch: f64,
    pub rotation: f64,
    pub noise: f32,
    pub lattice: Option<CameraLattice>,
}

impl Default for DegradationParameters {
    fn default() -> Self {
        DegradationParameters {
            footprints: vec![Footprint::Lenslet, Footprint::Point],
            base: None,
            pitch: 1080.0 / 328.0,
            rotation: 0.002,
            noise: 0.0,
            lattice: None,
        }
    }
}

impl DegradationParameters {
    /// The degradation of one footprint.
    #[must_use]
    pub fn for_footprint(&self, footprint: Footprint) -> Degradation {
        let plain = if footprint == Footprint::Grid { Interpolation::Bicubic } else { Interpolation::Barycentric };
        let base = self.base.unwrap_or(plain);
        Degradation {
            pitch: self.pitch,
            rotation: self.rotation,
            footprint,
            base,
            noise: self.noise,
            lattice: self.lattice.clone(),
        }
    }

    pub(super) fn check(&self) -> Result<(), Error> {
        within("pitch", self.pitch, 1.0, 64.0)?;
        within("rotation", self.rotation, -std::f64::consts::PI, std::f64::consts::PI)?;
        within("noise", self.noise, 0.0, 1.0)?;
        if self.lattice.as_ref().is_some_and(|l| !l.has_points()) {
            return Err(Error::Parameter("lattice: name the calibration whose lenslets these parameters have".into()));
        }
        if self.footprints.is_empty() || self.footprints.len() > 4 {
            return Err(Error::Parameter("one to four footprints are needed".into()));
        }
        Ok(())
    }
}
