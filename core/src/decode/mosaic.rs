//! A mosaic in linear light: one value per pixel, its colour given by the filter array.

/// A mosaic in linear light.
#[derive(Debug, Clone, PartialEq)]
pub struct Mosaic {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width·height` values, row-major; 1 = the light of a white surface that just saturates the first colour.
    pub data: Vec<f32>,
}

/// `v` mirrored about the border pixels into `0..n`, which keeps the colours of a filter array in step.
#[inline]
pub(super) fn mirror(v: i64, n: usize) -> usize {
    let last = n as i64 - 1;
    let v = if v < 0 { -v } else { v };
    (if v > last { 2 * last - v } else { v }).clamp(0, last) as usize
}
