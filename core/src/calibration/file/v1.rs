//! Format version 1, read only: i (i32), j (i32), x (f64), y (f64), trust (f32) of the lenslets, one array after the
//! other, then the white image as u16, each row as differences two pixels apart (same colour).

use super::header::{Payload, item_bytes};
use crate::calibration::model::Lenslet;

/// Bytes a lenslet takes.
const LENSLET: usize = 4 + 4 + 8 + 8 + 4;

/// Length of what [`read`] reads.
pub fn bytes_of(lenslets: usize, pixels: usize) -> usize {
    lenslets * LENSLET + 2 * pixels
}

/// Reads `n` lenslets and `pixels` pixels in rows of `width`; `from` has the length that [`bytes_of`] gives.
pub fn read(from: &[u8], n: usize, width: usize, pixels: usize) -> Payload {
    let (i, rest) = from.split_at(4 * n);
    let (j, rest) = rest.split_at(4 * n);
    let (x, rest) = rest.split_at(8 * n);
    let (y, rest) = rest.split_at(8 * n);
    let (trust, image) = rest.split_at(4 * n);
    let lenslets = (0..n)
        .map(|k| Lenslet {
            i: i32::from_le_bytes(item_bytes(i, k)),
            j: i32::from_le_bytes(item_bytes(j, k)),
            x: f64::from_le_bytes(item_bytes(x, k)),
            y: f64::from_le_bytes(item_bytes(y, k)),
            trust: f32::from_le_bytes(item_bytes(trust, k)),
        })
        .collect();
    let mut white = Vec::with_capacity(pixels);
    for k in 0..pixels {
        let before = if k % width >= 2 { white[k - 2] } else { 0u16 };
        white.push(before.wrapping_add(u16::from_le_bytes(item_bytes(image, k))));
    }
    Payload { lenslets, hot_pixels: Vec::new(), white }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_follow_each_other_and_rows_are_differences() {
        let mut bytes = Vec::new();
        [3i32, -4].iter().chain(&[5, 6]).for_each(|v| bytes.extend(v.to_le_bytes()));
        [1.5f64, 2.5].iter().chain(&[-0.25, 7.0]).for_each(|v| bytes.extend(v.to_le_bytes()));
        [0.5f32, 1.0].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        // Two rows of three pixels.
        [100u16, 200, 5, 65535, 10, 2].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        assert_eq!(bytes.len(), bytes_of(2, 6));
        let found = read(&bytes, 2, 3, 6);
        assert_eq!(found.lenslets[0], Lenslet { i: 3, j: 5, x: 1.5, y: -0.25, trust: 0.5 });
        assert_eq!(found.lenslets[1], Lenslet { i: -4, j: 6, x: 2.5, y: 7.0, trust: 1.0 });
        assert_eq!(found.white, [100, 200, 105, 65535, 10, 1]);
    }
}
