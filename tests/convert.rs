//! `lenslet convert` as its users run it.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::path::Path;

use assert_cmd::Command;
use lenslet_core::lightfield::{ColourSpace, Format, Meta, ReadOptions, create, load};
use ndarray::{Array3, s};

fn lenslet(dir: &Path, arguments: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_lenslet")).current_dir(dir).args(arguments).output().unwrap()
}

fn write(path: &Path) {
    let meta = Meta::new([3, 3], [12, 16], 3, ColourSpace::Srgb);
    let mut sink = create(path, meta, Format::Directory, false).unwrap();
    for v in 0..3 {
        for u in 0..3 {
            let view = Array3::from_shape_fn((12, 16, 3), |(t, s, c)| ((7 * v + 5 * u + t + s + c) % 17) as f32 / 17.0);
            sink.write(v, u, &view).unwrap();
        }
    }
    sink.finish().unwrap();
}

#[test]
fn around_all_formats_and_back() {
    let dir = tempfile::tempdir().unwrap();
    write(&dir.path().join("lf"));
    let chain = ["lf", "a.npy", "b.mat", "c.png", "d"];
    for pair in chain.windows(2) {
        let mut arguments = vec!["convert", pair[0], "--out", pair[1], "-q"];
        if pair[0] == "c.png" {
            arguments.extend(["--views", "3x3"]);
        }
        let output = lenslet(dir.path(), &arguments);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        assert!(String::from_utf8_lossy(&output.stdout).contains("3x3 views of 16x12"));
    }
    let read = |name: &str| load(&dir.path().join(name), &ReadOptions::default()).unwrap();
    assert_eq!(read("lf").data, read("d").data);
    assert!(read("d").meta.provenance.iter().any(|p| p["input"] == "c.png"));
}

#[test]
fn linear_light_and_a_crop_of_views() {
    let dir = tempfile::tempdir().unwrap();
    write(&dir.path().join("lf"));
    let output = lenslet(dir.path(), &["convert", "lf", "--out", "x.npy", "--linear", "--crop-views", "1", "--json"]);
    assert!(output.status.success());
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&json["views"], &json["colour"]), (&serde_json::json!([1, 1]), &serde_json::json!("linear")));
    let whole = load(&dir.path().join("lf"), &ReadOptions::default()).unwrap();
    let linear = load(&dir.path().join("x.npy"), &ReadOptions::default()).unwrap();
    let expected = whole.data.slice(s![1, 1, .., .., ..]).mapv(lenslet_core::colour::srgb_decode);
    assert_eq!(linear.data.slice(s![0, 0, .., .., ..]), expected);
    // Said to be linear on the way back, it is what it was.
    let output = lenslet(dir.path(), &["convert", "x.npy", "--out", "y.npy", "--input-linear"]);
    assert!(output.status.success());
    let back = load(&dir.path().join("y.npy"), &ReadOptions::default()).unwrap();
    let worst = (&back.data.slice(s![0, 0, .., .., ..]) - &whole.data.slice(s![1, 1, .., .., ..]))
        .fold(0.0f32, |a, &b| a.max(b.abs()));
    assert!(worst < 1e-5, "{worst}");
}

#[test]
fn wrong_use_is_told_in_one_line() {
    let dir = tempfile::tempdir().unwrap();
    write(&dir.path().join("lf"));
    std::fs::write(dir.path().join("text.npy"), "no array").unwrap();
    std::fs::create_dir(dir.path().join("empty")).unwrap();
    for (arguments, code, words) in [
        (vec!["convert", "lf", "--out", "lf"], 1, "it is an input"),
        (vec!["convert", "text.npy", "--out", "x"], 1, "text.npy"),
        (vec!["convert", "empty", "--out", "x"], 1, "numbered pictures"),
        (vec!["convert", "missing", "--out", "x"], 1, "missing"),
        (vec!["convert", "lf", "--out", "x", "--crop-views", "4"], 2, "3x3"),
    ] {
        let output = lenslet(dir.path(), &arguments);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{message}");
        assert!(message.contains(words) && message.lines().count() == 1, "{message}");
        assert!(!dir.path().join("x").exists());
    }
}
