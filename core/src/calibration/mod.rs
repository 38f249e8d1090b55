//! Calibration: from white images to the centre of every lenslet (Algorithm 1 of the paper, section 3.2).
//!
//! ```text
//! files ─ calibrator ─► captures ─ screening ─► average ─ photometric::{hot_pixels, equalise} ─► grey sensor image
//!                                 (without white images: captures::{flatten, pattern})                  │
//!   locate                                                                                              ▼
//!   ├─ fundamentals::{spectrum, rotation, prior, phase}   the lattice in the frequency domain, over the whole sensor
//!   ├─ centres::{profile, measure, lattice_fit}           sub-pixel centres with their variance, and the lattice
//!   └─ smoothing::{illumination, shrink}                  light of the main lens; centres shrunk towards the lattice
//!                                                                                                       │
//!   photometric::vignetting ─► white image      (without white images: captures::agreement)             ▼
//!                                                              Calibration ─ file::{v1, v2} ─► .calib
//! ```
//! `pipeline` runs these steps. `paper` is Algorithm 1 as printed, for comparison: it rotates and erodes the image,
//! which the default does not. `compatibility` decides whether a capture is of the calibrated camera.
//!
//! ```
//! # mod drawn { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/common/drawn.rs")); }
//! # use drawn::*;
//! use lenslet_core::calibration::{CalibrationOptions, calibrate};
//! use lenslet_core::progress::Silent;
//!
//! let white = drawn_white(); // 160x128 pixels, hexagonal, pitch 10 pixels
//! let camera = calibrate(&[white], &CalibrationOptions::default(), &Silent)?;
//! assert!((camera.lattice.pitch() - 10.0).abs() < 0.01 && camera.lattice.rotation().abs() < 0.001);
//!
//! let [x, y] = camera.lattice.centre(0, 0); // the lenslet nearest the sensor's centre
//! let nearest = camera.centres().map(|[cx, cy]| (cx - x).hypot(cy - y)).fold(f64::INFINITY, f64::min);
//! assert!(nearest < 0.05, "measured centres lie on the lattice");
//! # Ok::<(), lenslet_core::calibration::Error>(())
//! ```

mod average;
mod calibrator;
mod captures;
mod centres;
mod checks;
mod compatibility;
mod error;
mod file;
mod fundamentals;
mod locate;
mod model;
mod options;
pub mod paper;
mod photometric;
mod pipeline;
mod screening;
mod sensor_image;
mod smoothing;
#[cfg(test)]
mod tests;

pub use calibrator::{Calibrator, open_captures};
pub use compatibility::{check_compatible, lens_setting_differences};
pub use error::Error;
pub use file::{load, save};
pub use fundamentals::spectrum::Spectrum;
pub use model::*;
pub use options::{CalibrationOptions, CalibrationVariant};
pub use photometric::hot_pixels::find_hot_pixels;
pub use pipeline::{calibrate, calibrate_from_captures};
pub use screening::screen_captures;
pub use sensor_image::SensorImage;
