//! Sampling: hexagonal lattices, their triangulation, and the interpolations built on it (paper sections 4.1 and 4.2).
//!
//! Coordinates follow one convention everywhere. Centres are in sensor (or photo) pixels, x right, y down, pixel
//! centres at integers. Output pixel (s, t) of a W'-wide view of a W-wide sensor stands at x = (s + ½)·W/W' − ½,
//! and the same for y. Values are never rotated or moved, only their coordinates.

pub mod bicubic;
mod cubic;
mod delaunay;
mod gradient;
mod hex;
pub mod patches;
mod raster;
mod weights;

pub use cubic::Cubic;
pub use delaunay::{Triangulation, triangulate};
pub use hex::{DEFAULT_PITCH, DEFAULT_ROTATION, Footprint, Placed, hexagonal, lattice_samples, place, sample_image};
pub use weights::Weights;

/// Largest number of output pixels one table or view may have (a 16384×16384 view).
pub const MAX_PIXELS: usize = 1 << 28;

/// What goes wrong in sampling; all of it is the caller's input.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A coordinate is NaN, infinite or absurdly large.
    #[error("centre {0} is not a finite position near the sensor")]
    NotFinite(usize),
    /// Two centres share one place.
    #[error("two of the {0} centres share one place")]
    Duplicate(usize),
    /// The centres span no area.
    #[error("{0} centres span no triangle: at least three that are not on one line are needed")]
    Flat(usize),
    /// An image or grid size that cannot be.
    #[error("{what} {width}x{height} is out of range (1x1 up to {max} pixels)")]
    Size {
        /// Which one.
        what: &'static str,
        /// Its width.
        width: usize,
        /// Its height.
        height: usize,
        /// The most pixels it may have.
        max: usize,
    },
    /// Arrays that do not belong together.
    #[error("{0}")]
    Shape(String),
    /// A parameter out of range.
    #[error("{0}")]
    Parameter(String),
}

pub(crate) fn check_size(what: &'static str, width: usize, height: usize) -> Result<(), Error> {
    match width.checked_mul(height) {
        Some(n) if n > 0 && n <= MAX_PIXELS => Ok(()),
        _ => Err(Error::Size { what, width, height, max: MAX_PIXELS }),
    }
}
