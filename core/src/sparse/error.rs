//! What goes wrong in sparse coding.

/// What goes wrong in sparse coding.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An input has a NaN or an infinity.
    #[error("{what}: a value is not finite (row {row})")]
    NotFinite {
        /// Which input.
        what: &'static str,
        /// Which row.
        row: usize,
    },
    /// Shapes do not fit.
    #[error("{0}")]
    Shape(String),
    /// A parameter out of range.
    #[error("{0}")]
    Parameter(String),
}
