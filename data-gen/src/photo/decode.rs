//! Photo files to upright pictures, bounded in size.

use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ImageDecoder};
use lenslet_core::digest::sha256_hex;
use lenslet_core::picture_file;

use super::error::Error;

/// Most bytes of a photo's file.
/// Source: chosen; twice the default of the `image` crate.
const LONGEST: u64 = 1 << 30;
/// Bytes taken for each pixel of a photo besides the decoded picture: its luminance.
const WORKING: u64 = 4;

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
    if length > LONGEST {
        return Err(Error::TooLong { path: path.to_path_buf(), length });
    }
    let bytes = lenslet_core::input::read_regular(path, LONGEST).map_err(unread)?;
    let mut decoder = picture_file::open_decoder(Cursor::new(&bytes), length, WORKING).map_err(undecoded)?;
    let orientation = decoder.orientation().map_err(|e| undecoded(e.into()))?;
    let (width, height) = decoder.dimensions();
    let (width, height) = (width as usize, height as usize);
    if width.min(height) < least {
        return Err(Error::TooFewPixels { path: path.to_path_buf(), width, height, least });
    }
    if width.saturating_mul(height) > most {
        return Err(Error::TooManyPixels { path: path.to_path_buf(), width, height });
    }
    let mut picture = picture_file::decode_pixels(decoder).map_err(undecoded)?;
    picture.apply_orientation(orientation);
    Ok(DecodedPhoto { picture, sha256: sha256_hex(&bytes) })
}
