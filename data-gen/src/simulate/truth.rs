//! The truth: views of the scene through an ideal camera, and the disparity of the central one.

use lenslet_core::geometry::Size;
use ndarray::{Array2, Array3};
use rayon::prelude::*;

use super::camera::Camera;
use super::scene::Scene;

/// The size of views whose longer side is `size`, square scene pixels.
pub fn output_size(camera: &Camera, size: usize) -> Size {
    let (w, h) = (camera.sensor.width as f64, camera.sensor.height as f64);
    let scale = size as f64 / w.max(h);
    Size::new(((w * scale).round() as usize).max(1), ((h * scale).round() as usize).max(1))
}

/// Offset (x, y) in sensor pixels of the view in row and column `[v, u]` (counted from 0) of `n`×`n`.
pub fn view_offset(view: [usize; 2], n: usize, view_step: f64) -> [f64; 2] {
    let middle = (n / 2) as f64;
    [(view[1] as f64 - middle) * view_step, (view[0] as f64 - middle) * view_step]
}

/// The scene under offset `delta` (sensor pixels), shape (t, s, 3), linear light: output pixel (s, t) is the mean over
/// its area, centred on the sensor position (s + 0.5)·W/W_out − 0.5. Under a pupil shift the position is that of the
/// micro-images' centres of light, which is what white images show of the lenslets.
///
/// The mean over a square is 2/3 of its middle and 1/12 of each corner: exact for polynomials up to the third degree,
/// and corners serve four squares. A pixel is cut into squares of at most 0.4 pitches, over which the low-passed scene
/// is smooth.
pub fn true_view(scene: &Scene, camera: &Camera, delta: [f64; 2], size: Size) -> Array3<f32> {
    let Size { width: w, height: h } = size;
    let step = [camera.sensor.width as f64 / w as f64, camera.sensor.height as f64 / h as f64];
    let m = (step[0].max(step[1]) / (0.4 * camera.lenslets.pitch)).ceil().clamp(1.0, 64.0) as usize;
    let cell = [step[0] / m as f64, step[1] / m as f64];
    let share = 1.0 / (m * m) as f32;
    let lens = lens_position(camera);
    // One line of squares' middles, or of their corners, at sensor row y.
    let line = |to: &mut [[f32; 3]], y: f64, start: f64| {
        for (k, to) in to.iter_mut().enumerate() {
            let [x, y] = lens([(k as f64 + start) * cell[0] - 0.5, y]);
            *to = scene.sample(x, y, delta);
        }
    };
    let mut values = vec![0f32; w * h * 3];
    values.par_chunks_mut(3 * w * BAND).enumerate().for_each(|(band, rows)| {
        let (mut above, mut below, mut middle) =
            (vec![[0f32; 3]; m * w + 1], vec![[0f32; 3]; m * w + 1], vec![[0f32; 3]; m * w]);
        let first = band * BAND * m;
        line(&mut above, first as f64 * cell[1] - 0.5, 0.0);
        for (t, row) in rows.chunks_mut(3 * w).enumerate() {
            for j in 0..m {
                let y = (first + t * m + j) as f64;
                line(&mut middle, (y + 0.5) * cell[1] - 0.5, 0.5);
                line(&mut below, (y + 1.0) * cell[1] - 0.5, 0.0);
                for (s, pixel) in row.chunks_exact_mut(3).enumerate() {
                    for k in s * m..(s + 1) * m {
                        for c in 0..3 {
                            let corners = above[k][c] + above[k + 1][c] + below[k][c] + below[k + 1][c];
                            pixel[c] += share * (middle[k][c] * (2.0 / 3.0) + corners / 12.0);
                        }
                    }
                }
                std::mem::swap(&mut above, &mut below);
            }
        }
    });
    Array3::from_shape_vec((h, w, 3), values).unwrap_or_else(|_| Array3::zeros((h, w, 3)))
}

/// From the centre of light of a micro-image to that of its lenslet, where the scene is seen.
fn lens_position(camera: &Camera) -> impl Fn([f64; 2]) -> [f64; 2] + Sync {
    let (scale, middle) = (camera.pupil_scale(camera.imperfections.pupil_shift), camera.middle());
    move |p| {
        if scale == 1.0 { p } else { std::array::from_fn(|axis| middle[axis] + (p[axis] - middle[axis]) / scale) }
    }
}

/// Output rows rendered in one go; the line of corners between two bands is sampled twice.
const BAND: usize = 16;

/// Disparity of the central view, shape (t, s), output pixels per view step.
pub fn true_disparity(scene: &Scene, camera: &Camera, view_step: f64, size: Size) -> Array2<f32> {
    let Size { width: w, height: h } = size;
    let step = [camera.sensor.width as f64 / w as f64, camera.sensor.height as f64 / h as f64];
    let lens = lens_position(camera);
    let scale = camera.pupil_scale(camera.imperfections.pupil_shift);
    let mut values = vec![0f32; w * h];
    values.par_chunks_mut(w).enumerate().for_each(|(t, line)| {
        for (s, value) in line.iter_mut().enumerate() {
            let [x, y] = lens([(s as f64 + 0.5) * step[0] - 0.5, (t as f64 + 0.5) * step[1] - 0.5]);
            *value = (scene.disparity(x, y, [0.0; 2]) * scale * view_step / step[0]) as f32;
        }
    });
    Array2::from_shape_vec((h, w), values).unwrap_or_else(|_| Array2::zeros((h, w)))
}

#[cfg(test)]
mod tests {
    use lenslet_core::progress::Silent;

    use super::*;
    use crate::simulate::SceneName;

    #[test]
    fn a_view_is_the_mean_over_its_pixels() {
        let camera = Camera { sensor: Size::new(240, 200), ..Camera::default() };
        let scene = Scene::named(SceneName::Planes, &camera, Some(0.3), 2, &Silent).unwrap();
        for (size, delta) in [(79, [0.0, 0.0]), (79, [-3.0, 2.0]), (24, [1.0, 1.0])] {
            let size = output_size(&camera, size);
            let fast = true_view(&scene, &camera, delta, size);
            let (sx, sy) = (240.0 / size.width as f64, 200.0 / size.height as f64);
            let mut worst = 0f32;
            for t in (0..size.height).step_by(5) {
                for s in (0..size.width).step_by(3) {
                    let mut plain = [0f64; 3];
                    for k in 0..400 {
                        let (i, j) = (f64::from(k % 20) + 0.5, f64::from(k / 20) + 0.5);
                        let seen =
                            scene.sample((s as f64 + i / 20.0) * sx - 0.5, (t as f64 + j / 20.0) * sy - 0.5, delta);
                        (0..3).for_each(|c| plain[c] += f64::from(seen[c]) / 400.0);
                    }
                    (0..3).for_each(|c| worst = worst.max((fast[[t, s, c]] - plain[c] as f32).abs()));
                }
            }
            assert!(worst < 0.004, "{size:?}: {worst}");
        }
    }

    #[test]
    fn views_shift_by_the_disparity() {
        // A plane at one disparity: view u at s + D·u shows what the central view shows at s. D is made a whole number.
        let camera = Camera { sensor: Size::new(400, 400), ..Camera::default() };
        let size = Size::new(200, 200);
        let scene = Scene::named(SceneName::Flat, &camera, Some(2.0 / camera.lenslets.pitch), 2, &Silent).unwrap();
        let map = true_disparity(&scene, &camera, 1.0, size);
        assert!(map.iter().all(|d| (d - 1.0).abs() < 1e-5));
        let centre = true_view(&scene, &camera, view_offset([3, 3], 7, 1.0), size);
        let moved = true_view(&scene, &camera, view_offset([1, 6], 7, 1.0), size);
        for t in 10..190 {
            for s in 10..190 {
                assert!((centre[[t, s, 1]] - moved[[t - 2, s + 3, 1]]).abs() < 1e-4);
            }
        }
    }
}
