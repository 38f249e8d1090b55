//! Errors of sampling, and the largest size of a picture.

use crate::geometry::Size;
use crate::geometry::TriangulationError;

/// Largest number of output pixels one table or view may have (a 16384×16384 view).
pub const MAX_PIXELS: usize = 1 << 28;

/// Errors of sampling; each is caused by the caller's input.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A coordinate is NaN, infinite or 1e9 and more.
    #[error("centre {0} is not a finite position near the sensor")]
    NotFinite(usize),
    /// The centres cannot be triangulated.
    #[error(transparent)]
    Triangulation(#[from] TriangulationError),
    /// An image or grid size out of range.
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
    /// Arrays whose shapes do not fit each other.
    #[error("{0}")]
    Shape(String),
    /// A parameter out of range.
    #[error("{0}")]
    Parameter(String),
}

/// Refuses a size of zero or of more than [`MAX_PIXELS`].
pub(super) fn check_size(what: &'static str, size: Size) -> Result<(), Error> {
    match size.pixels() {
        Some(n) if n > 0 && n <= MAX_PIXELS => Ok(()),
        _ => Err(Error::Size { what, width: size.width, height: size.height, max: MAX_PIXELS }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_size_is_a_size() {
        assert!(check_size("view", Size::new(MAX_PIXELS, 1)).is_ok() && check_size("view", Size::new(1, 1)).is_ok());
        assert!(
            check_size("view", Size::new(MAX_PIXELS + 1, 1)).is_err() && check_size("view", Size::new(1, 0)).is_err()
        );
    }
}
