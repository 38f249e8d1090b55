//! Luminance of colour pictures: the plane that PSNR-Y and SSIM are computed on.

use ndarray::{Array2, ArrayView3, Axis};

/// Weights of R, G and B in luminance (ITU-R BT.601).
pub const LUMINANCE: [f32; 3] = [0.299, 0.587, 0.114];

/// Luminance of a picture (t, s, c): the weighted sum of three channels, or the single channel.
pub fn luminance(picture: ArrayView3<f32>) -> Array2<f32> {
    if picture.dim().2 == 3 {
        picture.map_axis(Axis(2), |p| LUMINANCE[0] * p[0] + LUMINANCE[1] * p[1] + LUMINANCE[2] * p[2])
    } else {
        picture.index_axis(Axis(2), 0).to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn luminance_weights_and_single_channel() {
        let p = array![[[1.0f32, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.5, 0.5, 0.5]]];
        let y = luminance(p.view());
        for (got, expected) in y.iter().zip([0.299, 0.587, 0.114, 0.5]) {
            assert!((got - expected).abs() < 1e-6);
        }
        assert_eq!(luminance(array![[[0.25f32]]].view()), array![[0.25]]);
    }
}
