//! Pictures for the screen: linear light to 8-bit sRGB, PNG, JPEG, animated GIF and PNG in memory.

use anyhow::{Context as _, Result, ensure};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use lenslet_core::lightfield::{ColourSpace, LightField, colour};
use ndarray::{Array3, ArrayView3, Zip};
use rayon::prelude::*;

/// An 8-bit RGB picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// 3·width·height bytes.
    pub rgb: Vec<u8>,
}

/// Entries of the table behind [`make_linear`]: stored light fields have 16 bits a value.
const LEVELS: usize = 65535;

/// Turns the values of a light field into linear light, through a table (values are rounded to 16 bits where encoded).
pub fn make_linear(field: &mut LightField) {
    if field.meta.colour == ColourSpace::Linear {
        return;
    }
    let table: Vec<f32> = (0..=LEVELS).map(|k| colour::decode(k as f32 / LEVELS as f32)).collect();
    Zip::from(&mut field.data).par_for_each(|v| {
        // A NaN becomes 0 here.
        *v = table[(v.clamp(0.0, 1.0) * LEVELS as f32 + 0.5) as usize];
    });
    field.meta.colour = ColourSpace::Linear;
}

/// Linear light (t, s, c), one channel or three, to 8-bit sRGB.
pub fn from_linear(image: &ArrayView3<f32>) -> Picture {
    // The curve is smooth enough for a table of the square root.
    const N: usize = 4095;
    let table: Vec<u8> = (0..=N)
        .map(|k| {
            let root = k as f32 / N as f32;
            (colour::encode(root * root) * 255.0 + 0.5) as u8
        })
        .collect();
    pixels(image, |v| table[(v.clamp(0.0, 1.0).sqrt() * N as f32 + 0.5) as usize])
}

/// sRGB-encoded values (t, s, c), one channel or three, to 8 bits.
pub fn from_encoded(image: &ArrayView3<f32>) -> Picture {
    pixels(image, |v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
}

fn pixels(image: &ArrayView3<f32>, byte: impl Fn(f32) -> u8 + Sync) -> Picture {
    let (height, width, channels) = image.dim();
    let mut rgb = vec![0u8; 3 * width * height];
    rgb.par_chunks_mut((3 * width).max(1)).enumerate().for_each(|(t, row)| {
        for (s, pixel) in row.chunks_exact_mut(3).enumerate() {
            for (k, b) in pixel.iter_mut().enumerate() {
                *b = byte(image[[t, s, k.min(channels - 1)]]);
            }
        }
    });
    Picture { width, height, rgb }
}

/// Means of boxes, so that the longer side is at most `side`; smaller pictures stay as they are.
pub fn shrink(image: &ArrayView3<f32>, side: usize) -> Array3<f32> {
    let (height, width, channels) = image.dim();
    let longer = height.max(width);
    if longer <= side || side == 0 {
        return image.to_owned();
    }
    let scaled = |n: usize| ((n * side + longer / 2) / longer).max(1);
    let (h, w) = (scaled(height), scaled(width));
    let rows = overlaps(height, h);
    let columns = overlaps(width, w);
    // Along the rows, then down the columns.
    let mut narrow = Array3::<f32>::zeros((height, w, channels));
    for (mut out, row) in narrow.outer_iter_mut().zip(image.outer_iter()) {
        for (s, list) in columns.iter().enumerate() {
            for &(k, share) in list {
                for c in 0..channels {
                    out[[s, c]] += share * row[[k, c]];
                }
            }
        }
    }
    let mut small = Array3::<f32>::zeros((h, w, channels));
    for (mut out, list) in small.outer_iter_mut().zip(&rows) {
        for &(k, share) in list {
            out.scaled_add(share, &narrow.index_axis(ndarray::Axis(0), k));
        }
    }
    small
}

/// Which of `from` cells each of `to` cells covers, and how much of the mean each makes up.
fn overlaps(from: usize, to: usize) -> Vec<Vec<(usize, f32)>> {
    let ratio = from as f64 / to as f64;
    (0..to)
        .map(|k| {
            let (lo, hi) = (k as f64 * ratio, (k + 1) as f64 * ratio);
            (lo as usize..(hi.ceil() as usize).min(from))
                .map(|i| (i, ((hi.min((i + 1) as f64) - lo.max(i as f64)) / ratio) as f32))
                .collect()
        })
        .collect()
}

/// A PNG file's bytes.
///
/// # Errors
/// When the picture is empty.
pub fn png(picture: &Picture) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Default, FilterType::Adaptive)
        .write_image(&picture.rgb, picture.width as u32, picture.height as u32, ExtendedColorType::Rgb8)
        .context("the picture cannot be encoded as PNG")?;
    Ok(bytes)
}

/// A 16-bit grey PNG file's bytes; `values` 0..1.
///
/// # Errors
/// When the picture is empty.
pub fn png_grey16(values: &ndarray::Array2<f32>) -> Result<Vec<u8>> {
    let (height, width) = values.dim();
    let data: Vec<u8> =
        values.iter().flat_map(|v| ((v.clamp(0.0, 1.0) * 65535.0 + 0.5) as u16).to_ne_bytes()).collect();
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(&data, width as u32, height as u32, ExtendedColorType::L16)
        .context("the picture cannot be encoded as PNG")?;
    Ok(bytes)
}

/// A JPEG file's bytes, `quality` 1 to 100.
///
/// # Errors
/// When the picture is empty or more than 65535 pixels a side.
pub fn jpeg(picture: &Picture, quality: u8) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality)
        .write_image(&picture.rgb, picture.width as u32, picture.height as u32, ExtendedColorType::Rgb8)
        .context("the picture cannot be encoded as JPEG")?;
    Ok(bytes)
}

/// The first picture of an animation, if it is one.
fn same_size(pictures: &[Picture]) -> Result<&Picture> {
    let first = pictures.first().context("an animation needs at least one picture")?;
    ensure!(
        pictures.iter().all(|p| (p.width, p.height) == (first.width, first.height)),
        "the pictures of an animation must be of one size"
    );
    Ok(first)
}

/// An endless animated PNG's bytes, every colour kept; all pictures of one size, `delay` in hundredths of a second.
///
/// # Errors
/// When there are no pictures, or they are empty or differ in size.
pub fn apng(pictures: &[Picture], delay: u16) -> Result<Vec<u8>> {
    let first = same_size(pictures)?;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, first.width as u32, first.height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_animated(pictures.len() as u32, 0)?;
    encoder.set_frame_delay(delay, 100)?;
    let mut writer = encoder.write_header()?;
    for picture in pictures {
        writer.write_image_data(&picture.rgb)?;
    }
    writer.finish()?;
    Ok(bytes)
}

/// An endless animated GIF's bytes; all pictures of one size, `delay` in hundredths of a second.
///
/// # Errors
/// When there are no pictures, they differ in size, or exceed 65535 pixels a side.
pub fn gif(pictures: &[Picture], delay: u16) -> Result<Vec<u8>> {
    let first = same_size(pictures)?;
    let (width, height) = (u16::try_from(first.width)?, u16::try_from(first.height)?);
    let frames: Vec<gif::Frame> = pictures
        .par_iter()
        .map(|p| {
            let mut frame = gif::Frame::from_rgb_speed(width, height, &p.rgb, 10);
            frame.delay = delay;
            frame.make_lzw_pre_encoded();
            frame
        })
        .collect();
    let mut bytes = Vec::new();
    {
        let mut encoder = gif::Encoder::new(&mut bytes, width, height, &[])?;
        encoder.set_repeat(gif::Repeat::Infinite)?;
        for frame in &frames {
            encoder.write_lzw_pre_encoded_frame(frame)?;
        }
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;

    #[test]
    fn screen_values_follow_the_curve() {
        let image = Array3::from_shape_fn((1, 256, 1), |(_, s, _)| colour::decode(s as f32 / 255.0));
        let picture = from_linear(&image.view());
        for (s, p) in picture.rgb.chunks(3).enumerate() {
            assert!(p.iter().all(|&b| (i32::from(b) - s as i32).abs() <= 1), "{s}: {p:?}");
        }
    }

    #[test]
    fn shrinking_keeps_the_mean_and_constants() {
        let image = Array3::from_shape_fn((30, 47, 3), |(t, s, c)| ((t * 7 + s * 13 + c * 5) % 11) as f32);
        let small = shrink(&image.view(), 20);
        assert_eq!(small.dim(), (13, 20, 3));
        assert!((small.mean().unwrap() - image.mean().unwrap()).abs() < 0.02);
        let flat = shrink(&Array3::from_elem((30, 47, 3), 0.7).view(), 13);
        assert!(flat.iter().all(|v| (v - 0.7).abs() < 1e-5));
    }

    #[test]
    fn an_animation_reads_back() {
        let picture = |v| Picture { width: 20, height: 10, rgb: vec![v; 600] };
        let bytes = gif(&[picture(10), picture(200)], 5).unwrap();
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut decoder = options.read_info(&bytes[..]).unwrap();
        let mut values = vec![];
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            values.push(frame.buffer[0]);
        }
        assert_eq!(values, [10, 200]);
        assert!(gif(&[], 5).is_err());
        let bytes = apng(&[picture(10), picture(200)], 5).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
        assert_eq!(reader.info().animation_control().map(|a| (a.num_frames, a.num_plays)), Some((2, 0)));
        for value in [10, 200] {
            let mut frame = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut frame).unwrap();
            assert!(frame.iter().all(|v| *v == value));
        }
        assert!(apng(&[], 5).is_err());
        assert!(gif(&[picture(1), Picture { width: 1, height: 1, rgb: vec![0; 3] }], 5).is_err());
    }
}
