//! Disparity put to use: as colours, as PFM, as a point cloud.

use anyhow::{Result, ensure};
use ndarray::{Array2, ArrayView2};

use super::picture::Picture;

/// Colours from deep blue (`range.0`) over green to yellow (`range.1`), even in brightness.
pub fn colours(values: &ArrayView2<f32>, range: (f32, f32)) -> Picture {
    const STOPS: [[f32; 3]; 6] = [
        [48.0, 18.0, 92.0],
        [59.0, 82.0, 139.0],
        [33.0, 145.0, 140.0],
        [94.0, 201.0, 98.0],
        [190.0, 223.0, 38.0],
        [253.0, 245.0, 160.0],
    ];
    let (height, width) = values.dim();
    let span = if range.1 > range.0 { range.1 - range.0 } else { 1.0 };
    let mut rgb = Vec::with_capacity(3 * width * height);
    for v in values {
        let x = ((v - range.0) / span).clamp(0.0, 1.0) * 5.0;
        let x = if x.is_finite() { x } else { 0.0 };
        let k = (x as usize).min(4);
        let f = x - k as f32;
        rgb.extend((0..3).map(|c| (STOPS[k][c] * (1.0 - f) + STOPS[k + 1][c] * f + 0.5) as u8));
    }
    Picture { width, height, rgb }
}

/// A PFM file's bytes: 32-bit little-endian floats, bottom row first.
pub fn pfm(values: &Array2<f32>) -> Vec<u8> {
    let (height, width) = values.dim();
    let mut bytes = format!("Pf\n{width} {height}\n-1.0\n").into_bytes();
    for row in values.outer_iter().rev() {
        for v in row {
            bytes.extend_from_slice(&v.to_le_bytes());
        }
    }
    bytes
}

/// Reads a one-channel PFM, either byte order; top row first in the result.
///
/// # Errors
/// When the bytes are not a PFM of that many pixels.
pub fn read_pfm(bytes: &[u8]) -> Result<Array2<f32>> {
    let mut words = Vec::new();
    let mut at = 0;
    while words.len() < 4 {
        while bytes.get(at).is_some_and(u8::is_ascii_whitespace) {
            at += 1;
        }
        let end = bytes[at..].iter().position(u8::is_ascii_whitespace).map(|n| at + n);
        let Some(end) = end.filter(|&e| e > at && e - at < 32) else {
            anyhow::bail!("not a PFM file: the header ends early")
        };
        words.push(std::str::from_utf8(&bytes[at..end])?);
        at = end;
    }
    ensure!(words[0] == "Pf", "not a one-channel PFM file");
    let (width, height): (usize, usize) = (words[1].parse()?, words[2].parse()?);
    let little = words[3].parse::<f32>()? < 0.0;
    let data = &bytes[at + 1..];
    let count = width.checked_mul(height).filter(|&n| n > 0 && n.checked_mul(4) == Some(data.len()));
    ensure!(count.is_some(), "the PFM says {width}x{height} but holds {} bytes", data.len());
    let value = |b: &[u8]| {
        let b = [b[0], b[1], b[2], b[3]];
        if little { f32::from_le_bytes(b) } else { f32::from_be_bytes(b) }
    };
    let values: Vec<f32> = data.chunks_exact(4 * width).rev().flat_map(|row| row.chunks_exact(4).map(value)).collect();
    Ok(Array2::from_shape_vec((height, width), values)?)
}

/// A binary PLY point cloud: x right, y up, z towards the viewer, in pixels of the view, `depth` pixels from the furthest to
/// the nearest; colour and confidence at each point. Points less confident than `least` are left out.
///
/// # Errors
/// When the sizes differ.
pub fn ply(
    disparity: &Array2<f32>,
    confidence: &Array2<f32>,
    picture: &Picture,
    front: f32,
    depth: f32,
    least: f32,
) -> Result<Vec<u8>> {
    let (height, width) = disparity.dim();
    ensure!(
        confidence.dim() == (height, width) && (picture.height, picture.width) == (height, width),
        "disparity, confidence and picture differ in size"
    );
    let lo = disparity.iter().copied().fold(f32::INFINITY, f32::min);
    let hi = disparity.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let unit = if hi > lo { depth / (hi - lo) } else { 0.0 };
    let kept: Vec<usize> = confidence.iter().enumerate().filter(|(_, c)| **c >= least).map(|(k, _)| k).collect();
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\ncomment z = disparity scaled to {depth} pixels, not metric\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
         property float confidence\nend_header\n",
        kept.len()
    )
    .into_bytes();
    let (d, c): (Vec<f32>, Vec<f32>) = (disparity.iter().copied().collect(), confidence.iter().copied().collect());
    for k in kept {
        let z = front * (d[k] - if front < 0.0 { hi } else { lo }) * unit;
        for v in [(k % width) as f32, -((k / width) as f32), z] {
            bytes.extend_from_slice(&v.to_le_bytes());
        }
        bytes.extend_from_slice(&picture.rgb[3 * k..3 * k + 3]);
        bytes.extend_from_slice(&c[k].to_le_bytes());
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pfm_reads_back() {
        let values = Array2::from_shape_fn((3, 5), |(t, s)| t as f32 * 0.5 - s as f32);
        assert_eq!(read_pfm(&pfm(&values)).unwrap(), values);
        for bad in [
            &b""[..],
            b"Pf",
            b"Pf\n3 3\n-1\n1234",
            b"PF\n1 1\n-1\n123412341234",
            b"Pf\n99999999999 99999999999\n-1\n",
            b"Pf\n0 0\n-1\n",
        ] {
            assert!(read_pfm(bad).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn a_cloud_has_one_point_a_confident_pixel() {
        let d = Array2::from_shape_fn((4, 6), |(_, s)| s as f32);
        let c = Array2::from_shape_fn((4, 6), |(t, _)| if t < 2 { 1.0f32 } else { 0.0 });
        let picture = Picture { width: 6, height: 4, rgb: vec![7; 72] };
        let bytes = ply(&d, &c, &picture, -1.0, 10.0, 0.5).unwrap();
        let header = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        assert_eq!(bytes.len() - header, 12 * 19);
        let z = |k: usize| f32::from_le_bytes(bytes[header + 19 * k + 8..header + 19 * k + 12].try_into().unwrap());
        assert_eq!((z(0), z(5)), (10.0, 0.0));
    }
}
