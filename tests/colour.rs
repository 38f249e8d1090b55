//! Colour through the whole chain: simulated captures of known reflectances, calibrated from their white images, decoded.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

mod ciede2000;

use std::path::Path;
use std::process::Command;

use lenslet_core::calibration;
use lenslet_core::container;
use lenslet_core::decode::{self, HexSamples};
use lenslet_core::lightfield::{self, ReadOptions};
use lenslet_core::metrics;
use lenslet_core::progress::Silent;
use lenslet_data_gen::simulate::{self, Camera, Scene, SceneName, SimulationOptions};

use ciede2000::{delta_e_2000, lab};

const SIDE: f64 = 600.0;

/// All 49 views of a scene as the F01's sensor, noise and matrix see it on a small sensor.
fn views(kind: SceneName, noise: f64) -> (Scene, HexSamples) {
    let camera = Camera::with_sensor(SIDE as usize);
    let options = SimulationOptions { seed: 5, noise, ..SimulationOptions::default() };
    let scene = Scene::named(kind, &camera, None, 5, &Silent).unwrap();
    let simulation = simulate::render_capture(&scene, &camera, &options, &Silent).unwrap();
    let found =
        calibration::calibrate(&simulation.whites, &calibration::CalibrationOptions::default(), &Silent).unwrap();
    let samples = decode::sample_views(&simulation.capture, &found, &decode::Options::default(), &Silent).unwrap();
    (scene, samples)
}

/// Mean colour of view `view` over the lenslets within `bounds` (pixels).
fn mean(samples: &HexSamples, view: usize, bounds: [f64; 4]) -> [f64; 3] {
    let [left, top, right, bottom] = bounds;
    let inside = |c: &[f64; 2]| c[0] > left && c[0] < right && c[1] > top && c[1] < bottom;
    let seen: Vec<usize> = (0..samples.centres.len()).filter(|&k| inside(&samples.centres[k])).collect();
    assert!(seen.len() > 10);
    std::array::from_fn(|c| {
        seen.iter().map(|&k| f64::from(samples.values[[view, k, c]])).sum::<f64>() / seen.len() as f64
    })
}

#[test]
fn a_white_scene_is_grey_within_half_a_percent_in_every_view() {
    let (_, samples) = views(SceneName::White, 0.7);
    let mut worst = 0f64;
    for view in 0..49 {
        let rgb = mean(&samples, view, [20.0, 20.0, SIDE - 20.0, SIDE - 20.0]);
        for v in rgb {
            worst = worst.max((v / f64::from(simulate::WHITE) - 1.0).abs());
        }
        for v in rgb {
            assert!((v / rgb[1] - 1.0).abs() < 0.005, "view {view}: {rgb:?}");
        }
    }
    println!("white: the worst channel of the worst view is off by {:.2} %", 100.0 * worst);
    assert!(worst < 0.01, "{worst}");
}

#[test]
fn a_colour_chart_comes_back_within_a_known_difference() {
    let (scene, samples) = views(SceneName::Colour, 0.7);
    let (mut worst, mut sum, mut count) = (0f64, 0.0, 0);
    let mut of_patch = Vec::new();
    for region in scene.regions.iter().filter(|r| r.kind == "patch") {
        let truth = region.colour.unwrap().map(f64::from);
        let [l, t, r, b] = region.bounds.map(|v| v * SIDE);
        let mut most = 0f64;
        for view in 0..49 {
            let got = mean(&samples, view, [l + 15.0, t + 15.0, r - 15.0, b - 15.0]);
            let difference = delta_e_2000(lab(got), lab(truth));
            (worst, sum, count) = (worst.max(difference), sum + difference, count + 1);
            most = most.max(difference);
        }
        of_patch.push(most);
    }
    println!("chart: CIEDE2000 mean {:.3}, worst {worst:.3} over {count} patches and views", sum / f64::from(count));
    println!("worst view of each patch: {of_patch:.2?}");
    assert_eq!(count, 24 * 49);
    assert!(worst < 2.0 && sum / f64::from(count) < 0.4, "{worst} {}", sum / f64::from(count));
}

#[test]
fn an_illum_capture_needs_nothing_but_itself() {
    let dir = tempfile::tempdir().unwrap();
    let run = |words: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_lenslet")).current_dir(&dir).args(words).output().unwrap();
        assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    let made = run(&[
        "simulate",
        "--camera",
        "lytro-illum",
        "--sensor",
        "440x360",
        "--size",
        "124",
        "--views",
        "15",
        "--scene",
        "flat",
        "--whites",
        "1",
        "--out",
        "sim",
        "--json",
    ]);
    assert_eq!((&made["white_inside"], &made["whites"]), (&true.into(), &0.into()));
    let capture = container::open_capture(&dir.path().join("sim/capture.lfr"), None).unwrap();
    assert_eq!((capture.mosaic.width, capture.mosaic.height), (440, 360));
    assert_eq!((capture.cfa, capture.levels.white), (container::Cfa::Grbg, [1023.0; 4]));
    assert_eq!(capture.camera.model.as_deref(), Some("ILLUM"));
    let done = run(&[
        "decode",
        "sim/capture.lfr",
        "--out",
        "lf",
        "--size",
        "124",
        "--views",
        "15",
        "--method",
        "cubic",
        "--json",
    ]);
    assert!(done["calibration"].as_str().unwrap().contains("inside the capture"), "{done}");
    let load = |path: &str| lightfield::load(&dir.path().join(path), &ReadOptions::default()).unwrap();
    let (ours, truth) = (load("lf"), load("sim/truth/views"));
    assert_eq!(ours.data.dim(), (15, 15, 101, 124, 3));
    // The middle view, one within the micro-image, and what is said of one that looks past its border.
    for (v, u, least) in [(7, 7, 24.0), (4, 8, 24.0), (10, 5, 24.0)] {
        let view =
            |f: &lightfield::LightField| f.data.slice(ndarray::s![v, u, 8..93, 8..116, ..]).to_owned().into_dyn();
        let psnr = metrics::psnr(view(&ours).view(), view(&truth).view()).unwrap();
        println!("Illum view ({v}, {u}): {psnr:.2} dB");
        assert!(psnr > least, "({v}, {u}): {psnr}");
    }
    let weights = ours.meta.weights.unwrap();
    assert!(weights[7 * 15 + 7] > 0.98 && weights[0] == 0.0 && weights.len() == 225);
    check_steps(&dir.path().join("lf/lightfield.json"));
}

/// The description names every step that was taken.
fn check_steps(path: &Path) {
    let text = std::fs::read_to_string(path).unwrap();
    for step in ["BlackLevel", "Demosaic(Lenslet)", "ColourMatrix", "ExposureBias", "Gamut"] {
        assert!(text.contains(&format!("\"{step}\"")), "{step}");
    }
}
