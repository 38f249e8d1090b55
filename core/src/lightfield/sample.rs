//! Samples as files store them, turned into f32 values.

/// A stored number: kind and byte order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SampleFormat {
    pub(super) kind: SampleKind,
    pub(super) big_endian: bool,
}

/// The type of a stored number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SampleKind {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    F32,
    F64,
}

impl SampleKind {
    /// Bytes of one number.
    pub(super) fn bytes(self) -> usize {
        match self {
            SampleKind::U8 | SampleKind::I8 => 1,
            SampleKind::U16 | SampleKind::I16 => 2,
            SampleKind::U32 | SampleKind::I32 | SampleKind::F32 => 4,
            SampleKind::F64 => 8,
        }
    }

    /// The value that represents 1.0: the largest one of an unsigned integer, 1 of floating point.
    /// `None` where no convention exists.
    pub(super) fn full_scale(self) -> Option<f32> {
        match self {
            SampleKind::U8 => Some(255.0),
            SampleKind::U16 => Some(65535.0),
            SampleKind::F32 | SampleKind::F64 => Some(1.0),
            SampleKind::I8 | SampleKind::I16 | SampleKind::U32 | SampleKind::I32 => None,
        }
    }
}

impl SampleFormat {
    /// One number of exactly [`SampleKind::bytes`] bytes; anything shorter reads as 0.
    pub(super) fn read(self, bytes: &[u8]) -> f64 {
        fn pick<const N: usize>(bytes: &[u8], big_endian: bool) -> [u8; N] {
            let mut out = [0; N];
            for (to, from) in out.iter_mut().zip(bytes) {
                *to = *from;
            }
            if big_endian {
                out.reverse();
            }
            out
        }
        let big = self.big_endian;
        match self.kind {
            SampleKind::U8 => f64::from(pick::<1>(bytes, false)[0]),
            SampleKind::I8 => f64::from(i8::from_le_bytes(pick(bytes, false))),
            SampleKind::U16 => f64::from(u16::from_le_bytes(pick(bytes, big))),
            SampleKind::I16 => f64::from(i16::from_le_bytes(pick(bytes, big))),
            SampleKind::U32 => f64::from(u32::from_le_bytes(pick(bytes, big))),
            SampleKind::I32 => f64::from(i32::from_le_bytes(pick(bytes, big))),
            SampleKind::F32 => f64::from(f32::from_le_bytes(pick(bytes, big))),
            SampleKind::F64 => f64::from_le_bytes(pick(bytes, big)),
        }
    }

    /// Numbers in a row, divided by `scale`.
    pub(super) fn read_all(self, bytes: &[u8], scale: f32) -> Vec<f32> {
        match (self.kind, self.big_endian) {
            (SampleKind::U8, _) => bytes.iter().map(|&b| f32::from(b) / scale).collect(),
            (SampleKind::U16, false) => {
                bytes.as_chunks().0.iter().map(|&b| f32::from(u16::from_le_bytes(b)) / scale).collect()
            }
            (SampleKind::F32, false) => bytes.as_chunks().0.iter().map(|&b| f32::from_le_bytes(b) / scale).collect(),
            _ => {
                let scale = f64::from(scale);
                bytes.chunks_exact(self.kind.bytes()).map(|b| (self.read(b) / scale) as f32).collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_byte_orders_of_every_kind() {
        let read = |kind, bytes: &[u8]| {
            let mut reversed = bytes.to_vec();
            reversed.reverse();
            let little = SampleFormat { kind, big_endian: false };
            let big = SampleFormat { kind, big_endian: true };
            assert_eq!(little.read(bytes), big.read(&reversed));
            assert_eq!(little.read_all(bytes, 1.0), vec![little.read(bytes) as f32]);
            assert_eq!(big.read_all(&reversed, 1.0), vec![little.read(bytes) as f32]);
            little.read(bytes)
        };
        assert_eq!(read(SampleKind::U8, &[200]), 200.0);
        assert_eq!(read(SampleKind::I8, &[200]), -56.0);
        assert_eq!(read(SampleKind::U16, &[1, 2]), 513.0);
        assert_eq!(read(SampleKind::I16, &[255, 255]), -1.0);
        assert_eq!(read(SampleKind::U32, &[0, 0, 1, 0]), 65536.0);
        assert_eq!(read(SampleKind::I32, &(-5i32).to_le_bytes()), -5.0);
        assert_eq!(read(SampleKind::F32, &0.25f32.to_le_bytes()), 0.25);
        assert_eq!(read(SampleKind::F64, &0.125f64.to_le_bytes()), 0.125);
    }
}
