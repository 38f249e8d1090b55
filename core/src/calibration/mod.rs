//! Algorithm 1 of the paper (section 3.2): from white images to the centre of every lenslet.
//!
//! Steps, a file each: `gamma`, `average` (several whites), `equalise` (demosaic by equal channels, grey), `stretch`; `spectrum` and
//! `rotation` (the lattice in the frequency domain), `turn`; `erosion`, `maxima`, `paraboloid`, `triangulation`; `lattice` (the
//! regular grid). `paper` runs them as the paper does. `refine`, the default, keeps the image as it is and goes from the
//! spectrum to `phase` (the lattice over the whole sensor), `profile` and `measure` (sub-pixel centres with their variance),
//! `field` (broad light) and `shrink` (each centre as far as the image is sure of it). `captures` does without white images,
//! `vignetting` keeps the pattern, `file` the model on disk, `fits` tells whether a capture is this camera's. `usable` passes over bad
//! images, `hot` finds hot pixels in black ones, `guess` begins from what metadata say of the lattice.

mod average;
mod captures;
mod centres;
mod checks;
mod compatibility;
mod error;
pub mod figures;
mod file;
mod fundamentals;
mod lattice;
mod linear;
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
