//! What a light field that is a bare array lacks: its description (colour space, pitch, method, …), kept beside a
//! `.npy` as `NAME.npy.json`, inside a `.mat` as a second variable, and inside an ESLF picture as a text.
//!
//! A description belongs to its array by the array's shape and a fingerprint of its numbers; one that does not is left
//! alone, with a note.

use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::error::{Error, io_at};
use super::meta::Meta;
use crate::input::open_regular;

/// Longest description that is read, bytes.
pub(super) const MAX_TEXT: u64 = 4 << 20;
/// Blocks of the numbers that make up a fingerprint, and bytes of each.
/// Source: chosen; the whole of small arrays, and of large ones as much as can be read at once.
const BLOCKS: u64 = 64;
const BLOCK: u64 = 4096;

/// A description as stored.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Companion {
    /// The program that wrote it: first, and on the first line, so that the file is known as its own.
    #[serde(default)]
    tool: String,
    /// Version of this layout, 1.
    lenslet: u32,
    /// Fingerprint of the numbers (hexadecimal); empty where the numbers and the description are one file's pixels.
    #[serde(default)]
    fingerprint: String,
    /// The description, as in `lightfield.json`.
    description: Meta,
}

/// Where the description of the array at `path` stands.
pub(super) fn companion_path(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".json");
    name.into()
}

impl Companion {
    pub(super) fn new(meta: &Meta, fingerprint: String) -> Self {
        let tool = concat!("lenslet ", env!("CARGO_PKG_VERSION")).to_string();
        Companion { tool, lenslet: 1, fingerprint, description: meta.clone() }
    }

    /// As text.
    pub(super) fn to_text(&self) -> Result<String, Error> {
        serde_json::to_string(self).map_err(|e| Error::Parameter(format!("cannot describe the light field: {e}")))
    }

    /// The description out of its text.
    pub(super) fn from_text(text: &[u8]) -> Result<Self, String> {
        let found: Companion = serde_json::from_slice(text).map_err(|e| e.to_string())?;
        if found.lenslet != 1 {
            return Err(format!("version {} of it is not known here", found.lenslet));
        }
        found.description.check().map_err(|e| e.to_string())?;
        Ok(found)
    }

    /// Views (rows, columns) and size (height, width) of the described light field.
    pub(super) fn shape(&self) -> [[usize; 2]; 2] {
        [self.description.views, self.description.size]
    }

    /// As [`Companion::of`], where the numbers are not looked at.
    pub(super) fn of_shape(self, meta: &Meta) -> Result<Meta, String> {
        let own = self.fingerprint.clone();
        self.of(meta, &own)
    }

    /// The description, if it is that of a light field like `meta` whose numbers have `fingerprint`; else why not.
    pub(super) fn of(self, meta: &Meta, fingerprint: &str) -> Result<Meta, String> {
        let d = self.description;
        if (d.views, d.size, d.channels) != (meta.views, meta.size, meta.channels) {
            return Err("it is that of an array of another shape".into());
        }
        if self.fingerprint != fingerprint {
            return Err("the numbers have changed since it was written".into());
        }
        Ok(d)
    }
}

/// The fingerprint of `length` bytes of numbers that start at `start` of a file.
pub(super) fn fingerprint_of_file(path: &Path, start: u64, length: u64) -> Result<String, Error> {
    let (mut file, _) = open_regular(path).map_err(io_at(path))?;
    fingerprint_by(length, |at, buffer| {
        file.seek(SeekFrom::Start(start + at))?;
        file.read_exact(buffer)
    })
    .map_err(io_at(path))
}

/// The fingerprint of numbers in memory.
pub(super) fn fingerprint_of(bytes: &[u8]) -> String {
    let read = |at: u64, buffer: &mut [u8]| {
        let at = at as usize;
        buffer.copy_from_slice(&bytes[at..at + buffer.len()]);
        Ok(())
    };
    fingerprint_by(bytes.len() as u64, read).unwrap_or_default()
}

/// The fingerprint of `length` bytes that `read` puts into its buffer from a position on: SHA-256 of the length and of
/// evenly spaced blocks.
pub(super) fn fingerprint_by(
    length: u64,
    mut read: impl FnMut(u64, &mut [u8]) -> std::io::Result<()>,
) -> std::io::Result<String> {
    let mut sum = Sha256::new();
    sum.update(length.to_le_bytes());
    let mut buffer = [0; BLOCK as usize];
    let mut done = 0;
    for k in 0..BLOCKS {
        // Blocks do not overlap; of a small array they are all of it.
        let from = (length.saturating_sub(BLOCK) * k / (BLOCKS - 1)).max(done);
        let n = BLOCK.min(length - from.min(length));
        if n == 0 {
            break;
        }
        let part = &mut buffer[..n as usize];
        read(from, part)?;
        sum.update(&part);
        done = from + n;
    }
    Ok(format!("{:x}", sum.finalize()))
}

#[cfg(test)]
mod tests {
    use super::super::colour::ColourSpace;
    use super::*;

    #[test]
    fn a_fingerprint_tells_numbers_apart() {
        for length in [0usize, 1, 5000, 300_000, 1_000_000] {
            let bytes: Vec<u8> = (0..length).map(|k| (k * 7 % 251) as u8).collect();
            let own = fingerprint_of(&bytes);
            assert_eq!(own, fingerprint_of(&bytes));
            for k in [0, length / 3, length.saturating_sub(1)] {
                // Small arrays whole; of large ones the ends.
                if length > 0 && (length <= 250_000 || k == 0 || k + 1 == length) {
                    let mut other = bytes.clone();
                    other[k] ^= 1;
                    assert_ne!(own, fingerprint_of(&other), "{length} {k}");
                }
            }
            assert_ne!(own, fingerprint_of(&[&bytes[..], &[0]].concat()));
        }
    }

    #[test]
    fn a_description_of_other_numbers_is_not_taken() {
        let meta = Meta::new([2, 2], [3, 4], 3, ColourSpace::Linear);
        let text = Companion::new(&meta, "ab".into()).to_text().unwrap();
        let read = || Companion::from_text(text.as_bytes()).unwrap();
        assert_eq!(read().of(&meta, "ab").unwrap().colour, ColourSpace::Linear);
        assert!(read().of(&meta, "cd").unwrap_err().contains("changed"));
        assert!(read().of(&Meta::new([2, 3], [3, 4], 3, ColourSpace::Srgb), "ab").unwrap_err().contains("shape"));
        assert!(Companion::from_text(b"{}").is_err() && Companion::from_text(b"").is_err());
    }
}
