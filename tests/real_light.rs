//! Light that a real camera recorded, through the whole pipeline: calibrated, decoded, refined and reconstructed, with the
//! figures that sound steps give. What is committed runs in every clone; whole captures need the data folder.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it measured

use std::path::{Path, PathBuf};

use fixtures::real;
use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::lightfield::{self, ReadOptions};
use lenslet_core::metrics::{Scores, Window};
use lenslet_core::sampling::bicubic::resize_bicubic;
use lenslet_views::multiview::hidden_score;
use lenslet_views::reconstruct::Options;
use lenslet_views::{Error, Learned, Method, RenderSamples as _};
use ndarray::{Array3, Array5, Axis, s};
use program::{lenslet, text};
use serde_json::Value;

mod fixtures;
mod program;

fn within(value: &Value, low: f64, high: f64) {
    let v = value.as_f64().unwrap();
    assert!((low..=high).contains(&v), "{v} is not within {low} to {high}");
}

fn load(path: &Path) -> Array5<f32> {
    lightfield::load(path, &ReadOptions::default()).unwrap().data
}

/// A real white image decoded by its own calibration: every view is flat, also those at the rim of the lenslets, where
/// the light falls to a third.
#[test]
fn a_white_image_decodes_to_flat_views() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (white, calibration) = (real("f01-white-crop/white.png"), at("crop.calib"));
    let found = lenslet(&["calibrate", text(&white), "--out", text(&calibration)]);
    within(&found["pitch"], 9.91, 9.95);
    within(&found["rotation"], 0.0015, 0.0028);
    let flat = |out: &str, more: &[&str]| -> Vec<f32> {
        let out = at(out);
        let common = ["decode", text(&white), "-c", text(&calibration), "--size", "80", "--views", "5", "--linear"];
        lenslet(&[&common[..], &["--method", "cubic", "--npy", "--out", text(&out)], more].concat());
        let field: Array5<f32> = ndarray_npy::read_npy(&out).unwrap();
        let inner = field.slice(s![.., .., 12..68, 12..68, ..]);
        let means: Vec<f32> = inner
            .outer_iter()
            .flat_map(|row| row.outer_iter().map(|v| v.mean().unwrap()).collect::<Vec<_>>())
            .collect();
        println!("{means:.3?}, spread {:.4}", inner.std(0.0) / inner.mean().unwrap());
        means.into_iter().chain([inner.std(0.0) / inner.mean().unwrap()]).collect()
    };
    let with = flat("with.npy", &[]);
    let without = flat("without.npy", &["--without", "vignetting"]);
    let share = |means: &[f32]| means[..25].iter().fold(f32::MAX, |m, v| m.min(*v)) / means[12];
    assert!(share(&with) > 0.98, "rim over middle: {}", share(&with));
    assert!(share(&without) < 0.85, "without the white image: {}", share(&without));
}

/// Real views shrunk to a half and enlarged again: the dictionary for that scale, and the samples of the other views, are
/// nearer to what the camera recorded than bicubic enlargement is.
#[test]
fn real_views_are_enlarged_better_than_by_bicubic() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let whole = load(&real("f01-jaramillo"));
    assert_eq!(whole.dim(), (5, 5, 112, 112, 3));
    let small = Array5::from_shape_fn((5, 5, 56, 56, 3), |(v, u, t, s, c)| {
        whole.slice(s![v, u, 2 * t..2 * t + 2, 2 * s..2 * s + 2, c]).mean().unwrap()
    });
    ndarray_npy::write_npy(at("small.npy"), &small).unwrap();
    let score = |view: Array3<f32>| {
        let truth = whole.slice(s![2, 2, .., .., ..]);
        Scores::between(view.view(), truth, &Window::without_border(8)).unwrap().psnr_y
    };
    let bicubic = score(resize_bicubic(small.slice(s![2, 2, .., .., ..]), Size::new(112, 112)).unwrap());
    let run = |command: &str, more: &[&str]| {
        let (input, out) = (at("small.npy"), at("out.npy"));
        lenslet(&[&[command, text(&input), "--scale", "2", "--out", text(&out), "--force"], more].concat());
        score(load(&out).index_axis_move(Axis(0), 2).index_axis_move(Axis(0), 2))
    };
    let (learned, zeros) = (run("infer", &[]), run("infer", &["--lambda", "1"]));
    let refined = run("refine", &[]);
    println!("bicubic {bicubic:.2}, no dictionary {zeros:.2}, learned {learned:.2}, refined {refined:.2} dB");
    assert!(learned > bicubic + 0.8 && learned > zeros + 0.8, "bicubic {bicubic}, zeros {zeros}, learned {learned}");
    assert!(refined > bicubic + 2.4, "bicubic {bicubic}, refined {refined}");
}

/// One whole capture. No truth is known: hidden lenslets tell which method predicts best what the sensor measured.
#[test]
fn a_real_capture_goes_through_every_step() {
    let Some(capture) = lenslet_test_support::data("f01/IMG_4.jpg") else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let calibration = at("f01.calib");
    // Without a white image: the pattern that the lenslets leave in the capture itself.
    let found = lenslet(&["calibrate", "--from-captures", text(&capture), "--out", text(&calibration)]);
    within(&found["pitch"], 9.929, 9.932);
    within(&found["rotation"], -0.00495, -0.00490);
    within(&found["row_stretch"], 1.0, 1.0005);
    within(&found["count"], 125_000.0, 126_500.0);
    within(&found["residual_rms"], 0.0, 1.0);

    let out = at("views");
    let common = ["decode", text(&capture), "-c", text(&calibration), "--views", "5", "--size", "540"];
    lenslet(&[&common[..], &["--method", "barycentric", "--out", text(&out)]].concat());
    let plain = load(&out);
    assert_eq!(plain.dim(), (5, 5, 540, 540, 3));
    let samples = HexSamples::load(&out.join("samples.npz")).unwrap();
    // Views of one scene: neighbours are more alike than those far apart, and all are as bright.
    let mean = |v: usize, u: usize| plain.slice(s![v, u, .., .., ..]).mean().unwrap();
    let apart =
        |u: usize| (&plain.slice(s![2, 2, .., .., ..]) - &plain.slice(s![2, u, .., .., ..])).mapv(|d| d * d).sum();
    assert!(apart(3) < 0.7 * apart(4), "{} {}", apart(3), apart(4));
    for (v, u) in [(2, 0), (2, 4), (0, 2), (4, 2)] {
        assert!((mean(v, u) / mean(2, 2) - 1.0).abs() < 0.1, "view {v},{u}: {} {}", mean(v, u), mean(2, 2));
    }
    steps(&samples, &plain.slice(s![2, 2, .., .., ..]).to_owned());
}

/// What each method predicts of hidden lenslets, and how its middle view differs from the barycentric one.
fn steps(samples: &HexSamples, plain: &Array3<f32>) {
    let target = Size::new(540, 540);
    let lasso = |lambda| {
        let options = Options { lambda, ..Options::default() };
        Method::barycentric().learned_with(Learned { options, ..Learned::default() })
    };
    let methods = [
        ("barycentric", Method::barycentric()),
        ("cubic", Method::cubic()),
        ("multiview", Method::multiview()),
        ("no dictionary", lasso(Some(1.0))),
        ("LASSO", lasso(None)),
    ];
    let edges = |view: &Array3<f32>| {
        let y = view.mean_axis(Axis(2)).unwrap();
        (&y.slice(s![.., 1..]) - &y.slice(s![.., ..-1])).mapv(|d| d * d).mean().unwrap().sqrt()
    };
    let measured: Vec<(f64, f32, f64)> = methods
        .iter()
        .map(|(name, method)| {
            let hidden = hidden_score(samples, &target, 0.1, 1, (2, 2), &mut |rest| -> Result<_, Error> {
                Ok(rest.renderer(method.clone()).size(target).prepare()?.view(2, 2)?.into_pixels())
            });
            let view = samples.renderer(method.clone()).size(target).prepare().unwrap().view(2, 2).unwrap();
            let view = view.encode().into_pixels();
            let alike = Scores::between(view.view(), plain.view(), &Window::without_border(12)).unwrap().psnr_y;
            let sharp = edges(&view) / edges(plain);
            let hidden = hidden.unwrap().psnr;
            println!("{name}: hidden {hidden:.2} dB, edges {sharp:.3}, like barycentric {alike:.2} dB");
            (hidden, sharp, alike)
        })
        .collect();
    let [plain, cubic, refined, zeros, learned] = measured[..] else { unreachable!() };
    assert!(plain.2 > 45.0, "the program's view and the library's: {plain:?}");
    // Half of what sound steps give: 1.2 and 3.5 dB.
    assert!(cubic.0 > plain.0 + 0.6 && refined.0 > cubic.0 + 1.7, "{measured:?}");
    // Hidden lenslets say nothing of a single view's detail; its edges do, against the same run with every code at zero.
    assert!(learned.1 > zeros.1 + 0.025 && refined.1 > 1.1, "{measured:?}");
    assert!(learned.0 > plain.0 - 0.2, "{measured:?}");
    assert!([cubic, refined, zeros, learned].iter().all(|m| m.2 > 25.0), "the same scene: {measured:?}");
}

/// The committed data is what its description says.
#[test]
fn committed_data_is_whole() {
    let size = |folder: PathBuf| -> u64 {
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().metadata().unwrap().len()).sum()
    };
    let total: u64 = ["f01-white-crop", "f01-jaramillo", "metadata"].map(|f| size(real(f))).iter().sum();
    assert!(total < 3 << 20, "{total} bytes");
    for folder in ["f01-white-crop", "f01-jaramillo", "metadata"] {
        assert!(std::fs::read_to_string(real("README.md")).unwrap().contains(&format!("`{folder}`")), "{folder}");
    }
}
