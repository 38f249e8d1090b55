//! `demo`: runs from nothing, and what it writes holds what it says.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::path::Path;
use std::process::{Command, Output};

use browser::Browser;

mod browser;

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
    // (better, worse, least margin in dB): half of the margins of this very run.
    let least = [
        ("barycentric", "bicubic", 0.33),
        ("LASSO", "cubic", 0.22),
        ("LASSO", "no codes", 0.11),
        ("LASSO", "ridge", 0.12),
        ("network", "no codes", 0.07),
        ("multiview", "cubic", 0.81),
        ("LASSO on multiview", "no codes on multiview", 0.01),
        ("network on multiview", "no codes on multiview", 0.3),
        ("network on multiview", "multiview", 0.32),
    ];
    for (better, worse, least) in least {
        println!("{better} over {worse}: {:+.2}, least {least}", score(better) - score(worse));
    }
    for (better, worse, least) in least {
        assert!(score(better) > score(worse) + least, "{better} is not over {worse} by {least}: {json}");
    }
    // Each says what made it, the names of earlier versions too.
    for (name, predictor) in [("learned", "LASSO"), ("learned on multiview", "network"), ("ridge", "ridge")] {
        assert_eq!(json["methods"][name]["predictor"], predictor);
    }
    assert_eq!(json["methods"]["learned"]["psnr_y"], json["methods"]["LASSO"]["psnr_y"]);
    assert!(json["calibration"]["centre_rms"].as_f64().unwrap() < 0.1, "{json}");

    for file in [
        "viewer.html",
        "refocus.png",
        "comparison.png",
        "pictures/barycentric.png",
        "pictures/truth.png",
        "camera.calib",
        "simulated/capture.lfp",
    ] {
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

    in_a_browser(&out);

    // A second run is refused, and replaces the first one when told to.
    let again = lenslet(&arguments);
    assert_eq!(again.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&again.stderr).contains("--force"));
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
}

/// The page by mouse and keyboard, wide and narrow, light and dark.
fn in_a_browser(out: &Path) {
    let Some(mut browser) = Browser::start() else { return };
    browser.window(1280, 900, false);
    browser.open(&out.join("report.html"), "");
    browser.wait("document.querySelector('.compare.live')");
    // Dragging moves the border between the two pictures.
    let [x, y, w, _] = browser.place(".compare .frame");
    browser.drag([x, y], [x + 0.3 * w, y], 4);
    let cut = |browser: &mut Browser| {
        let text = browser.value("document.querySelector('.compare .frame').style.getPropertyValue('--cut')");
        text.as_str().unwrap().trim_end_matches('%').parse::<f64>().unwrap()
    };
    let dragged = cut(&mut browser);
    assert!((dragged - 80.0).abs() < 1.0, "dragged to {dragged} %");
    // The slider by keyboard.
    browser.value("document.querySelector('.compare input').focus(), 0");
    (0..4).for_each(|_| browser.key("ArrowLeft"));
    assert!(cut(&mut browser) < dragged);
    // Arrow keys on the picture move the piece that is enlarged below.
    let spot = "document.querySelector('.compare .spot').style.left";
    let piece = "document.querySelector('.compare .loupe canvas').toDataURL()";
    let before = (browser.value(spot), browser.value(piece));
    browser.value("document.querySelector('.compare .frame').focus(), 0");
    (0..8).for_each(|_| browser.key("ArrowRight"));
    assert!(browser.value(spot) != before.0 && browser.value(piece) != before.1);
    // Any other method at the left.
    browser.value(
        "{ const s = document.querySelector('.compare select'); s.value = 2; s.dispatchEvent(new Event('change')); }",
    );
    assert_eq!(browser.value("document.querySelector('.compare .name.left').textContent"), "cubic");
    let mut papers = std::collections::HashSet::new();
    for (width, dark) in [(1280, false), (1280, true), (400, false), (400, true)] {
        for page in ["report.html", "viewer.html"] {
            browser.window(width, 900, dark);
            browser.open(&out.join(page), "");
            let wide = browser.value("document.documentElement.scrollWidth").as_u64().unwrap();
            assert!(wide <= u64::from(width), "{page} is {wide} pixels wide in a window of {width}");
            papers.insert(browser.value("getComputedStyle(document.body).backgroundColor").to_string());
        }
    }
    assert_eq!(papers.len(), 2, "one paper for light, one for dark, the same on both pages: {papers:?}");
    browser.wait("document.documentElement.dataset.ready");
    assert_eq!(browser.complaints(), [""; 0]);
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
