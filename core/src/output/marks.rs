//! By what lenslet recognises a single file that it wrote.
//!
//! | format | mark |
//! |---|---|
//! | `.calib`, `.lfd` | their first bytes |
//! | `.safetensors` | `lenslet_dictionary` as the first metadata |
//! | `.npz` (samples, checkpoints) | a first array called `lenslet` |
//! | `.npy` | a header padded with blanks to 256 bytes (NumPy pads to 64 or 128), and no byte more than its shape needs |
//! | `.mat` | `written by lenslet` in the text of the header |
//! | PNG, APNG, JPEG, GIF, HTML, SVG, Markdown | a comment at the end with the CRC-32 of everything else |
//! | `.jsonl` | `"tool":"lenslet` in its first line |
//!
//! Everything else is foreign.

use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use crate::input::open_regular;

/// Bytes of the header of every .npy of a light field that lenslet writes; readers with small buffers take 256.
/// Source: chosen; NumPy's own headers of such arrays have 128.
pub const NPY_HEADER: usize = 256;
/// Name of the array that marks a .npz.
pub const NPZ_MARK: &str = "lenslet";
/// Bytes at the start of a file that are looked at.
/// Source: chosen.
const HEAD: u64 = 4096;
/// Bytes at the end of a file that hold its seal.
/// Source: chosen; the longest seal has 60.
const TAIL: usize = 96;
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
/// The last chunk of every PNG.
const PNG_END: &[u8] = b"\0\0\0\0IEND\xaeB`\x82";
const SEAL: &str = "written by lenslet, the rest has CRC-32 ";

/// A format whose files end in a comment.
#[derive(Clone, Copy)]
enum Sealed {
    Png,
    Jpeg,
    Gif,
    Text,
}

impl Sealed {
    fn of(head: &[u8]) -> Option<Sealed> {
        if head.starts_with(PNG) {
            return Some(Sealed::Png);
        }
        if head.starts_with(b"\xff\xd8\xff") {
            return Some(Sealed::Jpeg);
        }
        if head.starts_with(b"GIF89a") {
            return Some(Sealed::Gif);
        }
        let text = [&b"<!DOCTYPE html"[..], b"<svg", b"<?xml", b"# "];
        text.iter().any(|start| head.starts_with(start)).then_some(Sealed::Text)
    }

    /// What follows the comment.
    fn end(self) -> &'static [u8] {
        match self {
            Sealed::Png => PNG_END,
            Sealed::Jpeg => b"\xff\xd9",
            Sealed::Gif => b";",
            Sealed::Text => b"",
        }
    }

    /// The comment for a file whose bytes without it have this CRC-32.
    fn comment(self, crc: u32) -> Vec<u8> {
        let text = format!("{SEAL}{crc:08x}");
        match self {
            Sealed::Png => {
                let data = [b"tEXtSoftware\0", text.as_bytes()].concat();
                let mut crc = flate2::Crc::new();
                crc.update(&data);
                let length = (data.len() as u32 - 4).to_be_bytes();
                [&length[..], &data, &crc.sum().to_be_bytes()].concat()
            }
            Sealed::Jpeg => [&b"\xff\xfe"[..], &(text.len() as u16 + 2).to_be_bytes(), text.as_bytes()].concat(),
            Sealed::Gif => [&[0x21, 0xfe, text.len() as u8], text.as_bytes(), &[0]].concat(),
            Sealed::Text => format!("<!-- {text} -->\n").into_bytes(),
        }
    }
}

fn crc_of(bytes: &[u8]) -> u32 {
    let mut crc = flate2::Crc::new();
    crc.update(bytes);
    crc.sum()
}

/// Adds the comment by which the file will be recognised, in formats that have one.
pub(super) fn seal(bytes: &[u8]) -> Vec<u8> {
    let kind = Sealed::of(bytes).filter(|k| bytes.ends_with(k.end()));
    let Some(kind) = kind else { return bytes.to_vec() };
    let (start, end) = bytes.split_at(bytes.len() - kind.end().len());
    [start, &kind.comment(crc_of(bytes)), end].concat()
}

/// Whether lenslet wrote the file, by its mark and, where the format has it, by its contents.
pub(super) fn is_own_file(path: &Path) -> bool {
    recognise(path).unwrap_or(false)
}

fn recognise(path: &Path) -> std::io::Result<bool> {
    let (mut file, length) = open_regular(path)?;
    let mut head = Vec::new();
    file.by_ref().take(HEAD).read_to_end(&mut head)?;
    if let Some(kind) = Sealed::of(&head) {
        // The end alone tells nearly all foreign files.
        let mut tail = Vec::new();
        file.seek(SeekFrom::Start(length.saturating_sub(TAIL as u64)))?;
        file.by_ref().take(TAIL as u64).read_to_end(&mut tail)?;
        if !tail.windows(SEAL.len()).any(|w| w == SEAL.as_bytes()) {
            return Ok(false);
        }
        let rest = kind.comment(0).len() + kind.end().len();
        let Some(start) = length.checked_sub(rest as u64) else { return Ok(false) };
        file.seek(SeekFrom::Start(0))?;
        let mut begin = flate2::CrcReader::new(file.by_ref().take(start).chain(kind.end()));
        std::io::copy(&mut begin, &mut std::io::sink())?;
        let crc = begin.crc().sum();
        let mut found = Vec::new();
        file.take(rest as u64 + 1).read_to_end(&mut found)?;
        return Ok(found == [&kind.comment(crc), kind.end()].concat());
    }
    let first_line = head.split(|&b| b == b'\n').next().unwrap_or_default();
    let has = |bytes: &[u8], text: &[u8]| bytes.windows(text.len()).any(|w| w == text);
    Ok(head.starts_with(b"LENSCAL\0")
        || head.starts_with(b"\x89LFD\r\n\x1a\n")
        || head.get(8..).is_some_and(|h| h.starts_with(b"{\"__metadata__\":{\"lenslet_dictionary\":"))
        || is_own_npz(&head)
        || is_own_npy(&head, length)
        || (head.starts_with(b"MATLAB 5.0 MAT-file") && has(&head[..head.len().min(116)], b"written by lenslet"))
        || (first_line.starts_with(b"{") && has(first_line, b"\"tool\":\"lenslet")))
}

/// The first member of the archive is the array [`NPZ_MARK`].
fn is_own_npz(head: &[u8]) -> bool {
    let name = format!("{NPZ_MARK}.npy");
    let stated = head.get(26..28).map(|b| usize::from(u16::from_le_bytes([b[0], b[1]])));
    head.starts_with(b"PK\x03\x04")
        && stated == Some(name.len())
        && head.get(30..30 + name.len()) == Some(name.as_bytes())
}

fn is_own_npy(head: &[u8], length: u64) -> bool {
    let Some(header) = head.get(..NPY_HEADER) else { return false };
    let stated = (NPY_HEADER - 10) as u16;
    let text = String::from_utf8_lossy(&header[10..]);
    let shape =
        text.strip_prefix("{'descr': '<f4', 'fortran_order': False, 'shape': (").and_then(|t| t.split_once("), }"));
    let Some((shape, padding)) = shape else { return false };
    let sides: Vec<u64> = shape.split(", ").filter_map(|n| n.parse().ok()).collect();
    let values = sides.iter().try_fold(4u64, |n, &side| n.checked_mul(side));
    header.starts_with(b"\x93NUMPY\x01\x00")
        && header[8..10] == stated.to_le_bytes()
        && sides.len() == 5
        && padding.trim_end_matches('\n').bytes().all(|b| b == b' ')
        && values.is_some_and(|n| n + NPY_HEADER as u64 == length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seal_breaks_with_any_byte() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let mut picture = Vec::new();
        let mut encoder = png::Encoder::new(&mut picture, 3, 1);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.write_header().unwrap().write_image_data(&[1, 2, 3]).unwrap();
        let mut photo = Vec::new();
        image::codecs::jpeg::JpegEncoder::new(&mut photo)
            .encode(&[9; 12], 2, 2, image::ExtendedColorType::Rgb8)
            .unwrap();
        let gif = b"GIF89a\x01\0\x01\0\0\0\0;".to_vec();
        for whole in
            [picture, photo, gif, b"<svg></svg>".to_vec(), b"# Title\n".to_vec(), b"<!DOCTYPE html>\n".to_vec()]
        {
            std::fs::write(&path, &whole).unwrap();
            assert!(!is_own_file(&path));
            let sealed = seal(&whole);
            std::fs::write(&path, &sealed).unwrap();
            assert!(is_own_file(&path), "{}", String::from_utf8_lossy(&sealed));
            for at in 0..sealed.len() {
                let mut changed = sealed.clone();
                changed[at] ^= 1;
                std::fs::write(&path, &changed).unwrap();
                assert!(!is_own_file(&path), "byte {at} of {}", String::from_utf8_lossy(&sealed));
            }
        }
    }

    #[test]
    fn a_sealed_picture_is_still_a_picture() {
        let mut picture = Vec::new();
        let mut encoder = png::Encoder::new(&mut picture, 3, 1);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.write_header().unwrap().write_image_data(&[1, 2, 3]).unwrap();
        let read = image::load_from_memory(&seal(&picture)).unwrap().into_luma8();
        assert_eq!(read.as_raw(), &[1, 2, 3]);
        let mut photo = Vec::new();
        image::codecs::jpeg::JpegEncoder::new(&mut photo)
            .encode(&[9; 12], 2, 2, image::ExtendedColorType::Rgb8)
            .unwrap();
        assert_eq!(image::load_from_memory(&seal(&photo)).unwrap(), image::load_from_memory(&photo).unwrap());
    }

    #[test]
    fn what_numpy_saves_is_foreign() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        ndarray_npy::write_npy(&path, &ndarray::Array5::<f32>::zeros((2, 2, 3, 4, 1))).unwrap();
        assert!(!is_own_file(&path));
    }
}
