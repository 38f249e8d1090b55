//! `demo`: runs from nothing, and what it writes holds what it says.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::process::{Command, Output};

fn lenslet(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lenslet")).arg("-q").args(arguments).output().unwrap()
}

#[test]
fn demo_runs_scores_and_writes_a_page_that_needs_nothing_else() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("demo");
    let arguments = ["--json", "demo", "--size", "200", "--out", out.to_str().unwrap()];
    let output = lenslet(&arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let score = |method: &str| json["methods"][method]["psnr_y"].as_f64().unwrap();
    assert!(score("bicubic") < score("barycentric") && score("barycentric") < score("learned"), "{json}");
    assert!(json["calibration"]["centre_rms"].as_f64().unwrap() < 0.1, "{json}");

    for file in
        ["comparison.png", "pictures/barycentric.png", "pictures/truth.png", "camera.calib", "simulated/capture.lfp"]
    {
        assert!(out.join(file).is_file(), "{file} is missing");
    }
    assert!(std::fs::metadata(out.join("comparison.png")).unwrap().len() < 400_000);
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    for outside in ["http://", "https://", "@import", "<link", "url("] {
        let rest = page.replace("http://www.w3.org/2000/svg", "");
        assert!(!rest.contains(outside), "the page names {outside}");
    }
    for method in json["methods"].as_object().unwrap().keys() {
        assert!(page.contains(method.as_str()), "{method} is missing from the page");
    }
    assert!(page.contains("Content-Security-Policy") && page.contains(&format!("{:.2}", score("bicubic"))));

    // A second run is refused, and replaces the first one when told to.
    let again = lenslet(&arguments);
    assert_eq!(again.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&again.stderr).contains("--force"));
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
}

#[test]
fn a_size_out_of_range_is_wrong_use() {
    let dir = tempfile::tempdir().unwrap();
    for size in ["0", "20", "99999", "x"] {
        let output = lenslet(&["demo", "--size", size, "--out", dir.path().join("demo").to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(2), "{size}");
    }
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}
