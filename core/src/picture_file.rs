//! Picture files of any tool: which format a file is in by its first bytes, and decoding within bounds that hold before
//! memory is taken.

use std::io::{BufRead, Seek};

use image::{DynamicImage, ImageDecoder, ImageReader, Limits};

/// Memory that any picture may take, bytes.
/// Source: chosen; 40 megapixels of 16-bit colour.
const ALWAYS: u64 = 256 << 20;
/// Bytes of memory for each byte of a file, above which a picture of more than [`ALWAYS`] is refused: photographs take
/// up to some 30, drawn pictures up to some 50.
/// Source: chosen.
const EXPANSION: u64 = 64;
/// Memory that no picture may exceed, bytes.
/// Source: chosen; an ESLF of an Illum as 15x15 views takes 0.6 GB.
const NEVER: u64 = 4 << 30;

/// Formats of pictures that are decoded, as messages name them.
pub const READ: &str = "PNG, JPEG, TIFF, BMP or PNM";
/// File name endings (lower case) of the pictures that are decoded.
pub const ENDINGS: [&str; 10] = ["png", "jpg", "jpeg", "tif", "tiff", "bmp", "dib", "ppm", "pgm", "pnm"];
/// File name endings (lower case) of pictures that are not decoded, and the names of their formats.
pub const UNREAD_ENDINGS: [(&str, &str); 19] = [
    ("webp", "WebP"),
    ("gif", "GIF"),
    ("exr", "OpenEXR"),
    ("hdr", "Radiance HDR"),
    ("jp2", "JPEG 2000"),
    ("j2k", "JPEG 2000"),
    ("jxl", "JPEG XL"),
    ("heic", "HEIF"),
    ("heif", "HEIF"),
    ("avif", "AVIF"),
    ("psd", "Photoshop"),
    ("tga", "TGA"),
    ("pfm", "PFM"),
    ("dng", "DNG"),
    ("cr2", "CR2"),
    ("nef", "NEF"),
    ("arw", "ARW"),
    ("qoi", "QOI"),
    ("ff", "Farbfeld"),
];

/// Why a picture is not decoded. The messages name no file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The first bytes are those of no picture.
    #[error("not a picture ({READ})")]
    NotAPicture,
    /// A picture in a format that is not read.
    #[error("a {0} picture, which is not read: convert it to PNG")]
    Format(&'static str),
    /// A picture that would take more memory than a file of its length may.
    #[error("{width}x{height} pixels out of a file of {length} bytes would need {} MiB of memory; shrink it, or save \
             it anew if it is damaged", needed >> 20)]
    TooLarge {
        /// Pixels a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Bytes of the file.
        length: u64,
        /// Bytes of memory.
        needed: u64,
    },
    /// A picture without pixels.
    #[error("the picture has no pixels")]
    Empty,
    /// A damaged picture, or one of a kind that the decoder does not know.
    #[error("the picture cannot be decoded: {0}")]
    Decode(#[from] image::ImageError),
    /// Reading failed.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// The format of a picture by its first bytes (16 suffice), and whether it is one that is decoded.
///
/// ```
/// use lenslet_core::picture_file::format_of;
///
/// assert_eq!(format_of(b"\x89PNG\r\n\x1a\n"), Some(("PNG", true)));
/// assert_eq!(format_of(b"RIFF\x10\0\0\0WEBPVP8 "), Some(("WebP", false)));
/// assert_eq!(format_of(b"some text of a user"), None);
/// ```
#[must_use]
pub fn format_of(head: &[u8]) -> Option<(&'static str, bool)> {
    let at = |start: usize, word: &[u8]| head.get(start..).is_some_and(|h| h.starts_with(word));
    // A bitmap's two letters alone may begin any file: the four zeros of its header and a known length follow.
    let bitmap = at(0, b"BM")
        && at(6, &[0; 4])
        && head
            .get(14..16)
            .is_none_or(|size| size[1] == 0 && matches!(size[0], 12 | 16 | 40 | 52 | 56 | 64 | 108 | 124));
    let anymap = matches!(head, [b'P', b'1'..=b'7', white, next, ..]
        if white.is_ascii_whitespace() && (next.is_ascii_digit() || next.is_ascii_whitespace() || *next == b'#' || *next == b'W'));
    let known: [(bool, &str, bool); 19] = [
        (at(0, b"\x89PNG\r\n\x1a\n"), "PNG", true),
        (at(0, &[0xff, 0xd8, 0xff]), "JPEG", true),
        (at(0, b"II*\0") || at(0, b"MM\0*") || at(0, b"II+\0") || at(0, b"MM\0+"), "TIFF", true),
        (bitmap, "BMP", true),
        (anymap, "PNM", true),
        (at(0, b"RIFF") && at(8, b"WEBP"), "WebP", false),
        (at(0, b"GIF87a") || at(0, b"GIF89a"), "GIF", false),
        (at(0, &[0x76, 0x2f, 0x31, 0x01]), "OpenEXR", false),
        (at(0, b"#?RADIANCE") || at(0, b"#?RGBE"), "Radiance HDR", false),
        (at(0, b"\0\0\0\x0cjP  \r\n") || at(0, &[0xff, 0x4f, 0xff, 0x51]), "JPEG 2000", false),
        (at(0, b"\0\0\0\x0cJXL \r\n"), "JPEG XL", false),
        (at(4, b"ftypavi"), "AVIF", false),
        (at(4, b"ftyphei") || at(4, b"ftypmif1") || at(4, b"ftyphev"), "HEIF", false),
        (at(0, b"8BPS"), "Photoshop", false),
        (at(0, b"DDS "), "DDS", false),
        (at(0, b"qoif"), "QOI", false),
        (at(0, b"farbfeld"), "Farbfeld", false),
        (at(0, b"Pf\n") || at(0, b"PF\n") || at(0, b"Pf ") || at(0, b"PF "), "PFM", false),
        (at(0, b"%PDF-"), "PDF", false),
    ];
    known.into_iter().find(|(fits, ..)| *fits).map(|(_, name, read)| (name, read))
}

/// Whether `needed` bytes of memory may come out of `length` bytes of a file: a small file that claims much is refused.
///
/// ```
/// use lenslet_core::picture_file::may_expand;
///
/// assert!(may_expand(200 << 20, 9_000), "little enough for any file");
/// assert!(may_expand(1 << 30, 30 << 20) && !may_expand(1 << 30, 1 << 20));
/// ```
#[must_use]
pub fn may_expand(needed: u64, length: u64) -> bool {
    needed <= ALWAYS || (needed <= NEVER && needed / EXPANSION <= length)
}

/// A decoder at the start of its pixels, whose size was found within bounds. `length`: bytes of the file; `working`:
/// bytes that the caller takes for each pixel besides the decoded picture.
///
/// # Errors
/// Everything of [`enum@Error`] but damage within the pixels.
pub fn open_decoder<'a>(
    mut source: impl BufRead + Seek + 'a,
    length: u64,
    working: u64,
) -> Result<impl ImageDecoder + 'a, Error> {
    let mut head = [0; 16];
    let mut n = 0;
    while n < head.len() {
        match source.read(&mut head[n..])? {
            0 => break,
            k => n += k,
        }
    }
    source.rewind()?;
    match format_of(&head[..n]) {
        None => return Err(Error::NotAPicture),
        Some((name, false)) => return Err(Error::Format(name)),
        Some((_, true)) => {}
    }
    let mut reader = ImageReader::new(source).with_guessed_format()?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(ALWAYS.max(length.saturating_mul(EXPANSION)).min(NEVER));
    reader.limits(limits);
    let decoder = reader.into_decoder()?;
    let (width, height) = decoder.dimensions();
    if width == 0 || height == 0 {
        return Err(Error::Empty);
    }
    let pixels = u64::from(width).saturating_mul(u64::from(height));
    let needed = decoder.total_bytes().saturating_add(pixels.saturating_mul(working));
    if !may_expand(needed, length) {
        return Err(Error::TooLarge { width, height, length, needed });
    }
    Ok(decoder)
}

/// Decodes the pixels.
///
/// # Errors
/// [`Error::Decode`].
pub fn decode_pixels(decoder: impl ImageDecoder) -> Result<DynamicImage, Error> {
    Ok(DynamicImage::from_decoder(decoder)?)
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    #[test]
    fn formats_are_known_by_their_first_bytes_alone() {
        let picture = image::GrayImage::from_pixel(5, 4, image::Luma([7]));
        for (format, name) in [
            (image::ImageFormat::Png, "PNG"),
            (image::ImageFormat::Jpeg, "JPEG"),
            (image::ImageFormat::Tiff, "TIFF"),
            (image::ImageFormat::Bmp, "BMP"),
            (image::ImageFormat::Pnm, "PNM"),
        ] {
            let mut bytes = Cursor::new(Vec::new());
            picture.write_to(&mut bytes, format).unwrap();
            let bytes = bytes.into_inner();
            assert_eq!(format_of(&bytes[..16]), Some((name, true)));
            let decoder = open_decoder(Cursor::new(&bytes), bytes.len() as u64, 4).unwrap();
            assert_eq!(decode_pixels(decoder).unwrap().into_luma8().dimensions(), (5, 4));
        }
        // Two letters that any raw file may begin with.
        assert_eq!(format_of(b"BM some other file.."), None);
        assert_eq!(format_of(b"P5\x80\x12\x33\x44"), None);
        assert_eq!(format_of(b""), None);
    }

    #[test]
    fn a_header_alone_takes_no_memory() {
        // 30000x30000 grey pixels claimed by 40 bytes of a PNM.
        let bytes = b"P5 30000 30000 255\n..................".to_vec();
        let refused = open_decoder(Cursor::new(&bytes), bytes.len() as u64, 0).err();
        assert!(matches!(refused, Some(Error::TooLarge { width: 30_000, needed: 900_000_000, .. })), "{refused:?}");
        let refused = open_decoder(Cursor::new(b"RIFF\x10\0\0\0WEBPVP8 ......"), 22, 0).err().unwrap();
        assert!(refused.to_string().contains("WebP") && refused.to_string().contains("PNG"));
    }
}
