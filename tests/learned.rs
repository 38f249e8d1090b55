//! Learned reconstruction as a user runs it, on a simulated capture, with the measured samples at hand; and dictionaries for views
//! refined by all the others.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::path::Path;

use serde_json::Value;

fn lenslet(arguments: &[&str]) -> Value {
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_lenslet"))
        .args(["-q", "--json"])
        .args(arguments)
        .output()
        .unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn text(p: &Path) -> &str {
    p.to_str().unwrap()
}

#[test]
fn learned_beats_what_it_starts_from_in_every_view() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (sim, calibration) = (at("sim"), at("camera.calib"));
    lenslet(&["simulate", "--sensor", "640", "--size", "210", "--seed", "4", "--views", "3", "--out", text(&sim)]);
    let (first, second) = (sim.join("white-00.lfp"), sim.join("white-01.lfp"));
    lenslet(&["calibrate", text(&first), text(&second), "--out", text(&calibration)]);
    let capture = sim.join("capture.lfp");
    let decode = |out: &str, more: &[&str]| {
        let out = at(out);
        let common = ["decode", text(&capture), "-c", text(&calibration), "--size", "210", "--views", "3", "--out"];
        lenslet(&[&common[..], &[text(&out)], more].concat());
        out
    };
    let truth = sim.join("truth/views");
    let scores = |field: &Path| -> Vec<f64> {
        let scored = lenslet(&["score", text(field), text(&truth), "--border", "12"]);
        scored["views"].as_array().unwrap().iter().map(|v| v["psnr_y"].as_f64().unwrap()).collect()
    };
    let (low, sharp) = (decode("low", &["--method", "barycentric"]), at("sharp"));
    assert_eq!(lenslet(&["infer", text(&low), "--out", text(&sharp)])["samples"], true);
    let (before, after) = (scores(&low), scores(&sharp));
    println!("{before:.2?} {after:.2?}");
    assert!(before.iter().zip(&after).all(|(b, a)| a >= b), "{before:?} {after:?}");
    assert!(after[4] > before[4] + 0.5, "{before:?} {after:?}");
    // In one go it is the same but for the 16 bits between.
    let whole = decode("whole", &["--method", "learned"]);
    let between = lenslet(&["score", text(&whole), text(&sharp)]);
    assert!(between["mean"]["psnr_y"].as_f64().unwrap() > 55.0, "{between}");
    // Samples that say nothing but noise are as good as none.
    let (blind, without) = (at("blind"), at("without"));
    lenslet(&["infer", text(&low), "--out", text(&blind), "--noise", "1"]);
    lenslet(&["infer", text(&low), "--out", text(&without), "--without-samples"]);
    let same = lenslet(&["score", text(&blind), text(&without)]);
    // Equal views have no number of decibels.
    assert!(same["mean"]["psnr_y"].as_f64().is_none_or(|psnr| psnr > 80.0), "{same}");
}

#[test]
fn photos_before_the_camera_become_a_dictionary_for_refined_views() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for n in 0..2u32 {
        let waves =
            |x: u32, y: u32| ((0.2 + 0.1 * n as f32) * x as f32).sin() + (0.25 * y as f32 - 0.1 * x as f32).sin();
        let picture = image::GrayImage::from_fn(200, 160, |x, y| image::Luma([(120.0 + 50.0 * waves(x, y)) as u8]));
        picture.save(at(&format!("{n}.png"))).unwrap();
    }
    let parameters = at("parameters.json");
    let small = r#"{"base":"multiview","atoms":24,"features":16,"epochs":1,"refine":0,"coupling":"low","pairs":1000,
        "crop":60,"crops":1,"patch":7,"window":7,"anchors":12,"neighbours":200,"held_out":0}"#;
    std::fs::write(&parameters, small).unwrap();
    let train = |out: &Path| {
        lenslet(&["train-dict", text(folder.path()), "--parameters", text(&parameters), "--out", text(out)])
    };
    let (one, two) = (at("one.lfd"), at("two.lfd"));
    train(&one);
    train(&two);
    assert_eq!(std::fs::read(&one).unwrap(), std::fs::read(&two).unwrap());
    let shown = lenslet(&["dict", "show", text(&one)]);
    assert_eq!(shown["models"][0]["base"], "multiview");
    assert_eq!(shown["models"][0]["footprint"], "point");
    assert_eq!(shown["models"].as_array().unwrap().len(), 1);
    assert_eq!(shown["recipe"]["parameters"]["base"], "multiview");

    // What the simulated camera decides is not the user's to give.
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_lenslet"))
        .args(["train-dict", text(folder.path()), "--base", "multiview", "--noise", "0.1", "--out", text(&at("c.lfd"))])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("--base multiview"));
}
