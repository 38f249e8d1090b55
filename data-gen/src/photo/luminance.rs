//! A photo as one plane of sRGB-encoded luminance, which training pairs are cut from.

use std::path::Path;

use image::DynamicImage;
use lenslet_core::colour::{LUMINANCE, srgb_encode};
use lenslet_core::lightfield::ColourSpace;
use ndarray::Array2;

use super::decode::decode_photo;
use super::error::Error;

/// Range of values below which a photo counts as being of one colour, of 0..1.
/// Source: chosen, two steps of 8 bits.
const FLAT: f32 = 2.0 / 255.0;

/// A photo ready for cropping.
#[derive(Debug, Clone)]
pub struct LuminancePhoto {
    /// File name without folders.
    pub name: String,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
    /// Luminance 0.299 R + 0.587 G + 0.114 B of the sRGB-encoded values, 0..1, shape (rows, columns).
    pub luminance: Array2<f32>,
}

/// Reads a photo of any size the `image` crate can decode (8 or 16 bit, grey or colour; transparency is ignored),
/// turned upright by its EXIF orientation. `encoding` is what the file's values are: sRGB-encoded ones are taken as
/// they are, linear ones are encoded first, channel by channel.
///
/// # Errors
/// When the file cannot be read or decoded, needs more memory than a file of its length
/// may take, is smaller than `least` pixels a side, or of one
/// colour.
pub fn load_luminance(path: &Path, least: usize, encoding: ColourSpace) -> Result<LuminancePhoto, Error> {
    let decoded = decode_photo(path, least, usize::MAX)?;
    let luminance = luminance_of(&decoded.picture, encoding);
    let (low, high) = luminance.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), &v| (l.min(v), h.max(v)));
    if !(high > low + FLAT) {
        return Err(Error::OneColour { path: path.to_path_buf() });
    }
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    Ok(LuminancePhoto { name, sha256: decoded.sha256, luminance })
}

fn luminance_of(photo: &DynamicImage, encoding: ColourSpace) -> Array2<f32> {
    let (w, h) = (photo.width() as usize, photo.height() as usize);
    let encode = |v: f32| if encoding == ColourSpace::Linear { srgb_encode(v) } else { v };
    let weigh = |p: [f32; 3]| {
        let p = p.map(encode);
        let y = LUMINANCE[0] * p[0] + LUMINANCE[1] * p[1] + LUMINANCE[2] * p[2];
        if y.is_finite() { y.clamp(0.0, 1.0) } else { 0.0 }
    };
    // Pixel by pixel, without a copy of the photo in floating point.
    fn gather<T: Copy>(
        raw: &[T],
        channels: usize,
        one: impl Fn(T) -> f32,
        weigh: impl Fn([f32; 3]) -> f32,
    ) -> Vec<f32> {
        // One channel, or one and alpha: grey.
        let colour = |p: &[T]| if channels < 3 { [one(p[0]); 3] } else { [one(p[0]), one(p[1]), one(p[2])] };
        raw.chunks_exact(channels).map(|p| weigh(colour(p))).collect()
    }
    let (eight, sixteen) = (|v: u8| f32::from(v) / 255.0, |v: u16| f32::from(v) / 65535.0);
    let values: Vec<f32> = match photo {
        DynamicImage::ImageLuma8(p) => gather(p.as_raw(), 1, eight, weigh),
        DynamicImage::ImageLumaA8(p) => gather(p.as_raw(), 2, eight, weigh),
        DynamicImage::ImageRgb8(p) => gather(p.as_raw(), 3, eight, weigh),
        DynamicImage::ImageRgba8(p) => gather(p.as_raw(), 4, eight, weigh),
        DynamicImage::ImageLuma16(p) => gather(p.as_raw(), 1, sixteen, weigh),
        DynamicImage::ImageLumaA16(p) => gather(p.as_raw(), 2, sixteen, weigh),
        DynamicImage::ImageRgb16(p) => gather(p.as_raw(), 3, sixteen, weigh),
        DynamicImage::ImageRgba16(p) => gather(p.as_raw(), 4, sixteen, weigh),
        other => gather(other.to_rgb32f().as_raw(), 3, |v: f32| v, weigh),
    };
    Array2::from_shape_vec((h, w), values).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photo::find_photos;

    #[test]
    fn unusable_photos_are_refused_with_a_reason() {
        let folder = tempfile::tempdir().unwrap();
        let at = |n: &str| folder.path().join(n);
        std::fs::write(at("text.jpg"), b"not a photo").unwrap();
        std::fs::write(at("empty.png"), b"").unwrap();
        image::GrayImage::from_pixel(64, 64, image::Luma([7])).save(at("flat.png")).unwrap();
        image::GrayImage::from_fn(1, 1, |_, _| image::Luma([7])).save(at("tiny.png")).unwrap();
        for (name, why) in [("text.jpg", ""), ("empty.png", ""), ("flat.png", "one colour"), ("tiny.png", "too few")] {
            let error = load_luminance(&at(name), 32, ColourSpace::Srgb).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains(why), "{error}");
        }
        assert_eq!(find_photos(&[folder.path().to_path_buf()]).unwrap().len(), 4);
        assert!(find_photos(&[at("absent")]).is_err());
    }

    #[test]
    fn sixteen_bit_and_transparent_photos_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep.png");
        image::ImageBuffer::from_fn(40, 50, |x, y| image::Rgba([x as u16 * 1000, y as u16 * 1000, 0, 9]))
            .save(&path)
            .unwrap();
        let photo = load_luminance(&path, 32, ColourSpace::Srgb).unwrap();
        assert_eq!(photo.luminance.dim(), (50, 40));
        let truth = (0.299 * 10_000.0 + 0.587 * 20_000.0) / 65535.0;
        assert!((photo.luminance[[20, 10]] - truth).abs() < 1e-5);
        assert_eq!(photo.sha256.len(), 64);
    }

    /// A JPEG with an orientation in its EXIF block.
    fn turned(photo: &image::GrayImage, orientation: u8) -> Vec<u8> {
        let mut jpeg = Vec::new();
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 95).encode_image(photo).unwrap();
        let mut exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
        exif.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
        let mut out = jpeg[..2].to_vec();
        out.extend([0xff, 0xe1]);
        out.extend(((exif.len() + 2) as u16).to_be_bytes());
        out.extend(exif);
        out.extend(&jpeg[2..]);
        out
    }

    #[test]
    fn photos_of_every_orientation_are_turned_upright() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.jpg");
        let photo = image::GrayImage::from_fn(80, 60, |x, y| image::Luma([(2 * x + y) as u8]));
        let upright = |x: usize, y: usize| (2 * x + y) as f32 / 255.0;
        let stored = |orientation| {
            std::fs::write(&path, turned(&photo, orientation)).unwrap();
            load_luminance(&path, 32, ColourSpace::Srgb).unwrap().luminance
        };
        let plain = stored(1);
        let half = stored(3);
        let quarter = stored(6);
        assert_eq!((plain.dim(), half.dim(), quarter.dim()), ((60, 80), (60, 80), (80, 60)));
        for (x, y) in [(5, 7), (70, 20), (33, 50)] {
            assert!((plain[[y, x]] - upright(x, y)).abs() < 0.02);
            assert!((half[[59 - y, 79 - x]] - upright(x, y)).abs() < 0.02);
            // Turned to the right by a quarter: columns become rows.
            assert!((quarter[[x, 59 - y]] - upright(x, y)).abs() < 0.02);
        }
    }

    #[test]
    fn linear_light_is_encoded_where_declared() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("linear.png");
        image::ImageBuffer::from_fn(40, 40, |x, _| image::Luma([x as u16 * 1600])).save(&path).unwrap();
        let (plain, encoded) = (
            load_luminance(&path, 32, ColourSpace::Srgb).unwrap(),
            load_luminance(&path, 32, ColourSpace::Linear).unwrap(),
        );
        let value = plain.luminance[[3, 10]];
        assert!((value - 16_000.0 / 65_535.0).abs() < 1e-4);
        let truth = 1.055 * value.powf(1.0 / 2.4) - 0.055;
        assert!((encoded.luminance[[3, 10]] - truth).abs() < 1e-4, "{}", encoded.luminance[[3, 10]]);
    }

    #[test]
    fn cmyk_photos_become_luminance() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/reference/cmyk.jpg");
        let photo = load_luminance(&path, 32, ColourSpace::Srgb).unwrap();
        assert_eq!(photo.luminance.dim(), (96, 128));
        // C = 2x, M = 2y, Y = 40, K = 0 or 60 of 255 as it was written; light is (1 − ink)·(1 − K).
        for (x, y) in [(8usize, 8usize), (100, 8), (8, 80), (56, 56)] {
            let ink = |v: f32| 1.0 - v / 255.0;
            let black = if (x / 16 + y / 16) % 2 == 1 { 0.0 } else { 60.0 };
            let light = 0.299 * ink(2.0 * x as f32) + 0.587 * ink(2.0 * y as f32) + 0.114 * ink(40.0);
            let found = photo.luminance[[y, x]];
            assert!((found - light * ink(black)).abs() < 0.04, "({x}, {y}): {found} {}", light * ink(black));
        }
    }
}
