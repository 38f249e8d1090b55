//! Sampling on hexagonal lattices, and the interpolations of such samples (paper sections 4.1 and 4.2).
//!
//! Centres are in sensor (or photo) pixels, x right, y down, pixel centres at integers; views take them by
//! [`crate::geometry::SensorToView`]. Values are never rotated or moved, only their coordinates.

pub mod bicubic;
mod cubic;
mod error;
mod footprint;
mod gradient;
mod raster;
mod weights;

pub use cubic::Cubic;
pub use error::{Error, MAX_PIXELS};
pub use footprint::{DEFAULT_PITCH, DEFAULT_ROTATION, Footprint, lattice_points_in, lattice_samples, sample_image};
pub use weights::Weights;
