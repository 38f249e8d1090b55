//! Light fields that other programs made, for the cases of several kinds.

use std::path::Path;
use std::process::Command;

use ndarray::{Array3, Array5, s};

use super::bench::Answer;

/// Three surfaces, the middle one's disparity `d` pixels a view step, seen by `n`×`n` views of `side` pixels.
pub fn scene(n: usize, side: usize, disparities: [f32; 3]) -> Array5<u8> {
    let mut data = Array5::zeros((n, n, side, side, 3));
    let half = (n / 2) as f32;
    let spots = [(0.5, 0.5, 9.9, 1.0), (0.31, 0.62, 0.2, 2.0), (0.68, 0.36, 0.16, 3.0)];
    for ((v, u, t, x, c), value) in data.indexed_iter_mut() {
        for (&d, &(cx, cy, radius, seed)) in disparities.iter().zip(&spots) {
            let (px, py) = (x as f32 - d * (u as f32 - half), t as f32 - d * (v as f32 - half));
            let side = side as f32;
            if (px - cx * side).hypot(py - cy * side) < radius * side {
                let k = c as f32;
                let wave = (px / (3.0 + k) + seed * k).sin() * (py / (4.0 - k) + seed).cos();
                *value = ((0.5 + 0.45 * wave) * 255.0) as u8;
            }
        }
    }
    data
}

/// Saves one view as a picture.
pub fn save_view(data: &Array5<u8>, v: usize, u: usize, path: &Path) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let view: Array3<u8> = data.slice(s![v, u, .., .., ..]).to_owned();
    let (h, w, _) = view.dim();
    image::RgbImage::from_raw(w as u32, h as u32, view.into_raw_vec_and_offset().0).unwrap().save(path).unwrap();
}

/// Runs the program with its notes.
pub fn aloud(folder: &Path, line: &str) -> Answer {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenslet"));
    command.args(line.split_whitespace()).current_dir(folder).output().unwrap().into()
}

/// Runs the program; the JSON object it prints.
pub fn told(folder: &Path, line: &str) -> serde_json::Value {
    let answer = aloud(folder, &format!("{line} --json"));
    assert_eq!(answer.code, Some(0), "{line}: {}", answer.err);
    serde_json::from_str(&answer.out).unwrap()
}

/// A light field that the program wrote as .npy.
pub fn read_npy(path: &Path) -> Array5<f32> {
    ndarray_npy::read_npy(path).unwrap()
}

/// PSNR of the middle views, dB, of values 0..1.
pub fn psnr_of_middle(a: &Array5<f32>, b: &Array5<f32>) -> f64 {
    let (rows, columns, ..) = a.dim();
    let at = s![rows / 2, columns / 2, .., .., ..];
    let off = &a.slice(at) - &b.slice(at);
    let mse = off.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>() / off.len() as f64;
    -10.0 * mse.max(1e-12).log10()
}
