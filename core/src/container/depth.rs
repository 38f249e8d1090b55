//! Lytro's depth maps: 32-bit little-endian floats, a plane of depths in the camera's unit λ, then perhaps a plane of
//! confidences.

use std::io::Cursor;

use crate::geometry::Size;
use image::{ImageBuffer, ImageFormat, Luma};
use ndarray::{Array2, ArrayView2};

/// The planes (t, s) of `size` floats in `bytes`, at most two; `None` when there is not one whole plane.
pub fn read_depth_planes(bytes: &[u8], size: Size) -> Option<Vec<Array2<f32>>> {
    let plane = size.pixels()?.checked_mul(4)?;
    let count = bytes.len().checked_div(plane)?.min(2);
    let values = |b: &[u8]| b.as_chunks::<4>().0.iter().map(|v| f32::from_le_bytes(*v)).collect();
    let planes = bytes.chunks_exact(plane.max(1)).take(count);
    let planes = planes
        .map(|b| Array2::from_shape_vec((size.height, size.width), values(b)).ok())
        .collect::<Option<Vec<_>>>()?;
    (count > 0).then_some(planes)
}

/// Smallest and largest finite value of a plane, if any is finite.
pub type Range = Option<(f32, f32)>;

/// A plane as 16-bit grey PNG, its smallest finite value 0 and its largest 65535 (returned as well).
pub fn depth_png(plane: ArrayView2<f32>) -> Option<(Vec<u8>, Range)> {
    let finite = plane.iter().copied().filter(|v| v.is_finite());
    let range = finite.fold(None, |r: Range, v| Some(r.map_or((v, v), |(a, b)| (a.min(v), b.max(v)))));
    let (low, high) = range.unwrap_or((0.0, 0.0));
    let scale = if high > low { 65535.0 / (f64::from(high) - f64::from(low)) } else { 0.0 };
    let grey = plane.iter().map(|v| ((f64::from(*v) - f64::from(low)) * scale).round() as u16).collect();
    let (height, width) = plane.dim();
    let picture: ImageBuffer<Luma<u16>, Vec<u16>> =
        ImageBuffer::from_raw(u32::try_from(width).ok()?, u32::try_from(height).ok()?, grey)?;
    let mut out = Cursor::new(Vec::new());
    picture.write_to(&mut out, ImageFormat::Png).ok()?;
    Some((out.into_inner(), range))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_split_and_drawn() {
        let values: Vec<f32> = vec![-2.0, 0.0, f32::NAN, 1.0, 2.0, 3.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5];
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let p = read_depth_planes(&bytes, Size::new(3, 2)).unwrap();
        assert_eq!(p.len(), 2);
        assert_eq!(read_depth_planes(&bytes[..40], Size::new(3, 2)).unwrap().len(), 1);
        assert!(
            read_depth_planes(&bytes, Size::new(30, 2)).is_none()
                && read_depth_planes(&bytes, Size::new(0, 2)).is_none()
        );
        assert_eq!((p[0][[0, 1]], p[0][[1, 0]]), (0.0, 1.0));
        let (file, range) = depth_png(p[0].view()).unwrap();
        assert_eq!(range, Some((-2.0, 3.0)));
        let back = image::load_from_memory(&file).unwrap().into_luma16();
        assert_eq!((back.get_pixel(0, 0).0[0], back.get_pixel(2, 1).0[0]), (0, 65535));
        assert_eq!(depth_png(p[1].view()).unwrap().1, Some((0.5, 0.5)));
    }
}
