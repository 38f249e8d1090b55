//! `lenslet assess`, and its measures against the truth of simulated captures: the order of the methods must be the truth's,
//! and how far a measure is biased is printed (docs/assessing.md has the tables).

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and prints its tables

use std::fs;
use std::path::Path;
use std::process::Output;

use assert_cmd::Command;
use lenslet_core::calibration::{Calibration, CalibrationOptions, CalibrationVariant, calibrate};
use lenslet_core::container::Capture;
use lenslet_core::decode::{self, HexSamples};
use lenslet_core::geometry::Size;
use lenslet_core::progress::Silent;
use lenslet_data_gen::simulate::{
    Camera, Scene, SceneName, ScenePair, SimulationOptions, output_size, render_capture, true_view, view_offset,
};
use lenslet_views::assess::{
    Difference, EdgeMeasures, Edges, LineMeasures, Lines, MiddleView, MiddleViews, RawScore, Rays,
    compare_calibrations, holes_score, keep_common_edges, keep_common_lines, median_of_differences, median_with_error,
};
use lenslet_views::{Method, RenderSamples as _};
use ndarray::Array3;

/// Side of the sensor: for methods, and for calibrations.
const SENSORS: [usize; 2] = [1144, 820];

/// The simulated captures: light, blur (pitches), noise, JPEG quality.
const CAPTURES: [(&str, f64, f64, f64, Option<u8>); 4] = [
    ("clean", 1.0, 0.25, 0.7, None),
    ("noisy", 1.0, 0.25, 4.0, None),
    ("JPEG", 1.0, 0.25, 0.7, Some(75)),
    ("soft dark", 0.2, 0.6, 0.7, Some(75)),
];

const METHODS: [&str; 6] = ["bicubic", "barycentric", "cubic", "learned", "multiview", "learned on multiview"];

fn method(name: &str) -> Method {
    match name {
        "bicubic" => Method::bicubic(),
        "barycentric" => Method::barycentric(),
        "cubic" => Method::cubic(),
        "learned" => Method::barycentric().learned(),
        "multiview" => Method::multiview(),
        _ => Method::multiview().learned(),
    }
}

/// A capture with its truth.
struct Simulated {
    capture: Capture,
    whites: Vec<Capture>,
    /// The middle view, linear light as the capture has it.
    truth: Array3<f32>,
    size: Size,
}

fn simulate(sensor: usize, light: f64, footprint: f64, noise: f64, jpeg: Option<u8>) -> Simulated {
    let mut camera = Camera::with_sensor(sensor).perturbed(3);
    camera.optics.footprint = footprint;
    (camera.response.exposure, camera.imperfections.jpeg) = (light, jpeg);
    let draw = |camera: &Camera| Scene::named(SceneName::Natural, camera, None, 3, &Silent);
    let scenes = ScenePair::draw(&camera, draw).unwrap();
    let options = SimulationOptions { seed: 3, noise, whites: 2 };
    let taken = render_capture(&scenes.gathered, &camera, &options, &Silent).unwrap();
    let Size { width, height } = output_size(&camera, (sensor * 1080 + 1640) / 3280);
    let truth = true_view(&scenes.sharp, &camera, view_offset([3, 3], 7, 1.0), Size::new(width, height));
    Simulated { capture: taken.capture, whites: taken.whites, truth, size: Size { width, height } }
}

impl Simulated {
    fn calibration(&self, variant: CalibrationVariant) -> Calibration {
        calibrate(&self.whites, &CalibrationOptions { variant, ..CalibrationOptions::default() }, &Silent).unwrap()
    }

    fn decoded(&self, calibration: &Calibration) -> HexSamples {
        let options = decode::Options { steps: decode::steps_for(&self.capture), ..decode::Options::default() };
        decode::sample_views(&self.capture, calibration, &options, &Silent).unwrap()
    }
}

/// PSNR of encoded luminance, the border left out.
fn psnr(picture: &Array3<f32>, truth: &Array3<f32>) -> f64 {
    let encoded = |p: &Array3<f32>| {
        let mut p = p.clone();
        lenslet_core::lightfield::colour::convert(
            &mut p,
            lenslet_core::lightfield::ColourSpace::Linear,
            lenslet_core::lightfield::ColourSpace::Srgb,
        );
        p.mapv_inplace(|x| x.clamp(0.0, 1.0));
        p
    };
    let window = lenslet_core::metrics::Window::without_border(12);
    lenslet_core::metrics::Scores::between(encoded(picture).view(), encoded(truth).view(), &window).unwrap().psnr_y
}

/// Differences by rays that may be of their own making: what they foretell lies between the places of samples, dB.
const RAYS: f64 = 0.1;

/// Differences by raw pixels that are equality, dB: by the truth full and rotation-only are 0.01 to 0.03 apart, and of twelve
/// comparisons one is beyond two standard errors by chance alone every fourth time.
const EQUAL: f64 = 0.05;

/// Differences of roughness that tell nothing, pixels.
const ROUGH: f64 = 0.01;

/// Measured and true differences of every pair of methods: those whose measured difference lies beyond two standard errors
/// and is larger than `bias`, and of these those that the truth, beyond two standard errors of its own, has the other way
/// round: half a dozen edges do not know the truth to any digit, either. Of pairs that the truth holds equal, within `bias`,
/// nothing is told by up to three times that.
fn contradictions(
    names: &[&str],
    bias: f64,
    measured: impl Fn(usize, usize) -> Difference,
    truth: impl Fn(usize, usize) -> Difference,
) -> (usize, Vec<String>) {
    let (mut told, mut wrong) = (0, Vec::new());
    for a in 0..names.len() {
        for b in 0..names.len() {
            let m = measured(a, b);
            let (known, reverse) = (truth(a, b), truth(b, a));
            let tied = known.mean.abs() <= bias && m.mean < 3.0 * bias;
            if a != b && m.is_above_zero(2.0) && m.mean > bias && !tied {
                told += 1;
                if reverse.is_above_zero(2.0) {
                    wrong.push(format!(
                        "{} over {}: {:+.3} ± {:.3}, truth {:+.3} ± {:.3}",
                        names[a], names[b], m.mean, m.error, known.mean, known.error
                    ));
                }
            }
        }
    }
    (told, wrong)
}

#[test]
fn the_order_of_the_methods_is_that_of_the_truth() {
    let mut told_by_edges = (0, Vec::new());
    for (name, light, footprint, noise, jpeg) in CAPTURES {
        let simulated = simulate(SENSORS[0], light, footprint, noise, jpeg);
        let samples = simulated.decoded(&simulated.calibration(CalibrationVariant::Full));
        let rays = Rays::find(&samples, &simulated.size, &Silent).unwrap();
        let (edges, lines) = (Edges::find(&rays), Lines::find(&rays));
        let views = MiddleViews::new(&samples, &rays, &simulated.size);
        let pictures: Vec<MiddleView> = METHODS.iter().map(|m| views.render(&method(m), &Silent).unwrap()).collect();
        let truth = simulated.truth.view();

        let told: Vec<_> = pictures.iter().map(|p| rays.measure(p.withheld()).unwrap()).collect();
        let known: Vec<_> = pictures.iter().map(|p| rays.measure_against(p.withheld(), truth).unwrap()).collect();
        let mut sharp: Vec<EdgeMeasures> = pictures.iter().map(|p| edges.measure(p.whole())).collect();
        let jags: Vec<Vec<f64>> = pictures.iter().map(|p| edges.displacement(p.whole(), truth)).collect();
        let mut thin: Vec<LineMeasures> = pictures.iter().map(|p| lines.measure(p.whole())).collect();
        let bent: Vec<Vec<f64>> = pictures.iter().map(|p| lines.displacement(p.whole(), truth)).collect();
        let common = (keep_common_edges(sharp.iter_mut()), keep_common_lines(thin.iter_mut()));
        println!("{name}: {} rays, {} edges, {} lines", rays.count(), common.0, common.1);
        for (k, m) in METHODS.iter().enumerate() {
            let over = told[k].over(&told[1]);
            let whole = pictures[k].whole().to_owned();
            // Where the others are, holes tell the opposite of the truth.
            let holes = (!m.contains("multiview")).then(|| {
                holes_score::<lenslet_views::Error>(&samples, &simulated.size, &mut |rest| {
                    Ok(rest.renderer(method(m)).size(simulated.size).prepare()?.view(3, 3)?.into_pixels())
                })
                .unwrap()
                .psnr
            });
            let median = |v: &[f64]| median_with_error(v).map_or(f64::NAN, |m| m.median);
            println!(
                "  {m:22} truth {:.2}, at rays {:.2} ({:+.2}); rays {:.2} ({:+.2} ± {:.2}); MTF50 {:.3}, rough {:.3} (displaced {:.3}); \
                 lines {:.3} (displaced {:.3}), width {:.2}; holes {:.2}",
                psnr(&whole, &simulated.truth),
                known[k].psnr(),
                known[k].over(&known[1]).mean,
                told[k].psnr(),
                over.mean,
                over.error,
                median(&sharp[k].mtf50),
                median(&sharp[k].rough),
                median(&jags[k]),
                median(&thin[k].rough),
                median(&bent[k]),
                median(&thin[k].width),
                holes.unwrap_or(f64::NAN),
            );
        }
        let by_rays = contradictions(&METHODS, RAYS, |a, b| told[a].over(&told[b]), |a, b| known[a].over(&known[b]));
        let rough = |a: usize, b: usize| median_of_differences(&sharp[b].rough, &sharp[a].rough);
        let none = Difference { mean: 0.0, error: 1.0 };
        let by_edges = contradictions(
            &METHODS,
            ROUGH,
            |a, b| rough(a, b).unwrap_or(none),
            |a, b| median_of_differences(&jags[b], &jags[a]).unwrap_or(none),
        );
        let by_lines = contradictions(
            &METHODS,
            0.0,
            |a, b| median_of_differences(&thin[b].rough, &thin[a].rough).unwrap_or(none),
            |a, b| median_of_differences(&bent[b], &bent[a]).unwrap_or(none),
        );
        println!("  rays: {} pairs told, wrong {:?}", by_rays.0, by_rays.1);
        println!("  edges: {} pairs told, wrong {:?}", by_edges.0, by_edges.1);
        println!("  lines: {} pairs told, wrong {:?}", by_lines.0, by_lines.1);
        // Of the fifteen pairs. Roughness calls blurred pictures smooth; the lines of this scene are not straight.
        assert!(by_rays.0 >= 6 && by_rays.1.is_empty(), "{name}: {by_rays:?}");
        told_by_edges.0 += by_edges.0;
        told_by_edges.1.extend(by_edges.1.into_iter().filter(|w| !w.starts_with("bicubic")));
    }
    // A capture has half a dozen edges, which tell little alone.
    assert!(told_by_edges.0 >= 9 && told_by_edges.1.is_empty(), "{told_by_edges:?}");
}

#[test]
fn the_order_of_calibrations_is_that_of_the_truth() {
    let variants = [
        CalibrationVariant::Full,
        CalibrationVariant::RotationOnly,
        CalibrationVariant::Integer,
        CalibrationVariant::None,
    ];
    for (name, light, footprint, noise, jpeg) in CAPTURES {
        let simulated = simulate(SENSORS[1], light, footprint, noise, jpeg);
        let calibrations = variants.map(|v| simulated.calibration(v));
        let each: Vec<&Calibration> = calibrations.iter().collect();
        let scores = compare_calibrations(&simulated.capture, &each, simulated.size.width, &Silent).unwrap();
        println!("{name}: {} raw pixels", scores[0].pixels);
        for ((variant, calibration), score) in variants.iter().zip(&calibrations).zip(&scores) {
            let samples = simulated.decoded(calibration);
            let view =
                samples.renderer(Method::barycentric()).size(simulated.size).prepare().unwrap().view(3, 3).unwrap();
            println!(
                "  {variant:14} truth {:.2}; raw {:.3} ({:+.3} ± {:.3})",
                psnr(&view.into_pixels(), &simulated.truth),
                score.rms,
                score.over.mean,
                score.over.error
            );
        }
        // Full calibration is the nearest to the truth: none is told to be over it.
        let over = |s: &RawScore| s.over.is_above_zero(2.0) && s.over.mean > EQUAL;
        assert!(!scores.iter().any(over), "{name}: {scores:?}");
        if name == "clean" {
            let below = |k: usize| -scores[k].over.mean > 2.0 * scores[k].over.error;
            assert!(below(3), "{name}: {scores:?}");
        }
    }
}

fn assess(dir: &Path, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenslet"));
    command.current_dir(dir).args(["assess", "-q"]).args(more).output().unwrap()
}

fn simulated_folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    for more in [
        &["simulate", "--sensor", "820", "--size", "270", "--views", "1", "--whites", "1", "--out", "sim"][..],
        &["calibrate", "sim/white-00.lfp", "--out", "cam.calib"],
        &["calibrate", "sim/white-00.lfp", "--variant", "none", "--out", "none.calib"],
    ] {
        let done =
            Command::new(env!("CARGO_BIN_EXE_lenslet")).current_dir(dir.path()).arg("-q").args(more).output().unwrap();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    }
    dir
}

#[test]
fn a_capture_is_assessed_on_the_command_line() {
    let dir = simulated_folder();
    let size = ["--size", "270", "--method", "cubic", "multiview"];
    let all: Vec<&str> = ["sim/capture.lfp", "--calibration", "cam.calib", "none.calib", "--json", "--out", "a.md"]
        .into_iter()
        .chain(size)
        .collect();
    let output = assess(dir.path(), &all);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(found["capture"], "capture.lfp");
    let over = |measure: &str, name: &str| found[measure][name]["over"].as_f64().unwrap();
    // The reference comes with every call.
    assert_eq!(over("rays", "barycentric"), 0.0);
    assert!(over("rays", "multiview") > over("rays", "cubic") && over("rays", "cubic") > 0.0, "{found}");
    assert!(found["rays"]["multiview"]["error"].as_f64().unwrap() > 0.0);
    assert!(found["edges"]["cubic"]["mtf50"].is_number() || found["edges"]["cubic"]["mtf50"].is_null());
    assert!(found["raw"]["none"]["error"].as_f64().unwrap() > 0.0 && over("raw", "cam") == 0.0, "{found}");
    assert!(found.get("holes").is_none());
    let report = fs::read_to_string(dir.path().join("a.md")).unwrap();
    assert!(report.contains("| multiview |") && report.contains("| none |"), "{report}");
    // Again: what is there stays.
    let again = assess(dir.path(), &all);
    assert!(again.status.code() == Some(1) && String::from_utf8_lossy(&again.stderr).contains("--force"));

    // The same whatever the number of threads.
    let few = ["sim/capture.lfp", "-c", "cam.calib", "--json", "--measure", "rays", "holes", "--size", "270"];
    let one = assess(dir.path(), &[&few[..], &["--threads", "1"]].concat());
    let many = assess(dir.path(), &[&few[..], &["--threads", "3"]].concat());
    assert!(one.status.success() && one.stdout == many.stdout, "{}", String::from_utf8_lossy(&one.stderr));
    let found: serde_json::Value = serde_json::from_slice(&one.stdout).unwrap();
    assert!(
        found["holes"]["learned"]["psnr"].is_number() && found.get("edges").is_none() && found.get("raw").is_none()
    );
}

#[test]
fn wrong_use_is_told_in_one_line() {
    let dir = simulated_folder();
    fs::write(dir.path().join("bad.txt"), "1 2 3\n").unwrap();
    fs::create_dir(dir.path().join("tiny")).unwrap();
    let tiny =
        ["simulate", "--sensor", "128", "--size", "42", "--views", "1", "--whites", "1", "--out", "tiny", "--force"];
    assert!(
        Command::new(env!("CARGO_BIN_EXE_lenslet"))
            .current_dir(dir.path())
            .args(tiny)
            .output()
            .unwrap()
            .status
            .success()
    );
    for (more, code, words) in [
        (&["sim/capture.lfp", "-c", "cam.calib", "--measure", "raw"][..], 2, "--from-captures"),
        (&["sim/capture.lfp", "-c", "cam.calib", "--measure", "rays", "--lines", "bad.txt"], 2, "--measure lines"),
        (&["sim/capture.lfp", "-c", "cam.calib", "--lines", "bad.txt"], 1, "bad.txt: row 1"),
        (&["sim/capture.lfp", "-c", "missing.calib"], 1, "missing.calib"),
        (&["missing.lfp", "-c", "cam.calib"], 1, "missing.lfp"),
        (&["sim/capture.lfp"], 2, "--calibration"),
        (
            &["tiny/capture.lfp", "--white", "tiny/white-00.lfp", "--measure", "rays", "--size", "64"],
            1,
            "samples of other views",
        ),
    ] {
        let output = assess(dir.path(), more);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{more:?}: {message}");
        assert!(
            message.contains(words) && message.lines().count() == 1 && output.stdout.is_empty(),
            "{more:?}: {message}"
        );
    }
}
