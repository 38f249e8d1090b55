//! An 8-bit RGB picture, made of views in linear light or sRGB.

use lenslet_core::colour::srgb_encode;
use ndarray::ArrayView3;
use rayon::prelude::*;

/// An 8-bit RGB picture, sRGB-encoded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// 3·width·height bytes, row after row, red, green and blue of each pixel together.
    pub rgb: Vec<u8>,
}

impl Picture {
    /// A picture of a view in linear light (t, s, c), 0..1, of one channel or three; values outside are cut.
    ///
    /// ```
    /// use lenslet::image_io::Picture;
    /// use ndarray::Array3;
    ///
    /// // Half of the light of white is 188 of 255 in sRGB.
    /// let picture = Picture::from_linear(&Array3::from_elem((2, 3, 1), 0.5).view());
    /// assert_eq!((picture.width, picture.height), (3, 2));
    /// assert_eq!(picture.rgb, [188; 18]);
    /// ```
    #[must_use]
    pub fn from_linear(view: &ArrayView3<f32>) -> Picture {
        // The curve is smooth enough for a table of the square root.
        const STEPS: usize = 4095;
        let table: Vec<u8> = (0..=STEPS)
            .map(|k| {
                let root = k as f32 / STEPS as f32;
                (srgb_encode(root * root) * 255.0 + 0.5) as u8
            })
            .collect();
        Picture::from_values(view, |v| table[(v.clamp(0.0, 1.0).sqrt() * STEPS as f32 + 0.5) as usize])
    }

    /// A picture of sRGB-encoded values (t, s, c), 0..1, of one channel or three; values outside are cut.
    #[must_use]
    pub fn from_srgb(view: &ArrayView3<f32>) -> Picture {
        Picture::from_values(view, |v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
    }

    fn from_values(view: &ArrayView3<f32>, byte_of: impl Fn(f32) -> u8 + Sync) -> Picture {
        let (height, width, channels) = view.dim();
        let mut rgb = vec![0u8; 3 * width * height];
        rgb.par_chunks_mut((3 * width).max(1)).enumerate().for_each(|(t, row)| {
            for (s, pixel) in row.chunks_exact_mut(3).enumerate() {
                for (k, byte) in pixel.iter_mut().enumerate() {
                    *byte = byte_of(view[[t, s, k.min(channels - 1)]]);
                }
            }
        });
        Picture { width, height, rgb }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lenslet_core::colour::srgb_decode;
    use ndarray::Array3;

    #[test]
    fn screen_values_follow_the_curve() {
        let image = Array3::from_shape_fn((1, 256, 1), |(_, s, _)| srgb_decode(s as f32 / 255.0));
        let picture = Picture::from_linear(&image.view());
        for (s, p) in picture.rgb.chunks(3).enumerate() {
            assert!(p.iter().all(|&b| (i32::from(b) - s as i32).abs() <= 1), "{s}: {p:?}");
        }
    }
}
