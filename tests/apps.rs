//! refocus, depth, viewpoint and view as a user runs them, on a small light field of two planes; the page in a real browser.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use ndarray::Array5;

const NEAR: f32 = -1.2;
const FAR: f32 = 0.8;

fn lenslet(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lenslet")).args(arguments).output().unwrap()
}

fn told(arguments: &[&str]) -> serde_json::Value {
    let mut all = vec!["--json", "-q"];
    all.extend(arguments);
    let output = lenslet(&all);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// 5×5 views of 160×120: the left half near, the right half far.
fn field(folder: &Path) -> PathBuf {
    let texture = |x: f32, y: f32| {
        0.5 + 0.14 * (0.7 * x + 0.3 * y).sin() + 0.14 * (0.6 * y - 0.45 * x).cos() + 0.1 * (0.11 * x + 0.27 * y).sin()
    };
    let data = Array5::from_shape_fn((5, 5, 120, 160, 3), |(v, u, t, s, c)| {
        let (du, dv) = (u as f32 - 2.0, v as f32 - 2.0);
        let near = s as f32 - NEAR * du < 80.0;
        let d = if near { NEAR } else { FAR };
        let shift = if near { 0.0 } else { 300.0 };
        texture(s as f32 - d * du + shift, t as f32 - d * dv) * (1.0 - 0.08 * c as f32)
    });
    let path = folder.join("planes.npy");
    ndarray_npy::write_npy(&path, &data).unwrap();
    path
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn pointing_focuses_and_sweeping_makes_a_stack() {
    let folder = tempfile::tempdir().unwrap();
    let field = field(folder.path());
    for (at, truth) in [("30,60", NEAR), ("130,60", FAR)] {
        let out = folder.path().join(format!("at{at}.png"));
        let json = told(&["refocus", text(&field), "--at", at, "--out", text(&out)]);
        let d = json["disparities"][0].as_f64().unwrap() as f32;
        assert!((d - truth).abs() < 0.1, "at {at}: {d}, planted {truth}");
        let picture = image::open(&out).unwrap();
        assert_eq!((picture.width(), picture.height()), (160, 120));
        // What is there stays there.
        let again = lenslet(&["refocus", text(&field), "--at", at, "--out", text(&out)]);
        assert_eq!(again.status.code(), Some(1));
    }
    let stack = folder.path().join("stack");
    told(&["refocus", text(&field), "--sweep=-2:2:5", "--out", text(&stack), "--aperture", "0.8", "--shape", "square"]);
    assert_eq!(std::fs::read_dir(&stack).unwrap().count(), 5);
    let gif = folder.path().join("stack.gif");
    told(&["refocus", text(&field), "--sweep=-2:2:3", "--side", "80", "--out", text(&gif)]);
    assert!(std::fs::read(&gif).unwrap().starts_with(b"GIF89a"));
    let all = folder.path().join("all.png");
    told(&["refocus", text(&field), "--all-in-focus", "--out", text(&all)]);
    assert!(image::open(&all).is_ok());
}

#[test]
fn wrong_usage_is_told_apart_from_failure() {
    let folder = tempfile::tempdir().unwrap();
    let field = field(folder.path());
    let out = folder.path().join("x.png");
    let code = |arguments: &[&str]| {
        let mut all = vec!["refocus", text(&field), "--out", text(&out)];
        all.extend(arguments);
        let output = lenslet(&all);
        assert_eq!(String::from_utf8_lossy(&output.stderr).lines().count(), 1, "{:?}", output);
        output.status.code()
    };
    assert_eq!(code(&[]), Some(2));
    assert_eq!(code(&["--disparity", "1", "--all-in-focus"]), Some(2));
    assert_eq!(code(&["--sweep=0:1:2"]), Some(2));
    assert_eq!(code(&["--sweep=0:1:100000"]), Some(2));
    assert_eq!(code(&["--disparity", "1", "--aperture", "2"]), Some(2));
    assert_eq!(code(&["--at", "999,0"]), Some(1));
    let missing = lenslet(&["depth", text(&folder.path().join("nothing")), "--out", text(&folder.path().join("d"))]);
    assert_eq!(missing.status.code(), Some(1));
    assert!(!out.exists() && !folder.path().join("d").exists());
}

#[test]
fn depth_writes_what_it_says_and_compares_with_the_truth() {
    let folder = tempfile::tempdir().unwrap();
    let field = field(folder.path());
    let truth = folder.path().join("truth.npy");
    let map = ndarray::Array2::from_shape_fn((120, 160), |(_, s)| if s < 80 { NEAR } else { FAR });
    ndarray_npy::write_npy(&truth, &map).unwrap();
    let out = folder.path().join("depth");
    let json = told(&["depth", text(&field), "--truth", text(&truth), "--out", text(&out)]);
    let all = &json["truth"]["all"];
    assert!(all["bad_0.07"].as_f64().unwrap() < 0.1, "{json}");
    assert!(all["median"].as_f64().unwrap() < 0.03, "{json}");
    assert_eq!(json["nearer_is"], "smaller");
    for name in ["disparity.pfm", "confidence.pfm", "disparity.png", "colours.png", "points.ply", "depth.json"] {
        assert!(out.join(name).is_file(), "{name}");
    }
    let back = told(&[
        "depth",
        text(&field),
        "--truth",
        text(&out.join("disparity.pfm")),
        "--out",
        text(&folder.path().join("again")),
    ]);
    assert_eq!(back["truth"]["all"]["mse_x100"].as_f64().unwrap(), 0.0);
}

#[test]
fn the_viewpoint_moves() {
    let folder = tempfile::tempdir().unwrap();
    let field = field(folder.path());
    let out = folder.path().join("frames");
    told(&["viewpoint", text(&field), "--path", "horizontal", "--frames", "4", "--out", text(&out)]);
    let frame = |k: usize| image::open(out.join(format!("frame_{k:03}.png"))).unwrap().to_rgb8().into_raw();
    // Frames 0 and 2 are the middle view, 1 and 3 the two ends.
    assert_eq!(frame(0), frame(2));
    assert_ne!(frame(1), frame(3));
    let far = lenslet(&["viewpoint", text(&field), "--radius", "9", "--out", text(&folder.path().join("y.gif"))]);
    assert_eq!(far.status.code(), Some(2));
}

#[test]
fn the_page_works_in_a_browser() {
    let folder = tempfile::tempdir().unwrap();
    let field = field(folder.path());
    let page = folder.path().join("page.html");
    told(&["view", text(&field), text(&field), "--title", "<two> & planes", "--out", text(&page)]);
    let html = std::fs::read_to_string(&page).unwrap();
    assert!(html.contains("&lt;two&gt; &amp; planes") && !html.contains("<two>"));
    assert!(!html.contains("http://") && !html.contains("https://"));
    let browser = ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"]
        .into_iter()
        .find(|p| Path::new(p).exists());
    let Some(browser) = browser else {
        eprintln!("no Chromium here: the page was only read, not run");
        return;
    };
    for (hash, painter) in [("selftest", "WebGL2"), ("selftest,plain", "canvas")] {
        let profile = folder.path().join(painter);
        let output = Command::new(browser)
            .args(["--headless", "--no-sandbox", "--disable-background-networking", "--no-first-run"])
            .args([
                "--use-angle=swiftshader",
                "--enable-unsafe-swiftshader",
                "--window-size=500,700",
                "--virtual-time-budget=120000",
            ])
            .arg(format!("--user-data-dir={}", profile.display()))
            .arg("--dump-dom")
            .arg(format!("file://{}#{hash}", page.display()))
            .output()
            .unwrap();
        let dom = String::from_utf8_lossy(&output.stdout);
        let found = dom.split("<pre id=\"selftest\">").nth(1).and_then(|t| t.split("</pre>").next());
        let found: serde_json::Value = serde_json::from_str(found.expect("the page wrote no findings")).unwrap();
        assert_eq!(found["problems"].as_array().map(Vec::len), Some(0), "{found}");
        // Where the machine has no WebGL2 at all, the page itself falls back.
        assert!(found["painter"] == painter || found["painter"] == "canvas", "{found}");
        for change in ["refocus_changes", "aperture_changes", "drag_changes", "fallback_changes"] {
            assert!(found[change].as_f64().unwrap() > 0.3, "{change}: {found}");
        }
        assert!(found["drag_moves"].as_f64().unwrap() > 0.5, "{found}");
        for click in found["clicks"].as_array().unwrap() {
            let d = click["disparity"].as_f64().unwrap() as f32;
            assert!((d - NEAR).abs() < 0.15 || (d - FAR).abs() < 0.15, "{found}");
            assert!(click["share"].as_f64().unwrap() > 0.85, "{found}");
        }
        assert!(found["method_changes"].as_f64().unwrap() < 0.2, "the same light field twice: {found}");
    }
}
