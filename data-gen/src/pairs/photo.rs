//! Photos as planes of sRGB-encoded luminance: found in folders, decoded upright, shrunk to tame JPEG blocks.

use std::f64::consts::PI;
use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageDecoder, ImageReader, Limits};
use lenslet_core::digest::sha256_hex;
use lenslet_core::lightfield::colour;
use ndarray::{Array2, ArrayView2};

use super::Error;

/// File names (lower case) that count as photos when a folder is searched.
const EXTENSIONS: [&str; 8] = ["jpg", "jpeg", "png", "tif", "tiff", "ppm", "pgm", "pnm"];
/// Decoding one photo may take this much memory.
const MEMORY: u64 = 1 << 30;

/// A photo ready for cropping.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// File name without folders.
    pub name: String,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
    /// Luminance 0.299 R + 0.587 G + 0.114 B of the encoded values, 0..1, shape (rows, columns).
    pub luminance: Array2<f32>,
}

/// Files as given, and the photos inside folders as given (sorted by name, subfolders too).
///
/// # Errors
/// A path that does not exist, or a folder that cannot be listed.
pub fn find_photos(inputs: &[PathBuf]) -> Result<Vec<PathBuf>, Error> {
    let mut found = Vec::new();
    for input in inputs {
        let wrong = |e: std::io::Error| Error::Photo { path: input.display().to_string(), reason: e.to_string() };
        if std::fs::metadata(input).map_err(wrong)?.is_dir() {
            walk(input, 0, &mut found).map_err(wrong)?;
        } else {
            found.push(input.clone());
        }
    }
    Ok(found)
}

fn walk(folder: &Path, depth: usize, found: &mut Vec<PathBuf>) -> std::io::Result<()> {
    let mut entries = std::fs::read_dir(folder)?.collect::<Result<Vec<_>, _>>()?;
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let path = entry.path();
        // Links are followed to files but not to folders, which might lead in a circle.
        if entry.file_type()?.is_dir() {
            if depth < 16 {
                walk(&path, depth + 1, found)?;
            }
        } else {
            let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
            if extension.is_some_and(|e| EXTENSIONS.contains(&e.as_str())) && path.is_file() {
                found.push(path);
            }
        }
    }
    Ok(())
}

/// Reads a photo of any size the `image` crate can decode (8 or 16 bit, grey or colour; transparency is ignored), turned
/// upright by its EXIF orientation. All values are taken as sRGB-encoded; see [`load_photo_in`] for linear light.
///
/// # Errors
/// [`Error::Photo`] when the file cannot be read or decoded, is larger than the memory limit, smaller than `least` pixels a
/// side, or of one colour.
pub fn load_photo(path: &Path, least: usize) -> Result<Loaded, Error> {
    load_photo_in(path, least, false)
}

/// As [`load_photo`]; with `linear_light` the file's values are linear and are sRGB-encoded first, channel by channel.
///
/// # Errors
/// As [`load_photo`].
pub fn load_photo_in(path: &Path, least: usize, linear_light: bool) -> Result<Loaded, Error> {
    let wrong = |reason: String| Error::Photo { path: path.display().to_string(), reason };
    let length = std::fs::metadata(path).map_err(|e| wrong(e.to_string()))?.len();
    if length > MEMORY {
        return Err(wrong(format!("{length} bytes are too many for a photo")));
    }
    let bytes = std::fs::read(path).map_err(|e| wrong(e.to_string()))?;
    let mut reader =
        ImageReader::new(std::io::Cursor::new(&bytes)).with_guessed_format().map_err(|e| wrong(e.to_string()))?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(MEMORY);
    reader.limits(limits);
    let mut decoder = reader.into_decoder().map_err(|e| wrong(e.to_string()))?;
    let orientation = decoder.orientation().map_err(|e| wrong(e.to_string()))?;
    let (w, h) = decoder.dimensions();
    if (w.min(h) as usize) < least {
        return Err(wrong(format!("{w}x{h} pixels are too few, {least} a side are needed")));
    }
    let mut photo = DynamicImage::from_decoder(decoder).map_err(|e| wrong(e.to_string()))?;
    photo.apply_orientation(orientation);
    let luminance = luminance(&photo, linear_light);
    let (low, high) = luminance.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), &v| (l.min(v), h.max(v)));
    if high.partial_cmp(&(low + 2.0 / 255.0)) != Some(std::cmp::Ordering::Greater) {
        return Err(wrong("it is of one colour".into()));
    }
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let sha256 = sha256_hex(&bytes);
    Ok(Loaded { name, sha256, luminance })
}

fn luminance(photo: &DynamicImage, linear_light: bool) -> Array2<f32> {
    let mut rgb = photo.to_rgb32f();
    let (w, h) = rgb.dimensions();
    if linear_light {
        rgb.iter_mut().for_each(|v| *v = colour::encode(*v));
    }
    let weigh = |p: &[f32]| {
        let y = 0.299 * p[0] + 0.587 * p[1] + 0.114 * p[2];
        if y.is_finite() { y.clamp(0.0, 1.0) } else { 0.0 }
    };
    let values: Vec<f32> = rgb.as_raw().chunks_exact(3).map(weigh).collect();
    Array2::from_shape_vec((h as usize, w as usize), values).unwrap_or_default()
}

/// Kernel of a reduction, widened by its factor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kernel {
    /// Lanczos-3, the sharper one.
    Lanczos,
    /// Bicubic (a = −½), as super-resolution protocols shrink.
    Bicubic,
}

impl Kernel {
    fn reach(self) -> f64 {
        match self {
            Kernel::Lanczos => 3.0,
            Kernel::Bicubic => 2.0,
        }
    }

    fn value(self, x: f64) -> f64 {
        let x = x.abs();
        if x >= self.reach() {
            return 0.0;
        }
        let sinc = |x: f64| if x < 1e-9 { 1.0 } else { (PI * x).sin() / (PI * x) };
        match self {
            Kernel::Lanczos => sinc(x) * sinc(x / 3.0),
            Kernel::Bicubic if x < 1.0 => (1.5 * x - 2.5) * x * x + 1.0,
            Kernel::Bicubic => ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0,
        }
    }
}

/// Shrinks a plane to `rows`×`columns` (neither larger than it is) with a kernel widened accordingly.
///
/// # Errors
/// Sizes of zero or larger than the plane.
pub fn reduce(plane: ArrayView2<'_, f32>, rows: usize, columns: usize, kernel: Kernel) -> Result<Array2<f32>, Error> {
    let (h, w) = plane.dim();
    if rows == 0 || columns == 0 || rows > h || columns > w {
        return Err(Error::Parameter(format!("a plane of {w}x{h} pixels cannot be shrunk to {columns}x{rows}")));
    }
    let half = shrink(plane, rows, kernel);
    Ok(shrink(half.t(), columns, kernel).reversed_axes().as_standard_layout().into_owned())
}

/// Shrinks along the first axis.
fn shrink(plane: ArrayView2<'_, f32>, count: usize, kernel: Kernel) -> Array2<f32> {
    let n = plane.nrows();
    if count == n {
        return plane.to_owned();
    }
    let scale = n as f64 / count as f64;
    let reach = kernel.reach() * scale;
    let mut out = Array2::<f32>::zeros((count, plane.ncols()));
    for (i, mut row) in out.rows_mut().into_iter().enumerate() {
        let centre = (i as f64 + 0.5) * scale - 0.5;
        let (first, last) = ((centre - reach).ceil() as i64, (centre + reach).floor() as i64);
        let taps: Vec<(usize, f64)> = (first..=last)
            .map(|k| (k.clamp(0, n as i64 - 1) as usize, kernel.value((k as f64 - centre) / scale)))
            .collect();
        let total: f64 = taps.iter().map(|t| t.1).sum();
        for (k, tap) in taps {
            row.scaled_add((tap / total) as f32, &plane.row(k));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shrinking_keeps_planes_and_sizes() {
        let plane = Array2::from_shape_fn((60, 90), |(y, x)| 0.2 + 0.003 * x as f32 + 0.005 * y as f32);
        for kernel in [Kernel::Lanczos, Kernel::Bicubic] {
            let small = reduce(plane.view(), 40, 60, kernel).unwrap();
            assert_eq!(small.dim(), (40, 60));
            for y in 5..35 {
                for x in 5..55 {
                    let truth = 0.2 + 0.003 * (x as f32 * 1.5 + 0.25) + 0.005 * (y as f32 * 1.5 + 0.25);
                    assert!((small[[y, x]] - truth).abs() < 5e-4);
                }
            }
        }
        assert!(reduce(plane.view(), 61, 60, Kernel::Lanczos).is_err());
        assert!(reduce(plane.view(), 0, 60, Kernel::Lanczos).is_err());
        assert_eq!(reduce(plane.view(), 60, 90, Kernel::Bicubic).unwrap(), plane);
    }

    #[test]
    fn unusable_photos_say_why() {
        let folder = tempfile::tempdir().unwrap();
        let at = |n: &str| folder.path().join(n);
        std::fs::write(at("text.jpg"), b"not a photo").unwrap();
        std::fs::write(at("empty.png"), b"").unwrap();
        image::GrayImage::from_pixel(64, 64, image::Luma([7])).save(at("flat.png")).unwrap();
        image::GrayImage::from_fn(1, 1, |_, _| image::Luma([7])).save(at("tiny.png")).unwrap();
        for (name, why) in [("text.jpg", ""), ("empty.png", ""), ("flat.png", "one colour"), ("tiny.png", "too few")] {
            let error = load_photo(&at(name), 32).unwrap_err().to_string();
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
        let photo = load_photo(&path, 32).unwrap();
        assert_eq!(photo.luminance.dim(), (50, 40));
        let truth = (0.299 * 10_000.0 + 0.587 * 20_000.0) / 65535.0;
        assert!((photo.luminance[[20, 10]] - truth).abs() < 1e-5);
        assert_eq!(photo.sha256.len(), 64);
    }

    /// A JPEG whose EXIF block says how the camera was held.
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
    fn photos_stand_upright_whatever_the_camera_did() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.jpg");
        let photo = image::GrayImage::from_fn(80, 60, |x, y| image::Luma([(2 * x + y) as u8]));
        let upright = |x: usize, y: usize| (2 * x + y) as f32 / 255.0;
        let stored = |orientation| {
            std::fs::write(&path, turned(&photo, orientation)).unwrap();
            load_photo(&path, 32).unwrap().luminance
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
    fn linear_light_is_encoded_when_it_is_said_to_be_linear() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("linear.png");
        image::ImageBuffer::from_fn(40, 40, |x, _| image::Luma([x as u16 * 1600])).save(&path).unwrap();
        let (plain, encoded) = (load_photo(&path, 32).unwrap(), load_photo_in(&path, 32, true).unwrap());
        let value = plain.luminance[[3, 10]];
        assert!((value - 16_000.0 / 65_535.0).abs() < 1e-4);
        let truth = 1.055 * value.powf(1.0 / 2.4) - 0.055;
        assert!((encoded.luminance[[3, 10]] - truth).abs() < 1e-4, "{}", encoded.luminance[[3, 10]]);
    }

    #[test]
    fn ink_is_turned_into_light() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/reference/cmyk.jpg");
        let photo = load_photo(&path, 32).unwrap();
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
