//! Still pictures as the bytes of a file: PNG of 8-bit colour and of 16-bit grey, JPEG.

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use ndarray::Array2;

use super::error::Error;
use super::picture::Picture;

impl Picture {
    /// The bytes of a PNG file.
    ///
    /// # Errors
    /// [`Error::Encode`] when the picture is empty.
    ///
    /// ```
    /// use lenslet::image_io::Picture;
    ///
    /// let bytes = Picture { width: 2, height: 1, rgb: vec![0, 80, 160, 255, 255, 255] }.to_png()?;
    /// assert!(bytes.starts_with(b"\x89PNG"));
    /// # Ok::<(), lenslet::image_io::Error>(())
    /// ```
    pub fn to_png(&self) -> Result<Vec<u8>, Error> {
        let mut bytes = Vec::new();
        PngEncoder::new_with_quality(&mut bytes, CompressionType::Default, FilterType::Adaptive)
            .write_image(&self.rgb, self.width as u32, self.height as u32, ExtendedColorType::Rgb8)
            .map_err(|source| Error::Encode { format: "PNG", source })?;
        Ok(bytes)
    }

    /// The bytes of a JPEG file of `quality` 1 to 100.
    ///
    /// # Errors
    /// [`Error::Encode`] when the picture is empty or has more than 65535 pixels a side.
    pub fn to_jpeg(&self, quality: u8) -> Result<Vec<u8>, Error> {
        let mut bytes = Vec::new();
        JpegEncoder::new_with_quality(&mut bytes, quality)
            .write_image(&self.rgb, self.width as u32, self.height as u32, ExtendedColorType::Rgb8)
            .map_err(|source| Error::Encode { format: "JPEG", source })?;
        Ok(bytes)
    }
}

/// The bytes of a 16-bit grey PNG file of `values` (t, s): 0 becomes 0 and 1 becomes 65535; values outside are cut.
///
/// # Errors
/// [`Error::Encode`] when there are no values.
pub fn grey16_png(values: &Array2<f32>) -> Result<Vec<u8>, Error> {
    let (height, width) = values.dim();
    let data: Vec<u8> =
        values.iter().flat_map(|v| ((v.clamp(0.0, 1.0) * 65535.0 + 0.5) as u16).to_ne_bytes()).collect();
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(&data, width as u32, height as u32, ExtendedColorType::L16)
        .map_err(|source| Error::Encode { format: "PNG", source })?;
    Ok(bytes)
}
