//! `lenslet score` as its users run it.

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
