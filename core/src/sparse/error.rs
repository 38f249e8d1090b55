//! Errors of sparse coding.

/// Errors of sparse coding; each is caused by the caller's input.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An input has a NaN or an infinity.
    #[error("{what}: a value is not finite (row {row})")]
    NotFinite {
        /// Name of the input.
        what: &'static str,
        /// Row of the value, from 0.
        row: usize,
    },
    /// Shapes do not fit.
    #[error("{0}")]
    Shape(String),
    /// A parameter out of range.
    #[error("{0}")]
    Parameter(String),
}
