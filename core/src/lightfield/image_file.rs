//! Single images: 16-bit PNG written fast; PNG, JPEG, TIFF, BMP and PNM read with limits.

use std::io::{BufReader, Read as _};
use std::path::Path;

use image::{ColorType, DynamicImage, ImageDecoder};
use ndarray::Array3;
use rayon::prelude::*;

use super::error::{Error, io_at, malformed, unsupported};
use super::meta::{MAX_SIDE, MAX_VIEW_VALUES, Meta};
use super::sample::{SampleFormat, SampleKind};
use crate::input::open_regular;
use crate::picture_file;

/// Keyword of the text in a PNG that describes it.
const DESCRIPTION: &str = "lenslet";
/// Bytes of the header of a PNG within which its description is looked for.
const MAX_HEADER: u64 = 1 << 20;

/// Numbers of 8 bits.
pub(super) const EIGHT_BITS: SampleFormat = SampleFormat { kind: SampleKind::U8, big_endian: false };
/// Numbers of 16 bits, lowest byte first.
const SIXTEEN_BITS: SampleFormat = SampleFormat { kind: SampleKind::U16, big_endian: false };

/// The description inside a PNG that this project wrote; `None` in any other file.
pub(super) fn read_description(path: &Path) -> Option<String> {
    let mut head = Vec::new();
    open_regular(path).ok()?.0.take(MAX_HEADER).read_to_end(&mut head).ok()?;
    if !head.starts_with(b"\x89PNG") {
        return None;
    }
    let mut decoder = png::Decoder::new_with_limits(std::io::Cursor::new(head), png::Limits { bytes: 4 << 20 });
    decoder.set_ignore_text_chunk(false);
    let reader = decoder.read_info().ok()?;
    let text = reader.info().utf8_text.iter().find(|t| t.keyword == DESCRIPTION)?;
    text.get_text().ok()
}

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
    description: Option<&str>,
    path: &Path,
) -> Result<Vec<u8>, Error> {
    let failed = |e: png::EncodingError| Error::Io { path: path.display().to_string(), source: e.into() };
    let mut bytes = Vec::with_capacity(samples.len() / 2 + 1024);
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(if channels == 1 { png::ColorType::Grayscale } else { png::ColorType::Rgb });
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.set_compression(png::Compression::Fastest);
    encoder.set_filter(png::Filter::Up);
    if let Some(text) = description {
        encoder.add_itxt_chunk(DESCRIPTION.into(), text.into()).map_err(failed)?;
    }
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

/// Channels of colour; alpha is not counted.
fn channels_of(colour: ColorType) -> usize {
    match colour {
        ColorType::L8 | ColorType::L16 | ColorType::La8 | ColorType::La16 => 1,
        _ => 3,
    }
}

fn open_decoder(path: &Path, max_values: usize) -> Result<(impl ImageDecoder + use<>, Shape), Error> {
    let (file, length) = open_regular(path).map_err(io_at(path))?;
    // Three values in floating point a pixel.
    let decoder = picture_file::open_decoder(BufReader::new(file), length, 12).map_err(|e| match e {
        picture_file::Error::Io(source) => io_at(path)(source),
        picture_file::Error::Format(_) => unsupported(path, e.to_string()),
        other => malformed(path, other.to_string()),
    })?;
    let (width, height) = decoder.dimensions();
    let channels = channels_of(decoder.color_type());
    let shape = Shape { width: width as usize, height: height as usize, channels };
    if shape.width.max(shape.height) > MAX_SIDE || shape.width * shape.height * 4 > max_values {
        return Err(malformed(path, format!("{width}x{height} pixels are too many")));
    }
    Ok((decoder, shape))
}

/// Size and channels, from the file's header.
pub(super) fn read_shape(path: &Path) -> Result<Shape, Error> {
    read_shape_within(path, MAX_VIEW_VALUES)
}

/// Whether its values have 16 bits.
pub(super) fn has_sixteen_bits(path: &Path) -> Result<bool, Error> {
    let (decoder, _) = open_decoder(path, MAX_VIEW_VALUES)?;
    Ok(matches!(decoder.color_type(), ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16))
}

/// [`read_shape`] of a picture of at most `max_values` values (counting four channels).
pub(super) fn read_shape_within(path: &Path, max_values: usize) -> Result<Shape, Error> {
    Ok(open_decoder(path, max_values)?.1)
}

/// As [`read_stored`], with alpha as a last channel where there is one (2 or 4 channels then).
pub(super) fn read_stored_with_alpha(path: &Path, max_values: usize) -> Result<(Vec<u8>, SampleFormat, usize), Error> {
    let (decoder, _) = open_decoder(path, max_values)?;
    let picture = picture_file::decode_pixels(decoder).map_err(|e| malformed(path, e.to_string()))?;
    Ok(match picture {
        DynamicImage::ImageLumaA8(p) => (p.into_raw(), EIGHT_BITS, 2),
        DynamicImage::ImageLumaA16(p) => (little_endian(p.as_raw()), SIXTEEN_BITS, 2),
        DynamicImage::ImageRgba8(p) => (p.into_raw(), EIGHT_BITS, 4),
        DynamicImage::ImageRgba16(p) => (little_endian(p.as_raw()), SIXTEEN_BITS, 4),
        picture => stored(picture),
    })
}

/// Reads an image as stored: its bytes (u8, or u16 little-endian) in row-major order, their number format, and the
/// number of channels (1 or 3); alpha is dropped.
pub(super) fn read_stored(path: &Path, max_values: usize) -> Result<(Vec<u8>, SampleFormat, usize), Error> {
    let (decoder, _) = open_decoder(path, max_values)?;
    let picture = picture_file::decode_pixels(decoder).map_err(|e| malformed(path, e.to_string()))?;
    Ok(stored(picture))
}

/// Bytes, their format, channels (1 or 3).
fn stored(picture: DynamicImage) -> (Vec<u8>, SampleFormat, usize) {
    let (eight, sixteen) = (EIGHT_BITS, SIXTEEN_BITS);
    let channels = channels_of(picture.color());
    let (bytes, number) = match (channels, picture) {
        (1, DynamicImage::ImageLuma8(p)) => (p.into_raw(), eight),
        (1, DynamicImage::ImageLuma16(p)) => (little_endian(p.as_raw()), sixteen),
        (1, p) => (little_endian(p.into_luma16().as_raw()), sixteen),
        (_, DynamicImage::ImageRgb8(p)) => (p.into_raw(), eight),
        (_, DynamicImage::ImageRgb16(p)) => (little_endian(p.as_raw()), sixteen),
        (_, DynamicImage::ImageRgba8(p)) => (DynamicImage::ImageRgba8(p).into_rgb8().into_raw(), eight),
        (_, p) => (little_endian(p.into_rgb16().as_raw()), sixteen),
    };
    (bytes, number, channels)
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
