//! Disparity as colours and as a point cloud.

use lenslet_core::ensure;
use lenslet_views::disparity::DepthOrder;
use ndarray::{Array2, ArrayView2};

use super::error::Error;
use crate::image_io::Picture;

/// Values (t, s) as colours from deep blue (`range.0`) over green to yellow (`range.1`), their brightness rising
/// evenly; values outside take the colour of the nearer end, those that are no numbers that of `range.0`.
///
/// ```
/// use lenslet::apps::depth::colour_map;
/// use ndarray::array;
///
/// let picture = colour_map(&array![[0.0_f32, 1.0]].view(), (0.0, 1.0));
/// assert_eq!(picture.rgb, [48, 18, 92, 253, 245, 160]);
/// ```
pub fn colour_map(values: &ArrayView2<f32>, range: (f32, f32)) -> Picture {
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

/// A binary PLY point cloud: x right, y up, z towards the viewer, in pixels of the view, `depth` pixels from the
/// furthest (smallest or largest disparity, by `order`) to the nearest; colour and confidence at each point. Points
/// less confident than `least` are left out.
///
/// # Errors
/// [`Error::Shape`] when the sizes differ.
///
/// ```
/// use lenslet::apps::depth::{colour_map, point_cloud_ply};
/// use lenslet::disparity::DepthOrder;
/// use ndarray::array;
///
/// let disparity = array![[-1.0_f32, 0.5]];
/// let picture = colour_map(&disparity.view(), (-1.0, 0.5));
/// let confidence = array![[1.0, 0.1]];
/// let ply = point_cloud_ply(&disparity, &confidence, &picture, DepthOrder::default(), 100.0, 0.2)?;
/// assert!(String::from_utf8_lossy(&ply).contains("element vertex 1\n"));
/// # Ok::<(), lenslet::apps::Error>(())
/// ```
pub fn point_cloud_ply(
    disparity: &Array2<f32>,
    confidence: &Array2<f32>,
    picture: &Picture,
    order: DepthOrder,
    depth: f32,
    least: f32,
) -> Result<Vec<u8>, Error> {
    let (height, width) = disparity.dim();
    ensure!(
        Error::Shape,
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
        let z = order.sign() * (d[k] - order.behind(lo, hi)) * unit;
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
    fn a_cloud_has_one_point_a_confident_pixel() {
        let d = Array2::from_shape_fn((4, 6), |(_, s)| s as f32);
        let c = Array2::from_shape_fn((4, 6), |(t, _)| if t < 2 { 1.0f32 } else { 0.0 });
        let picture = Picture { width: 6, height: 4, rgb: vec![7; 72] };
        let bytes = point_cloud_ply(&d, &c, &picture, DepthOrder::NearerIsSmaller, 10.0, 0.5).unwrap();
        let header = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        assert_eq!(bytes.len() - header, 12 * 19);
        let z = |k: usize| f32::from_le_bytes(bytes[header + 19 * k + 8..header + 19 * k + 12].try_into().unwrap());
        assert_eq!((z(0), z(5)), (10.0, 0.0));
    }
}
