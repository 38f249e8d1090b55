//! Algorithm 1, "rotate image by the estimated angle": resamples every pixel, bilinear. The default method does not
//! rotate.

use crate::geometry::Size;
use rayon::prelude::*;

use crate::calibration::sensor_image::SensorImage;
use crate::image::bilinear_by_weights;

/// The position in the unrotated image of a point of the rotated one: rotation by `angle` (radians, clockwise on
/// screen) about the centre of an image of `width`×`height` pixels.
#[inline]
pub fn to_unrotated(point: [f64; 2], angle: f64, size: Size) -> [f64; 2] {
    let Size { width, height } = size;
    let middle = [(width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0];
    let (s, c) = angle.sin_cos();
    let (dx, dy) = (point[0] - middle[0], point[1] - middle[1]);
    [middle[0] + c * dx - s * dy, middle[1] + s * dx + c * dy]
}

/// The image rotated so that a direction at `angle` (radians, clockwise on screen) becomes horizontal; 0 outside the
/// original.
pub fn rotate_image(image: &SensorImage, angle: f64) -> SensorImage {
    let (width, height) = (image.width, image.height);
    let mut data = vec![0f32; width * height];
    data.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, out) in row.iter_mut().enumerate() {
            let [sx, sy] = to_unrotated([x as f64, y as f64], angle, Size::new(width, height));
            if sx < 0.0 || sy < 0.0 || sx > (width - 1) as f64 || sy > (height - 1) as f64 {
                continue;
            }
            let (x0, y0) = ((sx as usize).min(width - 2), (sy as usize).min(height - 2));
            let (fx, fy) = ((sx - x0 as f64) as f32, (sy - y0 as f64) as f32);
            let corners = [image.at(x0, y0), image.at(x0 + 1, y0), image.at(x0, y0 + 1), image.at(x0 + 1, y0 + 1)];
            *out = bilinear_by_weights(corners, fx, fy);
        }
    });
    SensorImage { width, height, data, limit: image.limit }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_ramp_turns_exactly() {
        let (w, h) = (40, 30);
        let data = (0..w * h).map(|k| (2 * (k % w) + 3 * (k / w)) as f32).collect();
        let image = SensorImage { width: w, height: h, data, limit: [f32::MAX; 4] };
        let turned = rotate_image(&image, 0.1);
        for (x, y) in [(20, 15), (12, 9), (27, 20)] {
            let [sx, sy] = to_unrotated([x as f64, y as f64], 0.1, Size::new(w, h));
            assert!((f64::from(turned.at(x, y)) - (2.0 * sx + 3.0 * sy)).abs() < 1e-4);
        }
        assert_eq!(turned.at(0, 0), 0.0);
        assert_eq!(rotate_image(&image, 0.0).data, image.data);
    }
}
