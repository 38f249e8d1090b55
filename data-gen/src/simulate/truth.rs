//! The truth: views of the scene through an ideal camera, and the disparity of the central one.

use ndarray::{Array2, Array3};
use rayon::prelude::*;

use super::camera::Camera;
use super::scene::Scene;

/// (width, height) of views whose longer side is `size`, square scene pixels.
pub fn output_size(camera: &Camera, size: usize) -> (usize, usize) {
    let (w, h) = (camera.sensor.0 as f64, camera.sensor.1 as f64);
    let scale = size as f64 / w.max(h);
    (((w * scale).round() as usize).max(1), ((h * scale).round() as usize).max(1))
}

/// Offset (x, y) in sensor pixels of the view in row and column `[v, u]` (counted from 0) of `n`×`n`.
pub fn offset(view: [usize; 2], n: usize, view_step: f64) -> [f64; 2] {
    let middle = (n / 2) as f64;
    [(view[1] as f64 - middle) * view_step, (view[0] as f64 - middle) * view_step]
}

/// The scene under offset `delta` (sensor pixels), shape (t, s, 3), linear light: output pixel (s, t) is the mean over
/// its area, centred on the sensor position (s + 0.5)·W/W_out − 0.5.
pub fn view(scene: &Scene, camera: &Camera, delta: [f64; 2], size: (usize, usize)) -> Array3<f32> {
    let (w, h) = size;
    let step = [camera.sensor.0 as f64 / w as f64, camera.sensor.1 as f64 / h as f64];
    // Positions a quarter of the low-pass's width apart integrate it exactly enough: two a side at the F01's 1080 pixels.
    let n = (step[0].max(step[1]) / (0.2 * camera.pitch)).ceil().clamp(1.0, 64.0) as usize;
    let share = 1.0 / (n * n) as f32;
    let mut values = vec![0f32; w * h * 3];
    values.par_chunks_mut(3 * w).enumerate().for_each(|(t, line)| {
        for (s, pixel) in line.chunks_exact_mut(3).enumerate() {
            for j in 0..n {
                let y = (t as f64 + (j as f64 + 0.5) / n as f64) * step[1] - 0.5;
                for i in 0..n {
                    let x = (s as f64 + (i as f64 + 0.5) / n as f64) * step[0] - 0.5;
                    let colour = scene.sample(x, y, delta);
                    for c in 0..3 {
                        pixel[c] += share * colour[c];
                    }
                }
            }
        }
    });
    Array3::from_shape_vec((h, w, 3), values).unwrap_or_else(|_| Array3::zeros((h, w, 3)))
}

/// Disparity of the central view, shape (t, s), output pixels per view step.
pub fn disparity(scene: &Scene, camera: &Camera, view_step: f64, size: (usize, usize)) -> Array2<f32> {
    let (w, h) = size;
    let step = [camera.sensor.0 as f64 / w as f64, camera.sensor.1 as f64 / h as f64];
    let mut values = vec![0f32; w * h];
    values.par_chunks_mut(w).enumerate().for_each(|(t, line)| {
        for (s, value) in line.iter_mut().enumerate() {
            let (x, y) = ((s as f64 + 0.5) * step[0] - 0.5, (t as f64 + 0.5) * step[1] - 0.5);
            *value = (scene.disparity(x, y, [0.0; 2]) * view_step / step[0]) as f32;
        }
    });
    Array2::from_shape_vec((h, w), values).unwrap_or_else(|_| Array2::zeros((h, w)))
}
