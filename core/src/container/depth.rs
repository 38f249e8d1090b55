//! Lytro's depth maps (f32 little-endian, depth in lambda, then perhaps confidence) as .pfm and 16-bit .png.

/// The planes of width x height f32 in `bytes`, at most two; `None` when there is not one whole plane.
pub fn planes(bytes: &[u8], (width, height): (usize, usize)) -> Option<Vec<Vec<f32>>> {
    let plane = width.checked_mul(height)?.checked_mul(4)?;
    let count = bytes.len().checked_div(plane)?.min(2);
    let values = |b: &[u8]| b.as_chunks::<4>().0.iter().map(|v| f32::from_le_bytes(*v)).collect();
    (count > 0).then(|| bytes.chunks_exact(plane).take(count).map(values).collect())
}

/// A plane as .pfm: little-endian, the lowest row first.
pub fn pfm(plane: &[f32], (width, height): (usize, usize)) -> Vec<u8> {
    let mut out = format!("Pf\n{width} {height}\n-1.0\n").into_bytes();
    for row in plane.chunks(width.max(1)).rev() {
        out.extend(row.iter().flat_map(|v| v.to_le_bytes()));
    }
    out
}

/// Smallest and largest finite value of a plane, if any is finite.
pub type Range = Option<(f32, f32)>;

/// A plane as 16-bit grey .png, its smallest finite value 0 and its largest 65535 (returned as well).
pub fn png(plane: &[f32], (width, height): (usize, usize)) -> Option<(Vec<u8>, Range)> {
    let finite = plane.iter().copied().filter(|v| v.is_finite());
    let range = finite.fold(None, |r: Range, v| Some(r.map_or((v, v), |(a, b)| (a.min(v), b.max(v)))));
    let (low, high) = range.unwrap_or((0.0, 0.0));
    let scale = if high > low { 65535.0 / (f64::from(high) - f64::from(low)) } else { 0.0 };
    let grey = plane.iter().map(|v| ((f64::from(*v) - f64::from(low)) * scale).round() as u16).collect();
    let picture: image::ImageBuffer<image::Luma<u16>, Vec<u16>> =
        image::ImageBuffer::from_raw(u32::try_from(width).ok()?, u32::try_from(height).ok()?, grey)?;
    let mut out = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut out, image::ImageFormat::Png).ok()?;
    Some((out.into_inner(), range))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_split_and_drawn() {
        let values: Vec<f32> = vec![-2.0, 0.0, f32::NAN, 1.0, 2.0, 3.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5];
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let p = planes(&bytes, (3, 2)).unwrap();
        assert_eq!(p.len(), 2);
        assert_eq!(planes(&bytes[..40], (3, 2)).unwrap().len(), 1);
        assert!(planes(&bytes, (30, 2)).is_none() && planes(&bytes, (0, 2)).is_none());
        let text = pfm(&p[0], (3, 2));
        assert!(text.starts_with(b"Pf\n3 2\n-1.0\n"));
        assert_eq!(&text[12..16], 1f32.to_le_bytes());
        let (file, range) = png(&p[0], (3, 2)).unwrap();
        assert_eq!(range, Some((-2.0, 3.0)));
        let back = image::load_from_memory(&file).unwrap().into_luma16();
        assert_eq!((back.get_pixel(0, 0).0[0], back.get_pixel(2, 1).0[0]), (0, 65535));
        assert_eq!(png(&p[1], (3, 2)).unwrap().1, Some((0.5, 0.5)));
    }
}
