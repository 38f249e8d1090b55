//! Disparities beyond the usual range.

use super::bench::Bench;
use super::fields::{aloud, scene, told};

/// Only ±4 pixels a view step were searched, without a word.
#[test]
fn wide_disparities_are_found_everywhere() {
    let bench = Bench::new();
    ndarray_npy::write_npy(bench.at("wide.npy"), &scene(5, 128, [-9.0, -5.0, 3.0])).unwrap();
    let found = told(bench.path(), "depth wide.npy --out d");
    let (low, high) = (found["smallest"].as_f64().unwrap(), found["largest"].as_f64().unwrap());
    assert!((-10.5..-8.5).contains(&low) && (2.5..5.0).contains(&high), "{low} to {high}");
    // The background and both discs, each at its own disparity.
    let map = lenslet_core::pfm::from_bytes(&bench.bytes("d/disparity.pfm")).unwrap();
    for (x, y, truth) in [(64, 16, -9.0), (40, 79, -5.0), (87, 46, 3.0)] {
        assert!((map[[y, x]] - truth).abs() < 0.3, "at {x},{y}: {} and not {truth}", map[[y, x]]);
    }
    let at = told(bench.path(), "refocus wide.npy --at 64,16 --out a.png");
    assert!((at["disparities"][0].as_f64().unwrap() + 9.0).abs() < 0.3, "{at}");
    // Everything in focus is the middle view again.
    bench.done("refocus wide.npy --all-in-focus --out b.png");
    bench.done("convert wide.npy --crop-views 1 --out middle.lf");
    let score = told(bench.path(), "score b.png middle.lf/view_00_00.png --border 20");
    assert!(score["mean"]["psnr_rgb"].as_f64().unwrap() > 30.0, "{score}");
    bench.done("refine wide.npy --scale 1 --out r.lf");
    bench.done("convert r.lf --crop-views 1 --out refined.lf");
    let score = told(bench.path(), "score refined.lf middle.lf --border 20");
    assert!(score["mean"]["psnr_rgb"].as_f64().unwrap() > 30.0, "{score}");
}

/// Where the range given is too small it is said.
#[test]
fn the_ends_of_a_range_are_said_to_be_hit() {
    let bench = Bench::new();
    ndarray_npy::write_npy(bench.at("field.npy"), &scene(5, 64, [-2.0, 1.0, 1.0])).unwrap();
    for command in ["depth", "refocus --all-in-focus", "view", "viewpoint", "refine"] {
        let out = match command {
            "view" => "x.html",
            "refocus --all-in-focus" => "x.png",
            _ => "x",
        };
        let answer = aloud(bench.path(), &format!("{command} field.npy --range=-1:1.2 --out {out}"));
        assert!(answer.code == Some(0) && answer.err.contains("ends of the range"), "{command}: {}", answer.err);
        let answer = aloud(bench.path(), &format!("{command} field.npy --range=-3:2 --out y{out}"));
        assert!(answer.code == Some(0) && !answer.err.contains("ends of the range"), "{command}: {}", answer.err);
        let _ = std::fs::remove_dir_all(bench.at("x"));
        let _ = std::fs::remove_dir_all(bench.at("yx"));
    }
}
