//! Photos as scenes: the first fills the background at −D, the others stand before it as tilted prints, the last at D.

use std::path::{Path, PathBuf};

use image::{ImageReader, Limits};
use lenslet_core::lightfield::colour::decode;
use lenslet_core::progress::Observer;

use super::Error;
use super::camera::Camera;
use super::draw::{hash, turn};
use super::layer::Sheet;
use super::scene::{Frame, Plan, Scene};

/// Photos a scene at most.
const MOST_PHOTOS: usize = 16;

/// A photo in linear light.
struct Photo {
    width: usize,
    height: usize,
    pixels: Vec<[f32; 3]>,
}

impl Photo {
    fn open(path: &Path) -> Result<Photo, Error> {
        let fail = |reason: String| Error::Photo { path: path.to_path_buf(), reason };
        let mut reader = ImageReader::open(path)
            .map_err(|e| fail(e.to_string()))?
            .with_guessed_format()
            .map_err(|e| fail(e.to_string()))?;
        let mut limits = Limits::default();
        limits.max_image_width = Some(20_000);
        limits.max_image_height = Some(20_000);
        limits.max_alloc = Some(1 << 30);
        reader.limits(limits);
        let picture = reader.decode().map_err(|e| fail(e.to_string()))?;
        if u64::from(picture.width()) * u64::from(picture.height()) > 60_000_000 {
            return Err(fail(format!("{}x{} pixels are too many", picture.width(), picture.height())));
        }
        let picture = picture.into_rgb16();
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        if width < 8 || height < 8 {
            return Err(fail(format!("{width}x{height} pixels are too few")));
        }
        let pixels = picture.pixels().map(|p| p.0.map(|v| decode(f32::from(v) / 65535.0))).collect();
        Ok(Photo { width, height, pixels })
    }

    /// Mean colour of the square of `side` pixels about (`x`, `y`), in photo pixels.
    fn mean(&self, x: f64, y: f64, side: f64) -> [f32; 3] {
        let n = side.ceil().clamp(1.0, 16.0) as usize;
        let mut sum = [0f32; 3];
        for j in 0..n {
            for i in 0..n {
                let (dx, dy) = ((i as f64 + 0.5) / n as f64 - 0.5, (j as f64 + 0.5) / n as f64 - 0.5);
                let colour = self.between(x + dx * side, y + dy * side);
                for c in 0..3 {
                    sum[c] += colour[c];
                }
            }
        }
        // Kept below saturation, as an exposure meter would.
        sum.map(|s| 0.95 * s / (n * n) as f32)
    }

    /// Bilinear, borders repeated.
    fn between(&self, x: f64, y: f64) -> [f32; 3] {
        let (x, y) = (x.max(0.0).min((self.width - 1) as f64), y.max(0.0).min((self.height - 1) as f64));
        let (i, j) = ((x as usize).min(self.width - 2), (y as usize).min(self.height - 2));
        let (fx, fy) = ((x - i as f64) as f32, (y - j as f64) as f32);
        let at = |i: usize, j: usize| self.pixels[j * self.width + i];
        let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
        std::array::from_fn(|k| (a[k] * (1.0 - fx) + b[k] * fx) * (1.0 - fy) + (c[k] * (1.0 - fx) + d[k] * fx) * fy)
    }
}

/// A scene made of photos, background first. `disparity` as in [`Scene::named`]; its usual value is 0.3, and 0 for one photo alone.
///
/// # Errors
/// [`Error::Photo`] naming the file that cannot be read, [`Error::Parameter`], [`Error::Interrupted`].
pub fn photos(
    files: &[PathBuf],
    camera: &Camera,
    disparity: Option<f64>,
    seed: u64,
    observer: &dyn Observer,
) -> Result<Scene, Error> {
    if files.is_empty() || files.len() > MOST_PHOTOS {
        return Err(Error::Parameter(format!("a scene takes 1 to {MOST_PHOTOS} photos, not {}", files.len())));
    }
    let disparity = disparity.unwrap_or(if files.len() == 1 { 0.0 } else { 0.3 });
    let frame = Frame::new(camera, disparity, seed)?;
    let photos = files.iter().map(|f| Photo::open(f)).collect::<Result<Vec<_>, _>>()?;
    let half_texel = 0.4 * camera.footprint;
    let [hx, hy] = frame.half;
    let last = photos.len() - 1;
    let mut sheets = Vec::with_capacity(photos.len());
    for (k, photo) in photos.iter().enumerate().rev() {
        let (w, h) = (photo.width as f64, photo.height as f64);
        let own = if last == 0 { disparity } else { disparity * (2.0 * k as f64 / last as f64 - 1.0) };
        if k == 0 {
            // Covers the canvas, cropped where its shape differs.
            let per_pitch = (w / (2.0 * hx)).min(h / (2.0 * hy));
            let paint = move |x: f64, y: f64| {
                let [r, g, b] = photo.mean(
                    0.5 * (w - 1.0) + x * per_pitch,
                    0.5 * (h - 1.0) + y * per_pitch,
                    half_texel * per_pitch,
                );
                [r, g, b, 1.0]
            };
            sheets.push(Sheet { disparity: [own, 0.0, 0.0], bounds: None, paint: Box::new(paint) });
            continue;
        }
        // A print of about two fifths of the canvas, one after the other round the middle.
        let angle = 2.4 * k as f64 + std::f64::consts::TAU * f64::from(hash(k as i32, 0, frame.seed));
        let middle = [0.5 * hx * angle.cos(), 0.5 * hy * angle.sin()];
        let lean = 0.4 * f64::from(hash(k as i32, 1, frame.seed)) - 0.2;
        let per_pitch = w.max(h) / (0.9 * hx.min(hy));
        let (half_w, half_h) = (0.5 * w / per_pitch, 0.5 * h / per_pitch);
        let reach = half_w.hypot(half_h);
        let paint = move |x: f64, y: f64| {
            let (x, y) = turn(x - middle[0], y - middle[1], lean);
            if x.abs() > half_w || y.abs() > half_h {
                return [0.0; 4];
            }
            let [r, g, b] =
                photo.mean(0.5 * (w - 1.0) + x * per_pitch, 0.5 * (h - 1.0) + y * per_pitch, half_texel * per_pitch);
            [r, g, b, 1.0]
        };
        let bounds = [middle[0] - reach, middle[1] - reach, middle[0] + reach, middle[1] + reach];
        sheets.push(Sheet { disparity: [own, 0.0, 0.0], bounds: Some(bounds), paint: Box::new(paint) });
    }
    Scene::new("photos", camera, &frame, &Plan { sheets, regions: Vec::new() }, observer)
}
