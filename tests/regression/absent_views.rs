//! Views that are absent: never taken for black ones, kept absent, and counted aloud.

use std::fs;

use serde_json::json;

use super::bench::Bench;
use super::fields::{aloud, read_npy, save_view, scene, told};

/// A folder `part` of 5 x 5 numbered views without its corners, and `whole` with them.
fn with_and_without(bench: &Bench) {
    let field = scene(5, 32, [0.6, -0.4, 1.1]);
    for k in 0..25 {
        let (v, u) = (k / 5, k % 5);
        let corner = v % 4 == 0 && u % 4 == 0;
        save_view(&field, v, u, &bench.at(&format!("whole/view_{v}_{u}.png")));
        if !corner {
            save_view(&field, v, u, &bench.at(&format!("part/view_{v}_{u}.png")));
        }
    }
}

const LINES: [&str; 3] = ["convert", "refine --scale 1", "infer --fast --scale 1"];

#[test]
fn they_stay_absent_and_are_told() {
    let bench = Bench::new();
    with_and_without(&bench);
    for (k, line) in LINES.into_iter().enumerate() {
        let out = format!("out{k}");
        let answer = aloud(bench.path(), &format!("{line} part --out {out}"));
        assert_eq!(answer.code, Some(0), "{line}: {}", answer.err);
        assert!(answer.err.contains("4 views of 5x5 are missing (row 0, column 0; row 0, column 4;"), "{}", answer.err);
        assert!(answer.out.contains("5x5 views (4 absent)"), "{line}: {}", answer.out);
        assert_eq!(told(bench.path(), &format!("{line} part --out {out} --force"))["absent"], 4, "{line}");
        // Views that are there have their pictures; the others have none, and weight 0.
        let views: Vec<bool> =
            (0..25).map(|k| bench.at(&format!("{out}/view_{:02}_{:02}.png", k / 5, k % 5)).exists()).collect();
        let weights = told(bench.path(), &format!("info {out}"))["weights"].clone();
        for k in 0..25 {
            let corner = k / 5 % 4 == 0 && k % 5 % 4 == 0;
            assert_eq!(views[k], !corner, "{line}: view {k}");
            assert_eq!(weights[k].as_f64().unwrap() > 0.0, !corner, "{line}: {weights}");
        }
        // The result is a light field for the next command, also through an array.
        let again = told(bench.path(), &format!("convert {out} --out again{k}.npy"));
        assert_eq!(again["absent"], 4, "{line}");
        assert_eq!(told(bench.path(), &format!("convert again{k}.npy --out back{k}"))["absent"], 4, "{line}");
        assert!(!bench.at(&format!("back{k}/view_00_00.png")).exists());
        assert_eq!(told(bench.path(), &format!("convert {out} --out again{k}.mat"))["absent"], 4, "{line}");
        assert_eq!(told(bench.path(), &format!("convert again{k}.mat --out mat{k}"))["absent"], 4, "{line}");
        assert_eq!(told(bench.path(), &format!("convert {out} --out again{k}.png"))["absent"], 4, "{line}");
        assert_eq!(told(bench.path(), &format!("convert again{k}.png --out png{k}"))["absent"], 4, "{line}");
        let answer = aloud(bench.path(), &format!("depth {out} --out d{k}"));
        assert!(answer.code == Some(0) && answer.err.contains("4 of 25 views are dark or absent"), "{}", answer.err);
    }
}

/// What is there must not be changed by what is not.
#[test]
fn the_others_are_as_good_as_with_them() {
    let bench = Bench::new();
    with_and_without(&bench);
    for (k, line) in LINES.into_iter().enumerate() {
        bench.done(&format!("{line} whole --out whole{k}.npy"));
        bench.done(&format!("{line} part --out part{k}.npy"));
        let (whole, part) =
            (read_npy(&bench.at(&format!("whole{k}.npy"))), read_npy(&bench.at(&format!("part{k}.npy"))));
        let at = ndarray::s![1..4, 1..4, .., .., ..];
        let off = (&whole.slice(at) - &part.slice(at)).mapv(|x| x * x).mean().unwrap().sqrt();
        // Refinement has fewer views to draw on; the others take each view alone.
        assert!(off < if k == 1 { 0.03 } else { 1e-6 }, "{line}: {off}");
        let score = told(bench.path(), &format!("score part{k}.npy whole{k}.npy"));
        assert_eq!((score["views"].as_array().unwrap().len(), &score["absent"]), (21, &json!(4)), "{line}");
        assert!(score["mean"]["psnr_rgb"].as_f64().is_none_or(|db| db > 30.0), "{line}: {score}");
        let answer = bench.done(&format!("score whole{k}.npy part{k}.npy --align"));
        assert!(
            answer.out.contains("mean of 21 views") && answer.out.contains("4 of 25 views are absent"),
            "{}",
            answer.out
        );
    }
}

#[test]
fn without_the_middle_view_what_starts_from_it_is_refused() {
    let bench = Bench::new();
    with_and_without(&bench);
    fs::remove_file(bench.at("part/view_2_2.png")).unwrap();
    for line in ["refine part --scale 1", "depth part", "refocus part --all-in-focus", "refocus part --at 10,10"] {
        bench.refused(&format!("{line} --out x"), &["part", "row 2, column 2", "absent", "add it"]);
    }
    bench.refused("view part --out x.html", &["part", "row 2, column 2"]);
    bench.refused("viewpoint part --frames 2 --out x", &["part", "row 2, column 2"]);
    for line in ["convert part", "infer part --fast --scale 1", "refocus part --disparity 0"] {
        bench.done(&format!("{line} --out y --force"));
        fs::remove_dir_all(bench.at("y")).unwrap();
    }
    // The nearest view that both have is registered.
    assert_eq!(told(bench.path(), "score part whole --align")["absent"], 5);
    for name in ["part/view_0_1.png", "part/view_0_2.png", "part/view_0_3.png"] {
        fs::remove_file(bench.at(name)).unwrap();
    }
    bench.refused("convert part --crop-views 1 --out z", &["part", "1x1 views are absent"]);
}

/// A view with a weight whose picture is not there was lost; it is not an absent one.
#[test]
fn a_lost_picture_is_no_absent_view() {
    let bench = Bench::new();
    fs::remove_file(bench.at("lf/view_01_01.png")).unwrap();
    fs::remove_file(bench.at("lf/view_02_00.png")).unwrap();
    for line in ["convert lf", "infer lf --fast", "refine lf", "depth lf"] {
        let words =
            ["lightfield.json", "2 of them are not there", "row 1, column 1; row 2, column 0", "copy them again"];
        bench.refused(&format!("{line} --out x"), &words);
    }
    // As it says: the pictures then count by their names.
    for name in ["lf/lightfield.json", "lf/samples.npz"] {
        fs::remove_file(bench.at(name)).unwrap();
    }
    assert_eq!(told(bench.path(), "convert lf --out x")["absent"], 2);
}

#[test]
fn light_fields_without_a_common_view_have_no_score() {
    let bench = Bench::new();
    let field = scene(2, 16, [0.4, -0.3, 0.8]);
    for k in 0..4 {
        let name = if k % 3 == 0 { "a" } else { "b" };
        save_view(&field, k / 2, k % 2, &bench.at(&format!("{name}/view_{}_{}.png", k / 2, k % 2)));
    }
    bench.refused("score a b", &["no view in common"]);
}
