//! Sixteen f32 in memory, and rows of them as one slice.

/// Sixteen lanes in memory, one cache line.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct Chunk(pub [f32; 16]);

impl Chunk {
    pub const ZERO: Chunk = Chunk([0.0; 16]);
}

/// Chunk i has a one in lane i.
pub(crate) static UNITS: [Chunk; 16] = {
    let mut units = [Chunk::ZERO; 16];
    let mut i = 0;
    while i < 16 {
        units[i].0[i] = 1.0;
        i += 1;
    }
    units
};

/// Chunks as one row of f32.
#[inline(always)]
pub(crate) fn flat(chunks: &[Chunk]) -> &[f32] {
    // SAFETY: `Chunk` is `repr(C)`, 64 bytes, without padding: n chunks are exactly 16·n f32, all initialised.
    unsafe { std::slice::from_raw_parts(chunks.as_ptr().cast(), chunks.len() * 16) }
}

/// Chunks as one row of f32, to be written.
#[inline(always)]
pub(crate) fn flat_mut(chunks: &mut [Chunk]) -> &mut [f32] {
    // SAFETY: as in `flat`; the borrow stays exclusive.
    unsafe { std::slice::from_raw_parts_mut(chunks.as_mut_ptr().cast(), chunks.len() * 16) }
}
