//! `lenslet score` as its users run it.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::path::Path;

use assert_cmd::Command;
use lenslet_core::lightfield::{ColourSpace, Format, Meta, create};
use ndarray::Array3;
use serde_json::Value;

fn lenslet() -> Command {
    Command::new(env!("CARGO_BIN_EXE_lenslet"))
}

/// Two by three views, a smooth pattern plus `offset` everywhere (and `extra` in the first view).
fn write(path: &Path, offset: f32, extra: f32, format: Format) {
    let meta = Meta::new([2, 3], [24, 30], 3, ColourSpace::Srgb);
    let mut sink = create(path, meta, format, false).unwrap();
    for v in 0..2 {
        for u in 0..3 {
            let first = if v + u == 0 { extra } else { 0.0 };
            let view = Array3::from_shape_fn((24, 30, 3), |(t, s, c)| {
                0.3 + 0.1 * ((t + 2 * s + c + v) as f32 * 0.7).sin() + offset + first
            });
            sink.write(v, u, &view).unwrap();
        }
    }
    sink.finish().unwrap();
}

fn json(arguments: &[&str], dir: &Path) -> Value {
    let output = lenslet().current_dir(dir).args(arguments).arg("--json").output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn known_offsets_give_known_scores() {
    let dir = tempfile::tempdir().unwrap();
    write(&dir.path().join("truth"), 0.0, 0.0, Format::Directory);
    write(&dir.path().join("off.npy"), 0.1, 0.0, Format::Npy);
    let scores = json(&["score", "off.npy", "truth", "--border", "2"], dir.path());
    assert_eq!(scores["views"].as_array().unwrap().len(), 6);
    // An offset of 0.1 everywhere is 20 dB in colour and in luminance.
    for key in ["psnr_rgb", "psnr_y"] {
        assert!((scores["mean"][key].as_f64().unwrap() - 20.0).abs() < 2e-3, "{scores}");
    }
    let ssim = scores["mean"]["ssim_y"].as_f64().unwrap();
    assert!(ssim > 0.5 && ssim < 1.0);
    assert_eq!((scores["views"][4]["v"].as_u64(), scores["views"][4]["u"].as_u64()), (Some(1), Some(1)));
}

#[test]
fn equal_views_have_no_finite_psnr() {
    let dir = tempfile::tempdir().unwrap();
    write(&dir.path().join("a.npy"), 0.0, 0.0, Format::Npy);
    write(&dir.path().join("b.npy"), 0.0, 0.1, Format::Npy);
    let same = json(&["score", "a.npy", "a.npy"], dir.path());
    assert!(same["mean"]["psnr_rgb"].is_null() && same["views"][0]["identical"] == true);
    assert_eq!(same["mean"]["ssim_y"], 1.0);
    let mixed = json(&["score", "b.npy", "a.npy"], dir.path());
    assert!((mixed["mean"]["psnr_rgb"].as_f64().unwrap() - 20.0).abs() < 1e-3);
    assert!(mixed["note"].as_str().unwrap().contains("5 of 6 views"));
}

#[test]
fn what_cannot_be_compared_is_said() {
    let dir = tempfile::tempdir().unwrap();
    write(&dir.path().join("a"), 0.0, 0.0, Format::Directory);
    std::fs::copy(dir.path().join("a/view_00_00.png"), dir.path().join("one.png")).unwrap();
    let fails = |arguments: &[&str], code: i32, words: &str| {
        let output = lenslet().current_dir(dir.path()).args(arguments).output().unwrap();
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{message}");
        assert!(message.contains(words) && message.lines().count() == 1, "{message}");
        assert!(output.stdout.is_empty());
    };
    fails(&["score", "one.png", "a"], 1, "2x3 views");
    fails(&["score", "a", "missing"], 1, "missing");
    fails(&["score", "a", "a", "--border", "12"], 2, "--border");
    let pair = json(&["score", "one.png", "a/view_01_02.png"], dir.path());
    assert!(pair["mean"]["psnr_rgb"].as_f64().unwrap() > 5.0);
}

#[test]
fn aligned_results_of_another_size_can_be_scored() {
    let dir = tempfile::tempdir().unwrap();
    let scene =
        |x: f64, y: f64| (0.5 + 0.2 * (0.21 * x).sin() * (0.17 * y).cos() + 0.1 * (0.06 * (x - y)).sin()) as f32;
    let save = |name: &str, side: usize, gain: f32| {
        let scale = 96.0 / side as f64;
        let meta = Meta::new([1, 2], [side, side], 3, ColourSpace::Srgb);
        let mut sink = create(&dir.path().join(name), meta, Format::Npy, false).unwrap();
        for u in 0..2 {
            let view = Array3::from_shape_fn((side, side, 3), |(t, s, _)| {
                let at = |i: usize| (i as f64 + 0.5) * scale - 0.5;
                gain * scene(at(s) + 3.0 * u as f64, at(t))
            });
            sink.write(0, u, &view).unwrap();
        }
        sink.finish().unwrap();
    };
    save("truth.npy", 96, 1.0);
    save("peer.npy", 72, 0.8);
    let output = lenslet().current_dir(dir.path()).args(["score", "peer.npy", "truth.npy"]).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("--align"));
    let scores = json(&["score", "peer.npy", "truth.npy", "--align", "--border", "8"], dir.path());
    assert!(scores["mean"]["psnr_y"].as_f64().unwrap() > 40.0, "{scores}");
    assert!((scores["alignment"]["affine"][0].as_f64().unwrap() - 0.75).abs() < 1e-3);
    assert!((scores["alignment"]["gain"][1][0].as_f64().unwrap() - 1.25).abs() < 0.01);
}

#[test]
fn sharp_views_are_told_the_sharp_truth() {
    let dir = tempfile::tempdir().unwrap();
    let field = |name: &str, step: Value| {
        let mut meta = Meta::new([1, 1], [24, 30], 3, ColourSpace::Srgb);
        meta.provenance.push(step);
        let mut sink = create(&dir.path().join(name), meta, Format::Directory, false).unwrap();
        sink.write(0, 0, &Array3::from_elem((24, 30, 3), 0.5)).unwrap();
        sink.finish().unwrap();
    };
    field("joint", serde_json::json!({"command": "decode", "fit": "joint"}));
    field("points", serde_json::json!({"command": "decode", "fit": "least-squares"}));
    for truth in ["gathered", "sharp"] {
        field(truth, serde_json::json!({"tool": "lenslet simulate", "truth": truth}));
    }
    for (result, truth, noted) in [
        ("joint", "gathered", true),
        ("joint", "sharp", false),
        ("points", "gathered", false),
        ("points", "sharp", false),
    ] {
        let output = lenslet().current_dir(dir.path()).args(["score", result, truth]).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success() && said.contains("truth/sharp") == noted, "{result}, {truth}: {said}");
    }
}
