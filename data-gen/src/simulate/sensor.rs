//! What the sensor records: the white pattern, the scene through it, mosaic, noise, digital numbers.
//!
//! - white(p) = field(p) · (light ⊛ pixel ⊛ optical blur)(p), scaled so that a lenslet centre in the middle of the
//!   field is 1.
//! - scene(p) = the scene's colour averaged over the pixel's and the blur's extent (a 3×3 Gauss–Hermite rule), each
//!   position seen by its nearest lenslet at c under offset p − c and weighted with its light.
//! - Recorded is black + (white − black)·white(p)·response(colour filter)·scene(p), plus normal noise of variance
//!   K²·signal + 9K² (DN).

use lenslet_core::container::RawMosaic;
use lenslet_core::geometry::Size;
use lenslet_core::progress::Observer;
use lenslet_core::random::standard_normal_pair;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rayon::prelude::*;

use super::camera::Camera;
use super::error::Error;
use super::lenslets::Lenslets;
use super::micro_images::MicroImages;
use super::scene::Scene;

/// The light on every pixel of a white image, 1 at the brightest lenslet centres; row-major. That of a capture of an
/// even white scene is the same unless the white images are of another zoom.
pub fn white_pattern(camera: &Camera, lenslets: &Lenslets) -> Vec<f32> {
    light_pattern(&MicroImages::of_white(camera, lenslets))
}

/// The light on every pixel behind the micro-images under an even white scene, 1 at the brightest lenslet centres;
/// row-major.
///
/// Lenslets that differ in their blur: the patterns of `SPOT_LEVELS` blurs, each pixel taken between the two that
/// are next to its lenslet's.
pub fn light_pattern(images: &MicroImages) -> Vec<f32> {
    let camera = images.camera();
    if camera.imperfections.focal_spot == 0.0 {
        return blurred_light(images, camera.optics.psf);
    }
    let levels = SPOT_LEVELS.map(|level| blurred_light(images, level * camera.optics.psf));
    let w = camera.sensor.width;
    let mut pattern = vec![0f32; levels[0].len()];
    pattern.par_chunks_mut(w).enumerate().for_each(|(y, line)| {
        for (x, value) in line.iter_mut().enumerate() {
            let spot = images.seen_from(x as f64, y as f64).spot;
            let above = SPOT_LEVELS.iter().position(|l| spot <= *l).unwrap_or(SPOT_LEVELS.len() - 1).max(1);
            let [low, high] = [above - 1, above].map(|k| SPOT_LEVELS[k]);
            let part = ((spot - low) / (high - low)) as f32;
            let [a, b] = [above - 1, above].map(|k| levels[k][y * w + x]);
            *value = a + part * (b - a);
        }
    });
    pattern
}

/// Blurs, as shares of the camera's, between which a lenslet's own is interpolated.
/// Source: chosen.
const SPOT_LEVELS: [f64; 5] = [0.5, 0.75, 1.0, 1.25, 1.5];

/// Mean of `light` over a pixel's own extent: 3×3 positions.
fn over_pixel(x: f64, y: f64, light: &dyn Fn(f64, f64) -> f64) -> f64 {
    let mut sum = 0.0;
    for dy in [-1.0, 0.0, 1.0] {
        for dx in [-1.0, 0.0, 1.0] {
            sum += light(x + dx / 3.0, y + dy / 3.0);
        }
    }
    sum / 9.0
}

/// What full light is: that of one lenslet alone with its centre on a pixel, under the camera's own blur.
fn full_light(camera: &Camera) -> f64 {
    let reach = (4.0 * camera.optics.psf).ceil() as usize;
    let kernel = gaussian(camera.optics.psf, reach);
    let mut full = 0.0;
    for (j, wy) in kernel.iter().enumerate() {
        for (i, wx) in kernel.iter().enumerate() {
            let (x, y) = (i as f64 - reach as f64, j as f64 - reach as f64);
            full += f64::from(*wx) * f64::from(*wy) * over_pixel(x, y, &|x, y| camera.light_at(x * x + y * y));
        }
    }
    full
}

/// The pattern under an optical blur of `sigma` pixels.
fn blurred_light(images: &MicroImages, sigma: f64) -> Vec<f32> {
    let camera = images.camera();
    let Size { width: w, height: h } = camera.sensor;
    let reach = (4.0 * sigma).ceil() as usize;
    let kernel = gaussian(sigma, reach);
    let scale = (1.0 / full_light(camera).max(1e-6)) as f32;
    // Rows with a rim above and below, already blurred along x.
    let mut across = vec![0f32; w * (h + 2 * reach)];
    across.par_chunks_mut(w).enumerate().for_each(|(r, line)| {
        let y = r as f64 - reach as f64;
        let wide: Vec<f32> = (0..w + 2 * reach)
            .map(|c| over_pixel(c as f64 - reach as f64, y, &|x, y| images.seen_from(x, y).light) as f32)
            .collect();
        for (c, value) in line.iter_mut().enumerate() {
            *value = kernel.iter().zip(&wide[c..]).map(|(k, v)| k * v).sum();
        }
    });
    let mut pattern = vec![0f32; w * h];
    pattern.par_chunks_mut(w).enumerate().for_each(|(y, line)| {
        for (k, weight) in kernel.iter().enumerate() {
            for (to, from) in line.iter_mut().zip(&across[(y + k) * w..]) {
                *to += weight * from;
            }
        }
        for (x, value) in line.iter_mut().enumerate() {
            *value *= scale * camera.vignetting_at(x as f64, y as f64) as f32;
        }
    });
    pattern
}

fn gaussian(sigma: f64, reach: usize) -> Vec<f32> {
    if reach == 0 {
        return vec![1.0];
    }
    let kernel: Vec<f64> =
        (0..=2 * reach).map(|k| (-(k as f64 - reach as f64).powi(2) / (2.0 * sigma * sigma)).exp()).collect();
    let total: f64 = kernel.iter().sum();
    kernel.into_iter().map(|k| (k / total) as f32).collect()
}

/// Share of full scale behind every pixel of a capture of `scene`, mosaic and all, before noise; row-major.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn expose_scene(
    images: &MicroImages,
    scene: &Scene,
    pattern: &[f32],
    observer: &dyn Observer,
) -> Result<Vec<f32>, Error> {
    let camera = images.camera();
    let Size { width: w, height: h } = camera.sensor;
    let responses = camera.response.filter_responses();
    // Three-point Gauss–Hermite rule of the pixel's and the blur's variance together.
    let rule = |psf: f64| {
        let reach = (3.0 * (1.0 / 12.0 + psf * psf)).sqrt();
        [(-reach, 1.0 / 6.0), (0.0, 2.0 / 3.0), (reach, 1.0 / 6.0)]
    };
    let (usual, varied) = (rule(camera.optics.psf), camera.imperfections.focal_spot > 0.0);
    let mut signal = pattern.to_vec();
    observer.begin("capture", h as u64);
    signal.par_chunks_mut(w).enumerate().for_each(|(y, line)| {
        if observer.cancelled() {
            return;
        }
        for (x, value) in line.iter_mut().enumerate() {
            let (mut sum, mut total) = ([0f32; 3], 0f32);
            let rule = if varied { rule(camera.optics.psf * images.seen_from(x as f64, y as f64).spot) } else { usual };
            for (dy, wy) in rule {
                for (dx, wx) in rule {
                    let (px, py) = (x as f64 + dx, y as f64 + dy);
                    let seen = images.seen_from(px, py);
                    let weight = (wx * wy * seen.light) as f32;
                    let colour = scene.sample(seen.lenslet[0], seen.lenslet[1], seen.offset);
                    for k in 0..3 {
                        sum[k] += weight * colour[k];
                    }
                    total += weight;
                }
            }
            let response = responses[camera.response.cfa.plane(x, y)];
            let seen = (response[0] * sum[0] + response[1] * sum[1] + response[2] * sum[2]) / total.max(1e-6);
            *value *= seen;
        }
        observer.advance(1);
    });
    observer.check()?;
    Ok(signal)
}

/// Share of full scale behind every pixel of a white image.
pub fn expose_white(camera: &Camera, pattern: &[f32]) -> Vec<f32> {
    let w = camera.sensor.width;
    let mut signal = pattern.to_vec();
    signal.par_chunks_mut(w).enumerate().for_each(|(y, line)| {
        for (x, value) in line.iter_mut().enumerate() {
            *value *= camera.response.white_response[camera.response.cfa.colour(x, y)] as f32;
        }
    });
    signal
}

/// Shares of full scale → digital numbers, with noise of strength `noise` (0: none; 1: one electron a DN and 3 DN of
/// read noise of a sensor that saturates at 4095 DN, less in proportion for others). The noise depends on `seed`,
/// `frame` and the row only, not on threads.
pub fn record_mosaic(signal: &[f32], camera: &Camera, noise: f64, seed: u64, frame: u32) -> RawMosaic {
    let Size { width: w, height: h } = camera.sensor;
    let [black, white] = camera.response.levels.map(f64::from);
    // One of the 4095 steps of a 12-bit sensor, in digital numbers of this one.
    let unit = (white - black) / (4095.0 - 168.0);
    let mut data = vec![0u16; w * h];
    data.par_chunks_mut(w).zip(signal.par_chunks(w)).enumerate().for_each(|(y, (line, signal))| {
        let mut generator = ChaCha8Rng::seed_from_u64(seed ^ 0x6e6f_6973_6521);
        generator.set_stream((u64::from(frame) << 32) | y as u64);
        for (to, from) in line.chunks_mut(2).zip(signal.chunks(2)) {
            let pair = if noise > 0.0 { standard_normal_pair(&mut generator) } else { [0.0; 2] };
            for ((to, from), n) in to.iter_mut().zip(from).zip(pair) {
                let light = f64::from(*from) * (white - black);
                let spread = noise * unit * (light.max(0.0) / unit + 9.0).sqrt();
                *to = (black + light + spread * n).round().clamp(0.0, white) as u16;
            }
        }
    });
    RawMosaic { width: w, height: h, data }
}

#[cfg(test)]
mod tests {
    use lenslet_core::progress::Silent;

    use super::*;
    use crate::simulate::{Imperfections, LensletGrid, SceneName, SensorResponse};

    fn camera() -> Camera {
        let lenslets = LensletGrid { rotation: 0.03, jitter: 0.2, ..LensletGrid::default() };
        Camera { sensor: Size::new(160, 120), lenslets, ..Camera::default() }
    }

    /// Mean of `of` over a pixel and its optical blur, by brute force.
    fn plain(camera: &Camera, x: f64, y: f64, of: &mut dyn FnMut(f64, f64, f64)) {
        let n = 41;
        for j in 0..n {
            for i in 0..n {
                let place = |k: i32| 4.0 * camera.optics.psf.max(0.01) * (f64::from(k) / 20.0 - 1.0);
                let (bx, by) = (place(i), place(j));
                let weight = (-(bx * bx + by * by) / (2.0 * camera.optics.psf * camera.optics.psf)).exp();
                for k in 0..9 {
                    let (px, py) = (f64::from(k % 3 - 1) / 3.0, f64::from(k / 3 - 1) / 3.0);
                    of(x + bx + px, y + by + py, weight);
                }
            }
        }
    }

    #[test]
    fn the_white_pattern_is_the_blurred_light() {
        let camera = camera();
        let lenslets = Lenslets::new(&camera, 1).unwrap();
        let pattern = white_pattern(&camera, &lenslets);
        let brute = |x: f64, y: f64, light: &dyn Fn(f64, f64) -> f64| {
            let (mut sum, mut total) = (0.0, 0.0);
            plain(&camera, x, y, &mut |x, y, w| {
                sum += w * light(x, y);
                total += w;
            });
            sum / total
        };
        let full = brute(0.0, 0.0, &|x, y| camera.light_at(x * x + y * y));
        for k in 0..60usize {
            let (x, y) = (k * 7 % 160, k * 13 % 120);
            let light = brute(x as f64, y as f64, &|x, y| camera.light_at(lenslets.nearest(x, y).1));
            let expected = light / full * camera.vignetting_at(x as f64, y as f64);
            let got = f64::from(pattern[y * 160 + x]);
            assert!((got - expected).abs() < 0.01, "{x} {y}: {got} {expected}");
        }
        let most = pattern.iter().copied().fold(0f32, f32::max);
        assert!((0.9..1.02).contains(&most), "{most}");
    }

    #[test]
    fn a_pixel_sees_the_scene_through_its_lenslets() {
        let camera = camera();
        let lenslets = Lenslets::new(&camera, 1).unwrap();
        let pattern = white_pattern(&camera, &lenslets);
        let scene = Scene::named(SceneName::Flat, &camera, Some(0.2), 4, &Silent).unwrap();
        let signal = expose_scene(&MicroImages::of_capture(&camera, &lenslets), &scene, &pattern, &Silent).unwrap();
        let responses = camera.response.filter_responses();
        let (mut worst, mut squares) = (0f64, 0.0);
        for k in 0..150usize {
            let (x, y) = (k * 7 % 160, k * 13 % 120);
            let (mut sum, mut total) = ([0f64; 3], 0.0);
            plain(&camera, x as f64, y as f64, &mut |px, py, w| {
                let (c, d2) = lenslets.nearest(px, py);
                let seen = scene.sample(c[0], c[1], [px - c[0], py - c[1]]);
                let w = w * camera.light_at(d2);
                (0..3).for_each(|k| sum[k] += w * f64::from(seen[k]));
                total += w;
            });
            let response = responses[camera.response.cfa.plane(x, y)];
            let expected =
                f64::from(pattern[y * 160 + x]) * (0..3).map(|k| f64::from(response[k]) * sum[k] / total).sum::<f64>();
            let error = (f64::from(signal[y * 160 + x]) - expected).abs();
            worst = worst.max(error);
            squares += error * error;
        }
        let rms = (squares / 150.0).sqrt();
        assert!(rms < 0.004 && worst < 0.03, "{rms} {worst}");
    }

    #[test]
    fn a_lenslet_with_a_wider_spot_has_a_flatter_micro_image() {
        let still = LensletGrid { jitter: 0.0, ..LensletGrid::default() };
        let imperfections = Imperfections { focal_spot: 0.3, ..Imperfections::default() };
        let camera = Camera { sensor: Size::new(240, 240), lenslets: still, imperfections, ..Camera::default() };
        let ideal = Camera { imperfections: Imperfections::default(), ..camera.clone() };
        let lenslets = Lenslets::new(&camera, 1).unwrap();
        let (varied, plain) = (white_pattern(&camera, &lenslets), white_pattern(&ideal, &lenslets));
        // At the centre of a lenslet whose blur is over the usual there is less light than usual, else more.
        let mut agree = 0;
        let mut all = 0;
        for c in lenslets.centres_on_sensor().into_iter().filter(|c| c.iter().all(|v| (10.0..230.0).contains(v))) {
            let spot = lenslets.nearest_with_spot(c[0], c[1]).2;
            let k = c[1].round() as usize * 240 + c[0].round() as usize;
            if (spot - 1.0).abs() > 0.05 {
                all += 1;
                agree += i32::from((varied[k] < plain[k]) == (spot > 1.0));
            }
        }
        assert!(all > 300 && agree == all, "{agree} of {all}");
        // A scene is blurred over the offsets by the same spot: one of a single colour comes out unchanged.
        let scene = Scene::named(SceneName::White, &camera, None, 1, &Silent).unwrap();
        let signal = expose_scene(&MicroImages::of_capture(&camera, &lenslets), &scene, &varied, &Silent).unwrap();
        let response = camera.response.filter_responses();
        for k in (0..signal.len()).step_by(101) {
            let own = response[camera.response.cfa.plane(k % 240, k / 240)];
            let expected = varied[k] * own.iter().sum::<f32>() * crate::simulate::WHITE;
            assert!((signal[k] - expected).abs() < 1e-4, "{} {expected}", signal[k]);
        }
    }

    #[test]
    fn noise_has_the_strength_asked_for_and_black_and_white_hold() {
        let camera = Camera { sensor: Size::new(200, 200), ..Camera::default() };
        let signal = vec![0.25f32; 200 * 200];
        let still = record_mosaic(&signal, &camera, 0.0, 1, 0);
        assert!(still.data.iter().all(|v| *v == (168.0f32 + 0.25 * 3927.0).round() as u16));
        let noisy = record_mosaic(&signal, &camera, 0.7, 1, 0);
        let n = noisy.data.len() as f64;
        let mean = noisy.data.iter().map(|v| f64::from(*v)).sum::<f64>() / n;
        let deviation = (noisy.data.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / n).sqrt();
        let expected = 0.7 * (0.25f64 * 3927.0 + 9.0).sqrt();
        assert!((mean - 1149.75).abs() < 0.5 && (deviation / expected - 1.0).abs() < 0.03, "{mean} {deviation}");
        assert_eq!(noisy, record_mosaic(&signal, &camera, 0.7, 1, 0));
        assert_ne!(noisy, record_mosaic(&signal, &camera, 0.7, 1, 1));
        let tiny = |levels| {
            let response = SensorResponse { levels, ..SensorResponse::default() };
            Camera { sensor: Size::new(2, 2), response, ..Camera::default() }
        };
        assert!(record_mosaic(&[2.0; 4], &tiny([168, 4095]), 0.0, 1, 0).data.iter().all(|v| *v == 4095));
        assert!(record_mosaic(&[2.0; 4], &tiny([64, 1023]), 0.0, 1, 0).data.iter().all(|v| *v == 1023));
        assert!(record_mosaic(&[0.0; 4], &tiny([64, 1023]), 0.0, 1, 0).data.iter().all(|v| *v == 64));
        assert!(record_mosaic(&[-2.0; 4], &tiny([168, 4095]), 0.0, 1, 0).data.iter().all(|v| *v == 0));
    }
}
