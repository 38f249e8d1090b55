//! Learned reconstruction as a user runs it, on a simulated capture, with the measured samples at hand; and dictionaries for views
//! refined by all the others.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::path::Path;

use program::{lenslet, text};
use serde_json::Value;

mod program;

/// PSNR of luminance of every view of 3x3.
type Views = Vec<f64>;

/// Over what learned views must be, and by how much in the middle view, dB.
struct Least {
    barycentric: f64,
    cubic: f64,
    no_codes: f64,
    ridge: f64,
}

/// A capture of a scene, decoded, reconstructed from the light field on disk and in one go; learned views must be over
/// those of plain interpolations, of a linear filter, and of everything but the dictionary.
fn learned_is_over_all_else(scene: &[&str], least: &Least) {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (sim, calibration) = (at("sim"), at("camera.calib"));
    let simulate = ["simulate", "--sensor", "640", "--size", "210", "--seed", "4", "--views", "3", "--out", text(&sim)];
    lenslet(&[&simulate[..], scene].concat());
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
    let scores = |field: &Path| -> Views {
        let scored = lenslet(&["score", text(field), text(&truth), "--border", "12"]);
        scored["views"].as_array().unwrap().iter().map(|v| v["psnr_y"].as_f64().unwrap()).collect()
    };
    let low = decode("low", &["--method", "barycentric"]);
    let infer = |out: &str, predictor: &str, more: &[&str]| {
        let out = at(out);
        let done = lenslet(&[&["infer", text(&low), "--out", text(&out)], more].concat());
        assert_eq!((&done["samples"], &done["predictor"]), (&true.into(), &predictor.into()), "{done}");
        let description = std::fs::read(out.join("lightfield.json")).unwrap();
        let description: Value = serde_json::from_slice(&description).unwrap();
        assert_eq!((&description["method"], &description["predictor"]), (&"learned".into(), &predictor.into()));
        out
    };
    let sharp = infer("sharp", "LASSO", &[]);
    let after = scores(&sharp);
    let worse = [
        ("barycentric", scores(&low), least.barycentric),
        ("cubic", scores(&decode("cubic", &["--method", "cubic"])), least.cubic),
        ("no codes", scores(&infer("none", "no codes", &["--path", "none"])), least.no_codes),
        ("ridge", scores(&infer("ridge", "ridge", &["--path", "ridge"])), least.ridge),
    ];
    for (name, before, least) in worse {
        println!("LASSO {after:.2?} over {name} {before:.2?}: {:+.2} of {least}", after[4] - before[4]);
        assert!(before.iter().zip(&after).all(|(b, a)| a > b), "{name}: {before:?} {after:?}");
        assert!(after[4] > before[4] + least, "{name}: {before:?} {after:?}");
    }
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

// The least margins are half of those that `cargo test --release --test learned -- --nocapture` printed.

#[test]
fn learned_views_of_a_drawn_scene_are_over_all_else() {
    // +1.06, +0.04, +0.39, +0.17.
    learned_is_over_all_else(&[], &Least { barycentric: 0.53, cubic: 0.02, no_codes: 0.19, ridge: 0.08 });
}

#[test]
fn learned_views_of_photographs_are_over_all_else() {
    let photo = |name: &str| format!("{}/photos/score/{name}.jpg", env!("CARGO_MANIFEST_DIR"));
    let photos = ["oakland-zoo-otters", "cincinnati-bridge", "beacon-street-sunset"].map(photo);
    let scene = ["--photo", &photos[0], &photos[1], &photos[2]];
    // +1.36, +0.41, +0.53, +0.18.
    learned_is_over_all_else(&scene, &Least { barycentric: 0.68, cubic: 0.2, no_codes: 0.26, ridge: 0.09 });
}

#[test]
fn what_made_refined_views_is_said_and_what_a_dictionary_lacks_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (sim, calibration, capture) = (at("sim"), at("camera.calib"), at("sim/capture.lfp"));
    lenslet(&["simulate", "--sensor", "300", "--size", "100", "--views", "3", "--out", text(&sim)]);
    lenslet(&[
        "calibrate",
        text(&sim.join("white-00.lfp")),
        text(&sim.join("white-01.lfp")),
        "--out",
        text(&calibration),
    ]);
    let run = |more: &[&str]| {
        std::process::Command::new(env!("CARGO_BIN_EXE_lenslet")).arg("--json").args(more).output().unwrap()
    };
    let common = ["decode", text(&capture), "-c", text(&calibration), "--size", "100", "--views", "3"];
    let learned = [&common[..], &["--method", "learned", "--base", "multiview"]].concat();
    let out = at("network");
    let done = run(&[&learned[..], &["--out", text(&out)]].concat());
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(done.status.success() && said.contains("multiview views are reconstructed by: network"), "{said}");
    let description: Value = serde_json::from_slice(&std::fs::read(out.join("lightfield.json")).unwrap()).unwrap();
    assert_eq!(description["predictor"], "network");
    let step = description["provenance"].as_array().unwrap().last().unwrap();
    let words = ["predictor", "dictionary", "fit"].map(|key| step[key].as_str().unwrap_or(""));
    assert_eq!(words, ["network", "multiview", "joint"], "{step}");

    // Without the samples of its views the network has not got its inputs: LASSO takes its place, and is named.
    let refined = at("refined");
    lenslet(&[&common[..], &["--method", "multiview", "--out", text(&refined)]].concat());
    let alone = lenslet(&["infer", text(&refined), "--without-samples", "--out", text(&at("alone"))]);
    assert_eq!(alone["predictor"], "LASSO");
    // A dictionary made for the views of another fit is used, and it is said.
    let of_points = ["--fit", "least-squares"];
    let pointwise = at("pointwise");
    lenslet(&[&common[..], &["--method", "multiview", "--out", text(&pointwise)], &of_points[..]].concat());
    let [to_inferred, to_own, to_fitted] = ["inferred", "own", "fitted"].map(at);
    let inferred = vec!["infer", text(&pointwise), "--out", text(&to_inferred)];
    let own = vec!["infer", text(&refined), "--out", text(&to_own)];
    let fitted = [&learned[..], &["--out", text(&to_fitted)], &of_points[..]].concat();
    for (arguments, other) in [(inferred, true), (own, false), (fitted, true)] {
        let done = run(&arguments);
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        let noted = said.contains("made for views by the fit joint, these are by least-squares");
        assert!(done.status.success() && noted == other, "{arguments:?}: {said}");
    }
    let infer = |more: &[&str]| run(&[&["infer", text(&refined), "--out", text(&at("no"))], more].concat());
    let refusals: [(&[&str], &[&str]); 3] = [
        (
            &["--without-samples", "--path", "network"],
            &["dictionary multiview", "samples", "barycentric, cubic and noise"],
        ),
        (&["--dictionary", "small", "--path", "network"], &["dictionary small", "no network", "LASSO"]),
        (&["--dictionary", "nowhere"], &["nowhere"]),
    ];
    for (more, words) in refusals {
        let refused = infer(more);
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(1), "{more:?}: {said}");
        assert!(words.iter().all(|w| said.contains(w)) && !at("no").exists(), "{more:?}: {said}");
    }
    let refused = run(&[
        &common[..],
        &["--method", "learned", "--dictionary", "small", "--path", "network", "--out", text(&at("no"))],
    ]
    .concat());
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(refused.status.code() == Some(1) && said.contains("small") && said.contains("no network"), "{said}");
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
