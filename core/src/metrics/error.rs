//! Errors of scoring.

/// Why two pictures cannot be scored.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The two pictures differ in shape.
    #[error("shapes differ: {result:?} and {reference:?}")]
    Shape {
        /// Shape of the result.
        result: Vec<usize>,
        /// Shape of the reference.
        reference: Vec<usize>,
    },
    /// Too small for the measure.
    #[error("{height}x{width} pixels are too few: at least {least} along each side")]
    Small {
        /// Height, pixels.
        height: usize,
        /// Width, pixels.
        width: usize,
        /// Smallest side, pixels.
        least: usize,
    },
    /// A value is NaN or infinite.
    #[error("values that are not finite numbers cannot be scored")]
    NotFinite,
}
