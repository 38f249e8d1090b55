//! Disparity put to use: seen from other views, as colours, as PFM, as a point cloud.

use anyhow::{Result, ensure};
use ndarray::{Array2, ArrayView2};

use super::disparity::Plane;
use super::picture::Picture;

/// The middle view's disparity as the view `step` = (u, v) away sees it: nearest surfaces win (`front` −1: those of the smaller
/// disparity, +1: of the larger), gaps are filled with what lies behind. Units: pixels per view step, pixels of this map.
pub fn carry(disparity: &Array2<f32>, step: [f32; 2], front: f32) -> Array2<f32> {
    let (height, width) = disparity.dim();
    let plane = Plane { width, height, data: disparity.iter().copied().collect() };
    let carried = carry_plane(&plane, [1.0, 1.0], step, front);
    Array2::from_shape_vec((height, width), carried.data).unwrap_or_else(|_| disparity.clone())
}

/// As [`carry`], for a map whose pixels are `scale` (x, y) times larger than the unit of its disparities.
pub fn carry_plane(central: &Plane, scale: [f32; 2], step: [f32; 2], front: f32) -> Plane {
    if step == [0.0, 0.0] {
        return central.clone();
    }
    let (w, h) = (central.width, central.height);
    let mut out = Plane::filled(w, h, f32::NAN);
    for t in 0..h {
        for s in 0..w {
            let d = central.data[t * w + s];
            let (x, y) = (s as f32 + d * step[0] / scale[0], t as f32 + d * step[1] / scale[1]);
            let (x0, y0) = (x.floor(), y.floor());
            for (px, py) in [(x0, y0), (x0 + 1.0, y0), (x0, y0 + 1.0), (x0 + 1.0, y0 + 1.0)] {
                // A pixel covers what is within 0.75 of it: no cracks in slanted surfaces, little overhang at edges.
                let near = (px - x).abs() <= 0.75 && (py - y).abs() <= 0.75;
                if !(near && px >= 0.0 && py >= 0.0 && px < w as f32 && py < h as f32) {
                    continue;
                }
                let cell = &mut out.data[py as usize * w + px as usize];
                if cell.is_nan() || front * d > front * *cell {
                    *cell = d;
                }
            }
        }
    }
    fill(&mut out, step, front);
    out
}

/// Fills what no surface covered: of the first values found both ways along the movement `step`, the one further behind.
fn fill(plane: &mut Plane, step: [f32; 2], front: f32) {
    let (w, h) = (plane.width as isize, plane.height as isize);
    let longer = step[0].abs().max(step[1].abs());
    let way = [step[0] / longer, step[1] / longer];
    let find = |s: isize, t: isize, sign: f32| {
        (1..w.max(h)).find_map(|k| {
            let along = |c: isize, d: f32| c + (sign * k as f32 * d).round() as isize;
            let (x, y) = (along(s, way[0]), along(t, way[1]));
            if x < 0 || y < 0 || x >= w || y >= h {
                return Some(f32::NAN);
            }
            let d = plane.data[(y * w + x) as usize];
            (!d.is_nan()).then_some(d)
        })
    };
    let mut found = Vec::new();
    for t in 0..h {
        for s in 0..w {
            let k = (t * w + s) as usize;
            if plane.data[k].is_nan() {
                let (a, b) = (find(s, t, 1.0).unwrap_or(f32::NAN), find(s, t, -1.0).unwrap_or(f32::NAN));
                // f32::min and max pass over NaN.
                let behind = if front < 0.0 { a.max(b) } else { a.min(b) };
                found.push((k, behind));
            }
        }
    }
    for (k, d) in found {
        plane.data[k] = if d.is_nan() { 0.0 } else { d };
    }
}

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

/// How an estimate compares with the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Errors {
    /// Share of pixels off by more than the threshold.
    pub bad: f64,
    /// Mean squared error times 100.
    pub mse100: f64,
    /// Median absolute error.
    pub median: f64,
    /// Pixels compared.
    pub pixels: usize,
}

/// Compares where `counts` says so and the truth is a number, leaving out `border` pixels on each side.
pub fn errors(
    found: &Array2<f32>,
    truth: &Array2<f32>,
    border: usize,
    threshold: f32,
    counts: impl Fn(usize, usize) -> bool,
) -> Option<Errors> {
    let (height, width) = found.dim();
    if truth.dim() != (height, width) || 2 * border >= height.min(width) {
        return None;
    }
    let mut list = Vec::new();
    for t in border..height - border {
        for s in border..width - border {
            let e = (found[[t, s]] - truth[[t, s]]).abs();
            if e.is_finite() && counts(t, s) {
                list.push(e);
            }
        }
    }
    if list.is_empty() {
        return None;
    }
    list.sort_unstable_by(f32::total_cmp);
    let n = list.len() as f64;
    let bad = list.iter().filter(|e| **e > threshold).count() as f64 / n;
    let mse = list.iter().map(|e| f64::from(*e).powi(2)).sum::<f64>() / n;
    Some(Errors { bad, mse100: 100.0 * mse, median: f64::from(list[list.len() / 2]), pixels: list.len() })
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
    fn a_near_square_moves_over_a_far_ground() {
        // Nearer is smaller: the square has −1, the ground 0; two steps to the right move it two pixels left.
        let map =
            Array2::from_shape_fn(
                (20, 20),
                |(t, s)| if (8..12).contains(&t) && (8..12).contains(&s) { -1.0f32 } else { 0.0 },
            );
        let seen = carry(&map, [2.0, 0.0], -1.0);
        for t in 0..20 {
            for s in 0..20 {
                let square = (8..12).contains(&t) && (6..10).contains(&s);
                assert_eq!(seen[[t, s]], if square { -1.0 } else { 0.0 }, "{s},{t}");
            }
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

    #[test]
    fn errors_count_what_they_should() {
        let truth = Array2::from_elem((10, 10), 1.0f32);
        let mut found = truth.clone();
        found[[5, 5]] = 1.1;
        found[[0, 0]] = 9.0;
        let e = errors(&found, &truth, 1, 0.07, |_, _| true).unwrap();
        assert_eq!(e.pixels, 64);
        assert!((e.bad - 1.0 / 64.0).abs() < 1e-9 && (e.mse100 - 100.0 * 0.01 / 64.0).abs() < 1e-3);
    }
}
