//! Photo files to upright pictures, bounded in size.

use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ImageDecoder, ImageReader, Limits};
use lenslet_core::digest::sha256_hex;

use super::error::Error;

/// Bytes that decoding one photo may take, and most bytes of its file.
/// Source: chosen; twice the default of the `image` crate.
const MEMORY: u64 = 1 << 30;

/// A decoded photo, turned upright by its EXIF orientation.
pub(crate) struct DecodedPhoto {
    /// The picture in the file's own colours and depth.
    pub(crate) picture: DynamicImage,
    /// SHA-256 of the file, hexadecimal.
    pub(crate) sha256: String,
}

/// Reads and decodes a photo whose shorter side has at least `least` pixels and that has at most `most` pixels in all.
///
/// # Errors
/// [`Error::Read`], [`Error::Decode`], [`Error::TooLong`], [`Error::TooFewPixels`], [`Error::TooManyPixels`].
pub(crate) fn decode_photo(path: &Path, least: usize, most: usize) -> Result<DecodedPhoto, Error> {
    let unread = |reason| Error::Read { path: path.to_path_buf(), reason };
    let undecoded = |reason| Error::Decode { path: path.to_path_buf(), reason };
    let length = std::fs::metadata(path).map_err(unread)?.len();
    if length > MEMORY {
        return Err(Error::TooLong { path: path.to_path_buf(), length });
    }
    let bytes = lenslet_core::input::read_regular(path, MEMORY).map_err(unread)?;
    let mut reader = ImageReader::new(Cursor::new(&bytes)).with_guessed_format().map_err(unread)?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(MEMORY);
    reader.limits(limits);
    let mut decoder = reader.into_decoder().map_err(undecoded)?;
    let orientation = decoder.orientation().map_err(undecoded)?;
    let (width, height) = decoder.dimensions();
    let (width, height) = (width as usize, height as usize);
    if width.min(height) < least {
        return Err(Error::TooFewPixels { path: path.to_path_buf(), width, height, least });
    }
    if width.saturating_mul(height) > most {
        return Err(Error::TooManyPixels { path: path.to_path_buf(), width, height });
    }
    let mut picture = DynamicImage::from_decoder(decoder).map_err(undecoded)?;
    picture.apply_orientation(orientation);
    Ok(DecodedPhoto { picture, sha256: sha256_hex(&bytes) })
}
