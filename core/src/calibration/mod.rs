//! Algorithm 1 of the paper (section 3.2): from white images to the centre of every lenslet.
//!
//! Steps, a file each: `average` (several whites), `equalise` (demosaic by equal channels, grey), `spectrum` and `rotation`
//! (the lattice in the frequency domain), `phase` (over the whole sensor), `profile` and `measure` (sub-pixel centres),
//! `lattice` (the regular grid), `shrink` (each centre as far as the image is sure of it), `file` (the model on disk).

mod average;
mod equalise;
mod error;
mod field;
mod file;
mod lattice;
mod linear;
mod measure;
mod model;
mod phase;
mod plane;
mod profile;
mod refine;
mod rotation;
mod shrink;
mod spectrum;

pub use error::Error;
pub use file::{load, save};
pub use model::*;
pub use plane::Plane;

use crate::container::Capture;
use crate::progress::Observer;

/// How a camera is calibrated.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Options {
    /// Leave out the vignetting pattern (centres only; quicker).
    pub without_vignetting: bool,
}

/// Calibrates a camera from one or several white images (captures of an evenly lit white surface).
///
/// # Errors
/// Images that do not fit together, are black or saturated, or show no lenslet pattern; [`Error::Interrupted`].
pub fn calibrate(whites: &[Capture], options: &Options, observer: &dyn Observer) -> Result<Calibration, Error> {
    observer.begin("calibrate", 6);
    let mut plane = average::average(whites, |v| v)?;
    equalise::equalise(&mut plane);
    let refined = refine::refine(&mut plane, observer)?;
    let first = &whites[0];
    let accepted = 1.0 - refined.shrunk.rejected;
    let peak = 1.0 - 1.0 / refined.prominence.max(1.0).sqrt();
    let vignetting = (!options.without_vignetting).then(|| {
        let scale = 32768.0 / (refined.field.full() * refined.profile.at(0.0)) as f32;
        use rayon::prelude::*;
        Vignetting {
            width: plane.width,
            height: plane.height,
            white: plane.data.par_iter().map(|&v| (v * scale).round().clamp(0.0, 65535.0) as u16).collect(),
        }
    });
    Ok(Calibration {
        width: plane.width,
        height: plane.height,
        lattice: refined.lattice,
        lenslets: refined.lenslets,
        quality: Quality {
            residual_rms: refined.shrunk.residual_rms,
            scatter: refined.shrunk.scatter,
            noise: refined.shrunk.noise,
            rejected: refined.shrunk.rejected,
            confidence: (refined.coherence * peak * accepted).clamp(0.0, 1.0),
        },
        vignetting,
        origin: Origin {
            method: "white".into(),
            model: first.camera.model.clone(),
            serial: first.camera.serial.clone(),
            zoom_step: first.camera.zoom_step,
            focus_step: first.camera.focus_step,
            sources: whites.iter().map(|w| w.source_sha256.clone()).collect(),
        },
    })
}
