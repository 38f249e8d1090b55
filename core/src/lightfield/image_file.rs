//! Single images: 16-bit PNG written fast; PNG, JPEG, TIFF and PNM read with limits.

use std::io::BufReader;
use std::path::Path;

use image::{ColorType, DynamicImage, ImageDecoder, ImageReader, Limits};
use ndarray::Array3;
use rayon::prelude::*;

use super::error::{Error, io_at, malformed};
use super::meta::{MAX_SIDE, MAX_VIEW_VALUES, Meta};
use super::sample::{SampleFormat, SampleKind};
use crate::input::open_regular;

/// Values 0..1 to big-endian 16-bit samples, rounded to nearest; NaN becomes 0.
pub(super) fn to_sixteen_bits(view: &Array3<f32>) -> Vec<u8> {
    let one = |&x: &f32| ((x.clamp(0.0, 1.0) * 65535.0 + 0.5) as u16).to_be_bytes();
    match view.as_slice() {
        // 64 Ki values per piece: enough for one thread, few enough to share.
        Some(values) => {
            let mut bytes = vec![0; 2 * values.len()];
            bytes.par_chunks_mut(1 << 17).zip(values.par_chunks(1 << 16)).for_each(|(to, from)| {
                for (to, x) in to.chunks_exact_mut(2).zip(from) {
                    to.copy_from_slice(&one(x));
                }
            });
            bytes
        }
        None => view.iter().flat_map(one).collect(),
    }
}

/// Big-endian 16-bit samples as a PNG: one filter for all rows and the fastest deflate, 3 to 5 times as fast as the
/// usual setting.
pub(super) fn encode_png(
    samples: &[u8],
    width: usize,
    height: usize,
    channels: usize,
    path: &Path,
) -> Result<Vec<u8>, Error> {
    let failed = |e: png::EncodingError| Error::Io { path: path.display().to_string(), source: e.into() };
    let mut bytes = Vec::with_capacity(samples.len() / 2 + 1024);
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(if channels == 1 { png::ColorType::Grayscale } else { png::ColorType::Rgb });
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.set_compression(png::Compression::Fastest);
    encoder.set_filter(png::Filter::Up);
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(samples).map_err(failed)?;
    writer.finish().map_err(failed)?;
    Ok(bytes)
}

/// Size and channels of an image, from its header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shape {
    pub(super) width: usize,
    pub(super) height: usize,
    /// 1 or 3; alpha is not counted.
    pub(super) channels: usize,
}

fn open_decoder(path: &Path, max_values: usize) -> Result<(impl ImageDecoder + use<>, Shape), Error> {
    let (file, length) = open_regular(path).map_err(io_at(path))?;
    let mut reader = ImageReader::new(BufReader::new(file)).with_guessed_format().map_err(io_at(path))?;
    if reader.format().is_none() {
        return Err(malformed(path, "not an image (PNG, JPEG, TIFF or PNM)"));
    }
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE as u32);
    limits.max_image_height = Some(MAX_SIDE as u32);
    limits.max_alloc = Some(4 * max_values as u64);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| malformed(path, e.to_string()))?;
    let (width, height) = decoder.dimensions();
    let channels = match decoder.color_type() {
        ColorType::L8 | ColorType::L16 | ColorType::La8 | ColorType::La16 => 1,
        _ => 3,
    };
    let shape = Shape { width: width as usize, height: height as usize, channels };
    if shape.width == 0 || shape.height == 0 {
        return Err(malformed(path, "the image has no pixels"));
    }
    if shape.width * shape.height * 4 > max_values {
        return Err(malformed(path, format!("{width}x{height} pixels are too many")));
    }
    // No format read here compresses better than 1032 to 1 (deflate), with up to 8 pixels in a byte; 1100 leaves a
    // margin.
    if decoder.total_bytes() / 8 > length.saturating_mul(1100) {
        return Err(malformed(path, format!("{width}x{height} pixels cannot be in {length} bytes")));
    }
    Ok((decoder, shape))
}

/// Size and channels, from the file's header.
pub(super) fn read_shape(path: &Path) -> Result<Shape, Error> {
    read_shape_within(path, MAX_VIEW_VALUES)
}

/// [`read_shape`] of a picture of at most `max_values` values (counting four channels).
pub(super) fn read_shape_within(path: &Path, max_values: usize) -> Result<Shape, Error> {
    Ok(open_decoder(path, max_values)?.1)
}

/// Reads an image as stored: its bytes (u8, or u16 little-endian) in row-major order, their number format, and the
/// number of channels (1 or 3); alpha is dropped.
pub(super) fn read_stored(path: &Path, max_values: usize) -> Result<(Vec<u8>, SampleFormat, usize), Error> {
    let (decoder, shape) = open_decoder(path, max_values)?;
    let picture = DynamicImage::from_decoder(decoder).map_err(|e| malformed(path, e.to_string()))?;
    let eight = SampleFormat { kind: SampleKind::U8, big_endian: false };
    let sixteen = SampleFormat { kind: SampleKind::U16, big_endian: false };
    let (bytes, number) = match (shape.channels, picture) {
        (1, DynamicImage::ImageLuma8(p)) => (p.into_raw(), eight),
        (1, DynamicImage::ImageLuma16(p)) => (little_endian(p.as_raw()), sixteen),
        (1, p) => (little_endian(p.into_luma16().as_raw()), sixteen),
        (_, DynamicImage::ImageRgb8(p)) => (p.into_raw(), eight),
        (_, DynamicImage::ImageRgb16(p)) => (little_endian(p.as_raw()), sixteen),
        (_, DynamicImage::ImageRgba8(p)) => (DynamicImage::ImageRgba8(p).into_rgb8().into_raw(), eight),
        (_, p) => (little_endian(p.into_rgb16().as_raw()), sixteen),
    };
    Ok((bytes, number, shape.channels))
}

fn little_endian(values: &[u16]) -> Vec<u8> {
    let mut bytes = vec![0; 2 * values.len()];
    for (to, x) in bytes.as_chunks_mut().0.iter_mut().zip(values) {
        *to = x.to_le_bytes();
    }
    bytes
}

/// Reads an image as values 0..1, shape (t, s, c), c = 1 or 3; alpha is dropped.
pub(super) fn read_picture(path: &Path) -> Result<Array3<f32>, Error> {
    let Shape { width, height, channels } = read_shape(path)?;
    let (bytes, number, _) = read_stored(path, MAX_VIEW_VALUES)?;
    let values = number.read_all(&bytes, number.kind.full_scale().unwrap_or(1.0));
    Array3::from_shape_vec((height, width, channels), values).map_err(|e| malformed(path, e.to_string()))
}

/// Reads one view of a light field; its size is compared before its pixels are read.
pub(super) fn read_view(path: &Path, meta: &Meta) -> Result<Array3<f32>, Error> {
    let shape = read_shape(path)?;
    let (height, width, channels) = meta.view_shape();
    if (shape.height, shape.width) != (height, width) {
        let reason = format!("{}x{} pixels, expected {width}x{height}", shape.width, shape.height);
        return Err(malformed(path, reason));
    }
    if shape.channels == channels {
        return read_picture(path);
    }
    if channels == 1 {
        return Err(malformed(path, format!("{} channels, expected 1", shape.channels)));
    }
    // A grey view among coloured ones has three equal channels.
    let grey = read_picture(path)?;
    grey.broadcast((height, width, channels))
        .map(|g| g.to_owned())
        .ok_or_else(|| malformed(path, "1 channel, expected 3"))
}
