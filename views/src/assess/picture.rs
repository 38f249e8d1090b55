//! Luminance of pictures, reads between its pixels, smoothing.

use lenslet_core::colour::{luminance_of_linear, srgb_encode};
use lenslet_core::geometry::Size;
use lenslet_core::image::{GaussianFilter, Plane, catmull_rom_weights};
use ndarray::{ArrayView1, ArrayView3};

/// Luminance of one value in linear light, of three channels or one.
pub(super) fn light_of(value: ArrayView1<'_, f32>) -> f32 {
    if value.len() == 3 { luminance_of_linear([value[0], value[1], value[2]]) } else { value[0] }
}

/// sRGB-encoded, clamped to what a screen shows.
pub(super) fn encode(light: f32) -> f32 {
    srgb_encode(light.clamp(0.0, 1.0))
}

/// Luminance of a picture (t, s, c) in linear light.
pub(super) fn linear_light(picture: ArrayView3<'_, f32>) -> Plane {
    let (height, width, _) = picture.dim();
    Plane { width, height, data: picture.rows().into_iter().map(light_of).collect() }
}

/// Luminance of a picture (t, s, c) in linear light, encoded and clamped.
pub(super) fn encoded_light(picture: ArrayView3<'_, f32>) -> Plane {
    let mut plane = linear_light(picture);
    plane.data.iter_mut().for_each(|x| *x = encode(*x));
    plane
}

/// Mean of planes of one size.
pub(super) fn mean_of(planes: [&Plane; 2]) -> Plane {
    let [a, b] = planes;
    let data = a.data.iter().zip(&b.data).map(|(a, b)| 0.5 * (a + b)).collect();
    Plane { width: a.width, height: a.height, data }
}

/// Catmull–Rom interpolation at (`x`, `y`); pixels at the border repeat.
pub(super) fn read_between(plane: &Plane, x: f64, y: f64) -> f32 {
    let (x0, y0) = (x.floor(), y.floor());
    let (wx, wy) = (catmull_rom_weights((x - x0) as f32), catmull_rom_weights((y - y0) as f32));
    let inside = |k: f64, n: usize| k.clamp(0.0, (n - 1) as f64) as usize;
    let mut sum = 0.0;
    for (j, wy) in wy.into_iter().enumerate() {
        let row = plane.row(inside(y0 + j as f64 - 1.0, plane.height));
        let at = |i: usize| row[inside(x0 + i as f64 - 1.0, plane.width)];
        sum += wy * (0..4).map(|i| wx[i] * at(i)).sum::<f32>();
    }
    sum
}

/// Gaussian smoothing with standard deviation `sigma` pixels; pixels at the border repeat.
pub(super) fn gaussian(plane: &Plane, sigma: f64) -> Plane {
    let mut smooth = plane.clone();
    filter_of(sigma).smooth(&mut smooth.data, Size::new(plane.width, plane.height));
    smooth
}

/// Gaussian smoothing of a list; the ends repeat.
pub(super) fn gaussian_line(values: &[f64], sigma: f64) -> Vec<f64> {
    let mut line: Vec<f32> = values.iter().map(|v| *v as f32).collect();
    filter_of(sigma).smooth_line(&mut line);
    line.into_iter().map(f64::from).collect()
}

/// Out to four standard deviations.
fn filter_of(sigma: f64) -> GaussianFilter {
    GaussianFilter::new(sigma as f32, 4.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_and_smoothing_keep_what_is_smooth() {
        let data = (0..40 * 30).map(|k| 0.02 * (k % 40) as f32 + 0.01 * (k / 40) as f32).collect();
        let plane = Plane { width: 40, height: 30, data };
        assert!((read_between(&plane, 12.3, 7.8) - (0.02 * 12.3 + 0.01 * 7.8)).abs() < 1e-5);
        assert_eq!(read_between(&plane, -3.0, -2.0), 0.0);
        let smooth = gaussian(&plane, 1.6);
        assert!((smooth.row(15)[20] - plane.row(15)[20]).abs() < 1e-5);
        let line = gaussian_line(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], 1.0);
        assert!((line[3] - 0.3989).abs() < 1e-3 && (line[2] - line[4]).abs() < 1e-7);
    }
}
