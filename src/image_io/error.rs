//! Why a picture could not be encoded.

/// Errors of encoding pictures.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A picture without pixels, or too large for the format.
    #[error("the picture cannot be encoded as {format}")]
    Encode {
        /// PNG or JPEG.
        format: &'static str,
        /// Why.
        source: image::ImageError,
    },
    /// Pictures that make no animation.
    #[error("{0}")]
    Animation(&'static str),
    /// An animated PNG could not be encoded.
    #[error(transparent)]
    Apng(#[from] png::EncodingError),
    /// An animated GIF could not be encoded.
    #[cfg(feature = "gif")]
    #[error(transparent)]
    Gif(#[from] gif::EncodingError),
}
