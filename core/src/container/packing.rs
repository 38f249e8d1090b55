//! Sensor words to pixels and back: 12 bit big-endian (F01), 10 bit little-endian (Illum), 8 and 16 bit.
//!
//! 12 bit: bytes b0 b1 b2 hold p0 = b0<<4 | b1>>4 and p1 = (b1&15)<<8 | b2.
//! 10 bit: bytes b0…b4 hold p_k = b_k<<2 | (b4>>2k)&3.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// How pixels are packed into bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Packing {
    /// One byte per pixel.
    U8,
    /// 5 bytes for 4 pixels, the low bits together in the last (Lytro Illum).
    Le10,
    /// 3 bytes for 2 pixels, most significant bits first (Lytro F01).
    Be12,
    /// 2 bytes per pixel, low byte first.
    Le16,
    /// 2 bytes per pixel, high byte first.
    Be16,
}

impl Packing {
    /// The packing of `bits` a pixel in the given byte order, if there is one.
    pub fn new(bits: u32, big: bool) -> Option<Packing> {
        match (bits, big) {
            (8, _) => Some(Packing::U8),
            (10, false) => Some(Packing::Le10),
            (12, true) => Some(Packing::Be12),
            (16, false) => Some(Packing::Le16),
            (16, true) => Some(Packing::Be16),
            _ => None,
        }
    }

    /// Bits per pixel.
    pub fn bits(self) -> u32 {
        match self {
            Packing::U8 => 8,
            Packing::Le10 => 10,
            Packing::Be12 => 12,
            Packing::Le16 | Packing::Be16 => 16,
        }
    }

    /// Byte order as metadata write it: `big` or `little`.
    pub fn endianness(self) -> &'static str {
        match self {
            Packing::Be12 | Packing::Be16 => "big",
            _ => "little",
        }
    }

    /// Pixels and bytes of the smallest whole group.
    fn group(self) -> (usize, usize) {
        match self {
            Packing::U8 => (1, 1),
            Packing::Le10 => (4, 5),
            Packing::Be12 => (2, 3),
            Packing::Le16 | Packing::Be16 => (1, 2),
        }
    }

    /// Bytes that `pixels` pixels take (an unfinished group is stored whole); `None` on overflow.
    pub fn bytes(self, pixels: usize) -> Option<usize> {
        let (n, b) = self.group();
        pixels.div_ceil(n).checked_mul(b)
    }

    /// Largest value that fits.
    pub fn max(self) -> u16 {
        u16::MAX >> (16 - self.bits())
    }
}

/// Groups handed to a thread at once: 128 to 512 KiB of pixels.
/// Source: chosen.
const CHUNK: usize = 1 << 16;

/// Unpacks the first `pixels` pixels of `bytes`; `None` when there are too few bytes.
///
/// ```
/// use lenslet_core::container::packing::{Packing, pack, unpack};
///
/// assert_eq!(unpack(Packing::Be12, &[0x12, 0x34, 0x56], 2), Some(vec![0x123, 0x456]));
/// assert_eq!(pack(Packing::Be12, &[0x123, 0x456]), Some(vec![0x12, 0x34, 0x56]));
/// assert_eq!(pack(Packing::Be12, &[4096]), None); // more than 12 bit
/// ```
pub fn unpack(packing: Packing, bytes: &[u8], pixels: usize) -> Option<Vec<u16>> {
    let bytes = bytes.get(..packing.bytes(pixels)?)?;
    let (n, b) = packing.group();
    let mut out = vec![0u16; pixels.div_ceil(n) * n];
    out.par_chunks_mut(n * CHUNK).zip(bytes.par_chunks(b * CHUNK)).for_each(|(out, bytes)| match packing {
        Packing::U8 => {
            for (o, &b) in out.iter_mut().zip(bytes) {
                *o = u16::from(b);
            }
        }
        Packing::Le16 => {
            for (o, b) in out.iter_mut().zip(bytes.as_chunks::<2>().0) {
                *o = u16::from_le_bytes(*b);
            }
        }
        Packing::Be16 => {
            for (o, b) in out.iter_mut().zip(bytes.as_chunks::<2>().0) {
                *o = u16::from_be_bytes(*b);
            }
        }
        Packing::Be12 => {
            for (o, &[b0, b1, b2]) in out.as_chunks_mut::<2>().0.iter_mut().zip(bytes.as_chunks::<3>().0) {
                *o = [u16::from(b0) << 4 | u16::from(b1) >> 4, u16::from(b1 & 15) << 8 | u16::from(b2)];
            }
        }
        Packing::Le10 => {
            for (o, &[b0, b1, b2, b3, low]) in out.as_chunks_mut::<4>().0.iter_mut().zip(bytes.as_chunks::<5>().0) {
                let low = u16::from(low);
                *o = [
                    u16::from(b0) << 2 | low & 3,
                    u16::from(b1) << 2 | low >> 2 & 3,
                    u16::from(b2) << 2 | low >> 4 & 3,
                    u16::from(b3) << 2 | low >> 6,
                ];
            }
        }
    });
    out.truncate(pixels);
    Some(out)
}

/// Packs pixels; `None` when a value does not fit. An unfinished last group is filled with zeros.
pub fn pack(packing: Packing, pixels: &[u16]) -> Option<Vec<u8>> {
    if pixels.iter().any(|&p| p > packing.max()) {
        return None;
    }
    let (n, b) = packing.group();
    let mut out = vec![0u8; packing.bytes(pixels.len())?];
    out.par_chunks_mut(b * CHUNK).zip(pixels.par_chunks(n * CHUNK)).for_each(|(out, pixels)| {
        for (o, p) in out.chunks_exact_mut(b).zip(pixels.chunks(n)) {
            let at = |k: usize| p.get(k).copied().unwrap_or(0);
            match packing {
                Packing::U8 => o[0] = at(0) as u8,
                Packing::Le16 => o.copy_from_slice(&at(0).to_le_bytes()),
                Packing::Be16 => o.copy_from_slice(&at(0).to_be_bytes()),
                Packing::Be12 => {
                    o[0] = (at(0) >> 4) as u8;
                    o[1] = ((at(0) & 15) << 4 | at(1) >> 8) as u8;
                    o[2] = (at(1) & 255) as u8;
                }
                Packing::Le10 => {
                    o[4] = 0;
                    for k in 0..4 {
                        o[k] = (at(k) >> 2) as u8;
                        o[4] |= ((at(k) & 3) << (2 * k)) as u8;
                    }
                }
            }
        }
    });
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The plain reference: a bit at a time.
    fn bit_by_bit(packing: Packing, bytes: &[u8], pixels: usize) -> Vec<u16> {
        let bit = |i: usize| u16::from(bytes[i / 8] >> (7 - i % 8) & 1);
        (0..pixels)
            .map(|p| match packing {
                Packing::Be12 => (0..12).fold(0, |v, k| v << 1 | bit(12 * p + k)),
                Packing::Be16 => (0..16).fold(0, |v, k| v << 1 | bit(16 * p + k)),
                Packing::U8 => (0..8).fold(0, |v, k| v << 1 | bit(8 * p + k)),
                Packing::Le16 => (0..16).fold(0, |v, k| v << 1 | bit(16 * p + (k + 8) % 16)),
                Packing::Le10 => {
                    let (g, k) = (p / 4 * 40, p % 4);
                    let high = (0..8).fold(0, |v, i| v << 1 | bit(g + 8 * k + i));
                    high << 2 | bit(g + 32 + 6 - 2 * k) << 1 | bit(g + 32 + 7 - 2 * k)
                }
            })
            .collect()
    }

    const ALL: [Packing; 5] = [Packing::U8, Packing::Le10, Packing::Be12, Packing::Le16, Packing::Be16];

    #[test]
    fn known_bytes() {
        assert_eq!(unpack(Packing::Be12, &[0x12, 0x34, 0x56], 2).unwrap(), [0x123, 0x456]);
        assert_eq!(
            unpack(Packing::Le10, &[0x00, 0xff, 0x80, 0x01, 0b11_10_01_00], 4).unwrap(),
            [0x000, 0x3fd, 0x202, 0x007]
        );
        assert_eq!(Packing::Be12.bytes(3280 * 3280), Some(16_137_600));
        assert_eq!(Packing::Le10.bytes(7728 * 5368), Some(51_854_880));
    }

    #[test]
    fn too_few_bytes_and_too_large_values_are_refused() {
        assert_eq!(unpack(Packing::Be12, &[0; 5], 4), None);
        assert_eq!(unpack(Packing::Le10, &[], usize::MAX), None);
        assert_eq!(pack(Packing::Be12, &[4096]), None);
        assert_eq!(pack(Packing::Le10, &[0, 1024]), None);
    }

    proptest! {
        #[test]
        fn unpacking_agrees_with_the_obvious_way(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
            for packing in ALL {
                let (n, b) = packing.group();
                let pixels = bytes.len() / b * n;
                prop_assert_eq!(unpack(packing, &bytes, pixels).unwrap(), bit_by_bit(packing, &bytes, pixels));
            }
        }

        #[test]
        fn packing_is_undone_by_unpacking(pixels in prop::collection::vec(any::<u16>(), 0..300)) {
            for packing in ALL {
                let pixels: Vec<u16> = pixels.iter().map(|p| p & packing.max()).collect();
                let bytes = pack(packing, &pixels).unwrap();
                prop_assert_eq!(Some(bytes.len()), packing.bytes(pixels.len()));
                prop_assert_eq!(unpack(packing, &bytes, pixels.len()).unwrap(), pixels);
            }
        }
    }

    #[test]
    fn chunk_borders_do_not_matter() {
        let pixels: Vec<u16> = (0..4 * CHUNK as u32 + 6).map(|i| (i * 37 % 1024) as u16).collect();
        for packing in [Packing::Le10, Packing::Be12, Packing::Be16] {
            assert_eq!(unpack(packing, &pack(packing, &pixels).unwrap(), pixels.len()).unwrap(), pixels);
        }
    }
}
