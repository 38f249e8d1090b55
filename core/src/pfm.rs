//! PFM, a plane of 32-bit floats: the header `Pf`, width and height, a scale whose sign is the byte order (negative:
//! little-endian), then the rows from the bottom up.

use ndarray::{Array2, ArrayView2};

/// Longest word of a header, bytes.
const MAX_WORD: usize = 31;

/// Why bytes are not a one-channel PFM file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The header is not complete, or one of its four words is too long.
    #[error("not a PFM file: the header ends early")]
    Header,
    /// Another file, or a PFM of three channels (`PF`).
    #[error("not a one-channel PFM file")]
    Channels,
    /// Width, height or scale is not a number.
    #[error("not a PFM file: `{0}` is not a number")]
    Number(String),
    /// The header and the data disagree.
    #[error("the PFM says {width}x{height} but holds {bytes} bytes")]
    Size {
        /// Pixels per row.
        width: usize,
        /// Rows.
        height: usize,
        /// Bytes after the header.
        bytes: usize,
    },
}

/// The PFM file of a plane (t, s), row 0 on top: little-endian.
///
/// ```
/// use lenslet_core::pfm;
/// use ndarray::array;
///
/// let plane = array![[1.0f32, 2.0], [3.0, 4.0]];
/// let bytes = pfm::to_bytes(plane.view());
/// assert!(bytes.starts_with(b"Pf\n2 2\n-1.0\n"));
/// assert_eq!(bytes[12..16], 3f32.to_le_bytes()); // the bottom row comes first
/// assert_eq!(pfm::from_bytes(&bytes)?, plane);
/// # Ok::<(), pfm::Error>(())
/// ```
pub fn to_bytes(plane: ArrayView2<f32>) -> Vec<u8> {
    let (height, width) = plane.dim();
    let mut bytes = format!("Pf\n{width} {height}\n-1.0\n").into_bytes();
    for row in plane.outer_iter().rev() {
        bytes.extend(row.iter().flat_map(|v| v.to_le_bytes()));
    }
    bytes
}

/// Reads a one-channel PFM file in either byte order into a plane (t, s), row 0 on top.
///
/// # Errors
/// When the bytes are not such a file, or their number of pixels differs from the header's.
pub fn from_bytes(bytes: &[u8]) -> Result<Array2<f32>, Error> {
    let mut words = Vec::new();
    let mut position = 0;
    while words.len() < 4 {
        while bytes.get(position).is_some_and(u8::is_ascii_whitespace) {
            position += 1;
        }
        let rest = &bytes[position..];
        let length = rest.iter().position(u8::is_ascii_whitespace).filter(|n| (1..=MAX_WORD).contains(n));
        let word = &rest[..length.ok_or(Error::Header)?];
        words.push(String::from_utf8_lossy(word));
        position += word.len();
    }
    if words[0] != "Pf" {
        return Err(Error::Channels);
    }
    let not_a_number = |word: &str| Error::Number(word.to_string());
    let side = |word: &str| word.parse::<usize>().map_err(|_| not_a_number(word));
    let (width, height) = (side(&words[1])?, side(&words[2])?);
    let little_endian = words[3].parse::<f32>().map_err(|_| not_a_number(&words[3]))? < 0.0;
    // One byte of white space ends the header.
    let data = &bytes[position + 1..];
    let count = width.checked_mul(height).and_then(|n| n.checked_mul(4)).filter(|&n| n > 0 && n == data.len());
    if count.is_none() {
        return Err(Error::Size { width, height, bytes: data.len() });
    }
    let value = |b: &[u8; 4]| if little_endian { f32::from_le_bytes(*b) } else { f32::from_be_bytes(*b) };
    let rows = data.chunks_exact(4 * width).rev();
    let values: Vec<f32> = rows.flat_map(|row| row.as_chunks::<4>().0.iter().map(value)).collect();
    Array2::from_shape_vec((height, width), values).map_err(|_| Error::Size { width, height, bytes: data.len() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pfm_reads_back() {
        let values = Array2::from_shape_fn((3, 5), |(t, s)| t as f32 * 0.5 - s as f32);
        assert_eq!(from_bytes(&to_bytes(values.view())).unwrap(), values);
        let big = [&b"Pf 1 2\n1.0\n"[..], &2f32.to_be_bytes(), &1f32.to_be_bytes()].concat();
        assert_eq!(from_bytes(&big).unwrap(), ndarray::array![[1.0], [2.0]]);
        for bad in [
            &b""[..],
            b"Pf",
            b"Pf\n3 3\n-1\n1234",
            b"PF\n1 1\n-1\n123412341234",
            b"Pf\n99999999999 99999999999\n-1\n",
            b"Pf\n0 0\n-1\n",
            b"Pf\n1 x\n-1\n1234",
        ] {
            assert!(from_bytes(bad).is_err(), "{bad:?}");
        }
    }
}
