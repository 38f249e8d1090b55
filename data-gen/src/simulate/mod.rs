//! A scene of textured layers seen by a simulated lenslet camera: captures, white images, truth.
//!
//! A pixel at offset δ (sensor pixels) from the centre c of its lenslet sees the scene at c − d·δ, where d is the scene
//! point's disparity in sensor pixels per sensor pixel of offset. View (v, u) is the offset δ = (u, v)·view_step, so a
//! point at x in the central view is at x + D·u in view u, D = d·view_step·W_out/W in output pixels per view step.
//! The lenslet's own aperture low-passes what it sees: every layer is blurred by a Gaussian of [`Camera::footprint`]
//! pitches before the layers are put one over the other. The truth views are the same blurred layers seen from exactly
//! one offset, averaged over the output pixel; a sensor pixel also averages over the offsets within its own extent.

mod camera;
mod chart;
mod draw;
mod layer;
mod painting;
mod photo;
mod scene;
mod sensor;
mod truth;
mod write;

use std::path::PathBuf;

use lenslet_core::container::{CameraFacts, Capture, Levels, MlaHint};
use lenslet_core::progress::Observer;
use serde::{Deserialize, Serialize};

pub use camera::{Camera, Lenslets, Profile};
pub use chart::{FREQUENCIES, PATCHES, WHITE};
pub use draw::text;
pub use layer::{Bounds, Layer, Paint, Sheet};
pub use photo::photos;
pub use scene::{Frame, Kind, Plan, Region, Scene};
pub use sensor::{expose, expose_white, record, white_pattern};
pub use truth::{disparity, offset, output_size, view};
pub use write::{Truth, capture_name, write};

/// What goes wrong in a simulation.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A value out of range.
    #[error("{0}")]
    Parameter(String),
    /// A photo cannot be used.
    #[error("photo {}: {reason}", path.display())]
    Photo {
        /// Which file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A file of the result cannot be written.
    #[error("cannot write {}: {reason}", path.display())]
    Write {
        /// Which file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The result cannot be put in place.
    #[error(transparent)]
    Output(#[from] lenslet_core::output::Error),
    /// A capture cannot be written.
    #[error(transparent)]
    Container(#[from] lenslet_core::container::Error),
    /// The truth views cannot be written.
    #[error(transparent)]
    LightField(#[from] lenslet_core::lightfield::Error),
    /// The observer asked to stop.
    #[error("interrupted")]
    Interrupted,
}

/// How to take the pictures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// Seed of the lenslets' errors and of the noise.
    pub seed: u64,
    /// Strength of the noise: 0 none, 1 one electron a DN and 3 DN of read noise, at most 100.
    pub noise: f64,
    /// Number of white images, 0..=32.
    pub whites: usize,
}

impl Default for Options {
    fn default() -> Self {
        Options { seed: 1, noise: 0.7, whites: 2 }
    }
}

impl Options {
    /// Refuses values out of range.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the first one.
    pub fn check(&self) -> Result<(), Error> {
        if !(0.0..=100.0).contains(&self.noise) {
            return Err(Error::Parameter(format!("the noise must lie in 0..=100, not {}", self.noise)));
        }
        if self.whites > 32 {
            return Err(Error::Parameter(format!("{} white images are too many: at most 32", self.whites)));
        }
        Ok(())
    }
}

/// A capture with its white images and what is true about it.
#[derive(Debug, Clone)]
pub struct Simulation {
    /// The capture of the scene.
    pub capture: Capture,
    /// White images of the same camera, without the one that the capture carries.
    pub whites: Vec<Capture>,
    /// True lenslet centres (x, y) on the sensor, row by row.
    pub centres: Vec<[f64; 2]>,
}

/// Takes a capture of `scene` and the white images.
///
/// # Errors
/// [`Error::Parameter`] for values out of range, [`Error::Interrupted`].
pub fn render(scene: &Scene, camera: &Camera, options: &Options, observer: &dyn Observer) -> Result<Simulation, Error> {
    options.check()?;
    let lenslets = Lenslets::new(camera, options.seed)?;
    let pattern = white_pattern(camera, &lenslets);
    let signal = expose(camera, &lenslets, scene, &pattern, observer)?;
    let mut capture = facts(camera, record(&signal, camera, options.noise, options.seed, 0), false);
    let white = expose_white(camera, &pattern);
    let mut whites: Vec<Capture> = (0..options.whites)
        .map(|k| facts(camera, record(&white, camera, options.noise, options.seed, k as u32 + 1), true))
        .collect();
    if camera.white_inside && !whites.is_empty() {
        capture.white = Some(Box::new(whites.remove(0)));
    }
    Ok(Simulation { capture, whites, centres: lenslets.on_sensor() })
}

/// A mosaic with the facts a camera writes beside it.
fn facts(camera: &Camera, mosaic: lenslet_core::container::RawMosaic, white: bool) -> Capture {
    let response = camera.white_response.map(|r| (r / camera.white_response[1]) as f32);
    Capture {
        mosaic,
        cfa: camera.cfa,
        levels: Levels { black: [f32::from(camera.levels[0]); 4], white: [f32::from(camera.levels[1]); 4] },
        colour: camera.colour.clone(),
        camera: CameraFacts {
            make: Some("Lytro, Inc.".to_owned()),
            model: Some(camera.model.clone()),
            serial: Some("SIMULATED".to_owned()),
            zoom_step: Some(600),
            focus_step: Some(500),
            iso: Some(100.0),
            exposure_seconds: Some(0.01),
            exposure_bias: Some(if white { 0.0 } else { camera.exposure_bias }),
            normalized_response: white.then_some([response[0], response[1], response[1], response[2]]),
            white_ref: None,
        },
        mla: Some(MlaHint { pitch: camera.pitch, rotation: camera.rotation, row_stretch: camera.row_stretch }),
        source_sha256: String::new(),
        white: None,
        warnings: Vec::new(),
    }
}
