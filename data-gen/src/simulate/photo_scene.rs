//! Photos as scenes: the first fills the background at −D, the others stand before it as tilted prints, the last at D.

use std::path::{Path, PathBuf};

use lenslet_core::colour::srgb_decode;
use lenslet_core::image::bilinear_by_weights;
use lenslet_core::progress::Observer;

use super::camera::Camera;
use super::description::{Canvas, LayerSource, SceneDescription};
use super::draw::{hash_unit, rotate};
use super::error::Error;
use super::scene::Scene;
use super::texels::TEXEL;
use crate::photo::decode_photo;

/// Photos a scene at most.
const MOST_PHOTOS: usize = 16;

/// Pixels of a photo at most; those of all photos of a scene are in memory at once, 12 bytes each.
/// Source: chosen.
const MOST_PIXELS: usize = 60_000_000;

/// Shortest side of a photo, pixels.
const LEAST_SIDE: usize = 8;

/// Largest disparity of a scene of several photos by default, pitches per sensor pixel.
/// Source: chosen.
const DEFAULT_DISPARITY: f64 = 0.3;

/// A photo in linear light.
struct LinearPhoto {
    width: usize,
    height: usize,
    pixels: Vec<[f32; 3]>,
}

impl LinearPhoto {
    fn open(path: &Path) -> Result<LinearPhoto, Error> {
        let picture = decode_photo(path, LEAST_SIDE, MOST_PIXELS)?.picture.into_rgb16();
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let pixels = picture.pixels().map(|p| p.0.map(|v| srgb_decode(f32::from(v) / 65535.0))).collect();
        Ok(LinearPhoto { width, height, pixels })
    }

    /// Mean colour of the square of `side` pixels about (`x`, `y`), in photo pixels.
    fn mean_over_square(&self, x: f64, y: f64, side: f64) -> [f32; 3] {
        let n = side.ceil().clamp(1.0, 16.0) as usize;
        let mut sum = [0f32; 3];
        for j in 0..n {
            for i in 0..n {
                let (dx, dy) = ((i as f64 + 0.5) / n as f64 - 0.5, (j as f64 + 0.5) / n as f64 - 0.5);
                let colour = self.bilinear_at(x + dx * side, y + dy * side);
                for c in 0..3 {
                    sum[c] += colour[c];
                }
            }
        }
        // Kept below saturation, as an exposure meter would.
        sum.map(|s| 0.95 * s / (n * n) as f32)
    }

    /// Bilinear, borders repeated.
    fn bilinear_at(&self, x: f64, y: f64) -> [f32; 3] {
        let (x, y) = (x.max(0.0).min((self.width - 1) as f64), y.max(0.0).min((self.height - 1) as f64));
        let (i, j) = ((x as usize).min(self.width - 2), (y as usize).min(self.height - 2));
        let (fx, fy) = ((x - i as f64) as f32, (y - j as f64) as f32);
        let at = |i: usize, j: usize| self.pixels[j * self.width + i];
        let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
        std::array::from_fn(|k| bilinear_by_weights([a[k], b[k], c[k], d[k]], fx, fy))
    }
}

/// A scene made of photos, background first. `disparity` is the largest one, in lenslet pitches per sensor pixel of
/// offset (−1..=1; `None`: 0.3, and 0 for one photo alone).
///
/// # Errors
/// [`Error::Photo`] naming the file that cannot be used, [`Error::Parameter`], [`Error::Interrupted`].
pub fn photo_scene(
    files: &[PathBuf],
    camera: &Camera,
    disparity: Option<f64>,
    seed: u64,
    observer: &dyn Observer,
) -> Result<Scene, Error> {
    if files.is_empty() || files.len() > MOST_PHOTOS {
        return Err(Error::Parameter(format!("a scene takes 1 to {MOST_PHOTOS} photos, not {}", files.len())));
    }
    let disparity = disparity.unwrap_or(if files.len() == 1 { 0.0 } else { DEFAULT_DISPARITY });
    let canvas = Canvas::new(camera, disparity, seed)?;
    let photos = files.iter().map(|f| LinearPhoto::open(f)).collect::<Result<Vec<_>, _>>()?;
    let half_texel = 0.5 * TEXEL * camera.optics.footprint;
    let [hx, hy] = canvas.half;
    let last = photos.len() - 1;
    let mut layers = Vec::with_capacity(photos.len());
    for (k, photo) in photos.iter().enumerate().rev() {
        let (w, h) = (photo.width as f64, photo.height as f64);
        let own = if last == 0 { disparity } else { disparity * (2.0 * k as f64 / last as f64 - 1.0) };
        if k == 0 {
            // Covers the canvas, cropped where its shape differs.
            let per_pitch = (w / (2.0 * hx)).min(h / (2.0 * hy));
            let paint = move |x: f64, y: f64| {
                let [r, g, b] = photo.mean_over_square(
                    0.5 * (w - 1.0) + x * per_pitch,
                    0.5 * (h - 1.0) + y * per_pitch,
                    half_texel * per_pitch,
                );
                [r, g, b, 1.0]
            };
            layers.push(LayerSource { disparity: [own, 0.0, 0.0], bounds: None, paint: Box::new(paint) });
            continue;
        }
        // A print of about two fifths of the canvas, one after the other round the middle.
        let angle = 2.4 * k as f64 + std::f64::consts::TAU * f64::from(hash_unit(k as i32, 0, canvas.seed));
        let middle = [0.5 * hx * angle.cos(), 0.5 * hy * angle.sin()];
        let lean = 0.4 * f64::from(hash_unit(k as i32, 1, canvas.seed)) - 0.2;
        let per_pitch = w.max(h) / (0.9 * hx.min(hy));
        let (half_w, half_h) = (0.5 * w / per_pitch, 0.5 * h / per_pitch);
        let reach = half_w.hypot(half_h);
        let paint = move |x: f64, y: f64| {
            let (x, y) = rotate(x - middle[0], y - middle[1], lean);
            if x.abs() > half_w || y.abs() > half_h {
                return [0.0; 4];
            }
            let [r, g, b] = photo.mean_over_square(
                0.5 * (w - 1.0) + x * per_pitch,
                0.5 * (h - 1.0) + y * per_pitch,
                half_texel * per_pitch,
            );
            [r, g, b, 1.0]
        };
        let bounds = [middle[0] - reach, middle[1] - reach, middle[0] + reach, middle[1] + reach];
        layers.push(LayerSource { disparity: [own, 0.0, 0.0], bounds: Some(bounds), paint: Box::new(paint) });
    }
    Scene::from_description("photos", camera, &canvas, &SceneDescription { layers, regions: Vec::new() }, observer)
}
