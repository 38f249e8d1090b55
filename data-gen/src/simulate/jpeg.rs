//! A mosaic saved as an 8-bit grey JPEG, as some captures are handed on.

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder as _};
use lenslet_core::container::{Capture, RawMosaic, frame_metadata};

use super::error::Error;

/// A mosaic saved as JPEG.
#[derive(Debug, Clone)]
pub struct SavedMosaic {
    /// The JPEG.
    pub file: Vec<u8>,
    /// What the capture said of its frame before, as JSON to lie beside it: a JPEG alone does not say its levels and colours.
    pub metadata: Vec<u8>,
}

/// Saves the capture's mosaic as JPEG of `quality`, 0 to the white level being the full range of 8 bits; the capture then
/// holds what is read back from it, with its levels in the file's steps.
pub fn save_as_jpeg(capture: &mut Capture, quality: u8) -> Result<SavedMosaic, Error> {
    let metadata = frame_metadata(capture);
    let fault = |e: image::ImageError| Error::Parameter(format!("the mosaic cannot be saved as JPEG: {e}"));
    let RawMosaic { width, height, data } = &capture.mosaic;
    let full = capture.levels.white.iter().copied().fold(1.0, f32::max);
    let scale = 255.0 / full;
    let steps: Vec<u8> = data.iter().map(|v| (f32::from(*v) * scale).round().clamp(0.0, 255.0) as u8).collect();
    let mut file = Vec::new();
    JpegEncoder::new_with_quality(&mut file, quality)
        .write_image(&steps, *width as u32, *height as u32, ExtendedColorType::L8)
        .map_err(fault)?;
    let read = image::load_from_memory(&file).map_err(fault)?.into_luma8();
    capture.mosaic.data = read.into_raw().into_iter().map(u16::from).collect();
    capture.levels.black = capture.levels.black.map(|v| v * scale);
    capture.levels.white = capture.levels.white.map(|v| v * scale);
    capture.jpeg = true;
    Ok(SavedMosaic { file, metadata })
}

#[cfg(test)]
mod tests {
    use lenslet_core::container::{Cfa, Levels};

    use super::*;

    #[test]
    fn the_mosaic_is_what_the_file_holds_and_the_error_falls_with_quality() {
        let data: Vec<u16> = (0..64 * 48).map(|k| 400 + ((k % 64) * (k / 64)) as u16 % 3000).collect();
        let levels = Levels { black: [168.0; 4], white: [4095.0; 4] };
        let plain = Capture::bare(RawMosaic { width: 64, height: 48, data }, Cfa::Bggr, levels);
        let error = |quality| {
            let mut saved = plain.clone();
            let file = save_as_jpeg(&mut saved, quality).unwrap().file;
            let read = image::load_from_memory(&file).unwrap().into_luma8();
            assert!(saved.mosaic.data.iter().zip(read.as_raw()).all(|(a, b)| *a == u16::from(*b)));
            assert!(saved.jpeg && saved.levels.white == [255.0; 4]);
            assert!((saved.levels.black[0] - 168.0 * 255.0 / 4095.0).abs() < 1e-4);
            let off = |(a, b): (&u16, &u16)| (f64::from(*a) * 4095.0 / 255.0 - f64::from(*b)).powi(2);
            (saved.mosaic.data.iter().zip(&plain.mosaic.data).map(off).sum::<f64>() / 3072.0).sqrt()
        };
        let (fine, coarse) = (error(100), error(10));
        // 16 steps of the sensor a step of the file: 4.6 of rounding alone.
        assert!(fine < 12.0 && coarse > 3.0 * fine, "{fine} {coarse}");
    }
}
