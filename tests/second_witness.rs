//! Captures of the second generator (tests/witness/mod.rs) through calibration, decoding and every interpolation: what
//! the simulator and the decoder assume alike would show here.
//!
//! Every threshold is beside the value measured when it was set and what a broken step gives.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it measured

mod witness;

use lenslet_core::calibration::{self, Calibration, CalibrationOptions, CalibrationVariant};
use lenslet_core::container::{self, Capture};
use lenslet_core::decode::{self, HexSamples, ViewStep, WhiteBalance};
use lenslet_core::geometry::Size;
use lenslet_core::metrics::{Scores, Window};
use lenslet_core::progress::Silent;
use lenslet_views::multiview::Fit;
use lenslet_views::{Method, RenderSamples as _};
use ndarray::Array3;
use witness::{Camera, Picture};

/// In focus this share of the pupil's distance before the lenslets: 2 pixels a pixel of offset.
const SHARE: f64 = 0.0016;
/// Side of the views: 3.3 pixels a lenslet, as 1080 are of a whole sensor.
const SIDE: usize = 210;

struct Taken {
    camera: Camera,
    picture: Picture,
    white: Capture,
    scene: Capture,
}

/// A white image and a capture, written as pictures of mosaics and read back.
fn taken(camera: Camera) -> Taken {
    let folder = tempfile::tempdir().unwrap();
    let picture = Picture::new(camera.seed);
    let [white, scene] = ["white.png", "scene.png"].map(|name| folder.path().join(name));
    camera.save_white(&white);
    camera.save_scene(&picture, SHARE, &scene);
    let open = |path| container::open_capture(path, Some("lytro-f01")).unwrap();
    let (white, scene) = (open(&white), open(&scene));
    Taken { camera, picture, white, scene }
}

fn calibrated(taken: &Taken, variant: CalibrationVariant) -> Calibration {
    let options = CalibrationOptions { variant, ..CalibrationOptions::default() };
    calibration::calibrate(std::slice::from_ref(&taken.white), &options, &Silent).unwrap()
}

/// The witness's colours are the sensor's own: nothing is done to them.
fn decoded(taken: &Taken, calibration: &Calibration) -> HexSamples {
    let mut options = decode::Options { white_balance: WhiteBalance::Gains([1.0; 3]), ..decode::Options::default() };
    options.steps.view.retain(|s| !matches!(s, ViewStep::ColourMatrix | ViewStep::ExposureBias | ViewStep::Gamut));
    decode::sample_views(&taken.scene, calibration, &options, &Silent).unwrap()
}

/// PSNR of luminance, sRGB-encoded, of the view in row `v`, column `u`.
fn psnr(taken: &Taken, samples: &HexSamples, method: Method, (v, u): (usize, usize)) -> f64 {
    let size = Size { width: SIDE, height: SIDE };
    let view = samples.renderer(method).size(size).prepare().unwrap().view(v, u).unwrap().encode().into_pixels();
    let truth = taken.camera.true_view(&taken.picture, SHARE, [u as f64 - 3.0, v as f64 - 3.0], SIDE);
    let encoded = |x: f64| if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    let truth = Array3::from_shape_fn((SIDE, SIDE, 3), |(t, s, c)| encoded(truth[t * SIDE + s][c]) as f32);
    Scores::between(view.view(), truth.view(), &Window::without_border(12)).unwrap().psnr_y
}

/// RMS distance of the lenslets found from the true middles of their micro-images, and the share of these found.
fn centres(taken: &Taken, found: &Calibration) -> (f64, f64) {
    let side = taken.camera.side as f64;
    let inside = |x: f64, y: f64| [x, y].iter().all(|v| (15.0..side - 15.0).contains(v));
    let truth: Vec<[f64; 2]> = taken.camera.micro_image_middles().into_iter().filter(|c| inside(c[0], c[1])).collect();
    let mut squares = Vec::new();
    for c in &truth {
        let near = found.lenslets.iter().map(|l| (l.x - c[0]).powi(2) + (l.y - c[1]).powi(2)).fold(f64::MAX, f64::min);
        if near < 4.0 {
            squares.push(near);
        }
    }
    ((squares.iter().sum::<f64>() / squares.len() as f64).sqrt(), squares.len() as f64 / truth.len() as f64)
}

/// This camera's lenslets see points.
fn points() -> Method {
    Method::multiview().fitted_by(Fit::LeastSquares)
}

#[test]
fn a_second_witness_agrees() {
    let taken = taken(Camera::default());
    let full = calibrated(&taken, CalibrationVariant::Full);
    let (rms, share) = centres(&taken, &full);
    println!("centres {rms:.4} px RMS, {share:.4} found");
    // Measured 0.0110; the lattice without the lenslets' own displacements is at 0.07.
    assert!(rms < 0.02 && share > 0.999, "{rms} {share}");

    let samples = decoded(&taken, &full);
    let middle = |samples: &HexSamples, method| psnr(&taken, samples, method, (3, 3));
    let [bicubic, barycentric, cubic, multiview] =
        [Method::bicubic(), Method::barycentric(), Method::cubic(), points()].map(|m| middle(&samples, m));
    println!("bicubic {bicubic:.2}, barycentric {barycentric:.2}, cubic {cubic:.2}, multiview {multiview:.2} dB");
    // Measured 31.30, 33.20, 36.33, 48.49. Centres at whole pixels give 34.69 by cubic and 39.40 by multiview.
    assert!(barycentric > 32.8 && cubic > 35.8 && multiview > 46.5, "{barycentric} {cubic} {multiview}");
    assert!(barycentric > bicubic + 1.2 && cubic > barycentric + 2.0 && multiview > cubic + 9.0);

    // Another view, where a wrong sign or a wrong pupil would show: measured 33.24 and 47.86.
    let outer = psnr(&taken, &samples, points(), (1, 5));
    let outer_alone = psnr(&taken, &samples, Method::barycentric(), (1, 5));
    println!("view (1, 5): barycentric {outer_alone:.2}, multiview {outer:.2} dB");
    assert!(outer_alone > 32.8 && outer > 46.0, "{outer_alone} {outer}");

    // The thresholds notice a calibration without sub-pixel precision.
    let whole = decoded(&taken, &calibrated(&taken, CalibrationVariant::Integer));
    let [cubic, multiview] = [Method::cubic(), points()].map(|m| middle(&whole, m));
    println!("whole pixels: cubic {cubic:.2}, multiview {multiview:.2} dB");
    assert!(cubic < 35.8 && multiview < 46.5, "{cubic} {multiview}");
}
