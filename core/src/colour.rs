//! The sRGB transfer curve and the luminance of colours.
//!
//! The curve (IEC 61966-2-1) maps linear light 0..1 to encoded values 0..1 and back. Values below 0 are mirrored and
//! values above 1 follow the curve, so the two directions are inverse to each other everywhere.

use ndarray::{Array2, ArrayView3, Axis};

/// Weights of R, G and B in the luminance that scores, disparity and learning use; they sum to one.
/// Source: ITU-R BT.601; applied to encoded values.
pub const LUMINANCE: [f32; 3] = [0.299, 0.587, 0.114];

/// Weights of linear R, G and B in the luminance Y of linear sRGB; they sum to one.
/// Source: ITU-R BT.709, the primaries of sRGB.
pub const LUMINANCE_OF_LINEAR: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// Linear light to its sRGB-encoded value.
///
/// ```
/// use lenslet_core::colour::srgb_encode;
/// assert!((srgb_encode(0.214_041) - 0.5).abs() < 1e-6);
/// assert_eq!(srgb_encode(-0.2), -srgb_encode(0.2));
/// ```
#[must_use]
pub fn srgb_encode(linear: f32) -> f32 {
    let x = linear.abs();
    let y = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    y.copysign(linear)
}

/// sRGB-encoded value to linear light.
///
/// ```
/// use lenslet_core::colour::srgb_decode;
/// assert!((srgb_decode(0.5) - 0.214_041).abs() < 1e-6);
/// ```
#[must_use]
pub fn srgb_decode(encoded: f32) -> f32 {
    let x = encoded.abs();
    let y = if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
    y.copysign(encoded)
}

/// Luminance of a picture (t, s, c): the sum of three channels weighted by [`LUMINANCE`], or the first channel.
///
/// ```
/// use lenslet_core::colour::luminance;
/// let green = ndarray::Array3::from_shape_fn((1, 1, 3), |(_, _, c)| if c == 1 { 1.0 } else { 0.0 });
/// assert_eq!(luminance(green.view())[[0, 0]], 0.587);
/// ```
#[must_use]
pub fn luminance(picture: ArrayView3<'_, f32>) -> Array2<f32> {
    if picture.dim().2 == 3 {
        picture.map_axis(Axis(2), |p| LUMINANCE[0] * p[0] + LUMINANCE[1] * p[1] + LUMINANCE[2] * p[2])
    } else {
        picture.index_axis(Axis(2), 0).to_owned()
    }
}

/// Luminance of one pixel in linear light: R, G and B weighted by [`LUMINANCE_OF_LINEAR`].
///
/// ```
/// use lenslet_core::colour::luminance_of_linear;
/// assert_eq!(luminance_of_linear([0.0, 1.0, 0.0]), 0.7152);
/// ```
#[must_use]
#[inline(always)]
pub fn luminance_of_linear([r, g, b]: [f32; 3]) -> f32 {
    LUMINANCE_OF_LINEAR[0] * r + LUMINANCE_OF_LINEAR[1] * g + LUMINANCE_OF_LINEAR[2] * b
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn known_values_and_inverse() {
        // 0.5 encoded is 0.214041 in linear light (IEC 61966-2-1, worked by hand).
        assert!((srgb_decode(0.5) - 0.214_041).abs() < 1e-6);
        assert!((srgb_encode(1.0) - 1.0).abs() < 1e-6 && srgb_encode(0.0) == 0.0);
        for i in -20..=60 {
            let x = i as f32 / 40.0;
            assert!((srgb_decode(srgb_encode(x)) - x).abs() < 2e-5, "{x}");
        }
    }

    #[test]
    fn luminance_weights_and_single_channel() {
        let p = array![[[1.0f32, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.5, 0.5, 0.5]]];
        let y = luminance(p.view());
        for (got, expected) in y.iter().zip([0.299, 0.587, 0.114, 0.5]) {
            assert!((got - expected).abs() < 1e-6);
        }
        assert_eq!(luminance(array![[[0.25f32]]].view()), array![[0.25]]);
        for weights in [LUMINANCE, LUMINANCE_OF_LINEAR] {
            assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        }
    }
}
