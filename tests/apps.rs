//! refocus, depth, viewpoint and view as a user runs them, on a small light field of two planes; the page in a real browser.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use browser::Browser;
use ndarray::Array5;

mod browser;

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
    let pictures = std::fs::read_dir(&stack).unwrap().filter(|e| e.as_ref().unwrap().file_name() != ".lenslet");
    assert_eq!(pictures.count(), 5);
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
        let mut all = vec!["-q", "refocus", text(&field), "--out", text(&out)];
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
    assert!(all["median"].as_f64().unwrap() < 0.04, "{json}");
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
fn animations_hold_their_frames() {
    let folder = tempfile::tempdir().unwrap();
    let field = field(folder.path());
    let out = folder.path().join("around.apng");
    told(&["viewpoint", text(&field), "--frames", "3", "--side", "40", "--out", text(&out)]);
    let reader = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&out).unwrap())).read_info().unwrap();
    assert_eq!(reader.info().animation_control().map(|a| a.num_frames), Some(3));
    assert_eq!((reader.info().width, reader.info().height), (40, 30));
    let stack = folder.path().join("stack.apng");
    told(&["refocus", text(&field), "--sweep=-1:1:2", "--side", "40", "--out", text(&stack)]);
    assert!(std::fs::read(&stack).unwrap().windows(4).any(|w| w == b"acTL"));
}

#[test]
fn a_page_keeps_its_limit_and_its_texts_are_no_markup() {
    let folder = tempfile::tempdir().unwrap();
    let field = field(folder.path());
    let page = folder.path().join("page.html");
    let title = "<img src=x onerror=alert(1)>\"'&</title></script>";
    let json = told(&["view", text(&field), "--title", title, "--max-mb", "0.2", "--out", text(&page)]);
    let html = std::fs::read_to_string(&page).unwrap();
    assert!(html.len() as u64 == json["bytes"].as_u64().unwrap() && html.len() < 200_000);
    assert!(!html.contains("<img") && html.contains("&lt;img src=x onerror=alert(1)&gt;&quot;&#39;&amp;"));
    assert!(html.contains("Content-Security-Policy\" content=\"default-src &#39;none&#39;"));
    assert!(!html.contains("http://") && !html.contains("https://"));
    let small = lenslet(&["view", text(&field), "--max-mb", "0.02", "--force", "--out", text(&page)]);
    assert_eq!(small.status.code(), Some(1), "a page that cannot be that small");
}

/// What tests ask the page for: the picture at rest, how much two differ (mean, 0..255), how sharp one is about a point.
const HELPERS: &str = "
    globalThis.shot = async () => {
      do { state.focus = state.target; state.scale = 1; } while (await painter.finish(state.set) === false);
      return painter.pixels();
    };
    globalThis.unlike = (a, b) => { let n = 0; for (let i = 0; i < a.data.length; i++) n += Math.abs(a.data[i] - b.data[i]); return n / a.data.length * 4 / 3; };
    globalThis.sharp = (p, x, y) => {
      let n = 0;
      for (let j = y - 12; j < y + 12; j++) for (let i = x - 12; i < x + 12; i++) {
        const k = 4 * ((p.flipped ? p.height - 1 - j : j) * p.width + i) + 1;
        n += (p.data[k] - p.data[k + 4]) ** 2;
      }
      return n;
    }; 0";

#[test]
fn the_page_works_in_a_browser() {
    let folder = tempfile::tempdir().unwrap();
    let field = field(folder.path());
    let page = folder.path().join("page.html");
    told(&["view", text(&field), text(&field), "--title", "<two> & planes", "--out", text(&page)]);
    let Some(mut browser) = Browser::start() else { return };
    browser.window(500, 900, false);
    let mut pictures = Vec::new();
    for (hash, painter) in [("webgl", "WebGL2"), ("plain", "canvas")] {
        browser.open(&page, hash);
        browser.wait("document.documentElement.dataset.ready");
        // Where the machine has no WebGL2 at all, the page itself falls back.
        let found = browser.value("painter.name");
        assert!(found == painter || found == "canvas", "{found} instead of {painter}");
        assert_eq!(browser.value("document.title"), "<two> & planes");
        browser.value(HELPERS);
        played(&mut browser);
        pictures.push(browser.value("reset(), state.target = 0.3, shot().then(p => [p.flipped ? 1 : 0, ...p.data])"));
        assert_eq!(browser.value("problems.length"), 0);
        assert_eq!(browser.complaints(), [""; 0]);
    }
    // Both ways sum linear light: the same picture, but for rounding and the border, which views leave at different times.
    let row = |p: &serde_json::Value, t: usize| -> Vec<f64> {
        let t = if p[0] == 1 { 119 - t } else { t };
        (0..160 * 4).map(|k| p[1 + t * 640 + k].as_f64().unwrap()).collect()
    };
    let inner = (10..110).flat_map(|t| (40..600).map(move |k| (t, k)));
    let (mut sum, mut n) = (0.0, 0.0);
    for (t, k) in inner {
        sum += (row(&pictures[0], t)[k] - row(&pictures[1], t)[k]).abs();
        n += 1.0;
    }
    assert!(sum / n < 1.0, "the two ways differ by {} levels in the mean", sum / n);
}

/// Plays with the open page as a user does.
fn played(browser: &mut Browser) {
    let [x, y, w, h] = browser.place("#view");
    let at = |px: f64, py: f64| [x + w * (px / 160.0 - 0.5), y + h * (py / 120.0 - 0.5)];
    // Clicks focus where they fall, and there the picture is sharpest.
    for (px, plane) in [(30.0, NEAR), (130.0, FAR)] {
        let [cx, cy] = at(px, 60.0);
        browser.click(cx, cy);
        browser.wait("state.focus === state.target && painted.still");
        let d = browser.value("state.focus").as_f64().unwrap() as f32;
        assert!((d - plane).abs() < 0.15, "a click on disparity {plane} focused on {d}");
        let share = browser.value(&format!(
            "(async () => {{ const d = state.target, here = sharp(await shot(), {px}, 60); let most = here;
               for (let k = 0; k <= 12; k++) {{ state.target = low + (high - low) * k / 12; most = Math.max(most, sharp(await shot(), {px}, 60)); }}
               state.target = d; await shot(); return here / most; }})()"
        ));
        assert!(share.as_f64().unwrap() > 0.85, "sharpest elsewhere: {share}");
    }
    // Keys: other focus, another picture.
    let changed = |browser: &mut Browser, what: &str, act: &mut dyn FnMut(&mut Browser)| {
        browser.value("shot().then(p => { globalThis.before = p; })");
        act(browser);
        browser.wait("state.focus === state.target && painted.still");
        let off = browser.value("unlike(before, painter.pixels())").as_f64().unwrap();
        assert!(off > 0.3, "{what} changed the picture by {off} levels only");
    };
    changed(browser, "focus by keys", &mut |b| (0..20).for_each(|_| b.key("[")));
    // Dragging moves the viewpoint, arrows as well; what is focused on stays where it is, so the aperture is narrow.
    browser.value("reset(), open(0.2), 0");
    changed(browser, "dragging", &mut |b| b.drag(at(80.0, 60.0), at(110.0, 60.0), 4));
    assert!(browser.value("state.u").as_f64().unwrap() > 0.5);
    changed(browser, "an arrow key", &mut |b| (0..3).for_each(|_| b.key("ArrowLeft")));
    // The wheel and two fingers change the aperture.
    browser.value("reset(), 0");
    let [cx, cy] = at(80.0, 60.0);
    changed(browser, "the wheel", &mut |b| (0..6).for_each(|_| b.wheel(cx, cy, 100.0)));
    let wheel = browser.value("state.aperture").as_f64().unwrap();
    assert!((wheel - 0.7).abs() < 1e-6, "{wheel}");
    browser.touch("touchStart", &[at(60.0, 60.0), at(100.0, 60.0)]);
    browser.touch("touchMove", &[at(55.0, 60.0), at(105.0, 60.0)]);
    browser.touch("touchMove", &[at(70.0, 60.0), at(90.0, 60.0)]);
    browser.touch("touchEnd", &[]);
    let pinched = browser.value("state.aperture").as_f64().unwrap();
    assert!((pinched - 0.7 * 0.4).abs() < 0.05, "pinched to {pinched}");
    // The slider by keyboard.
    browser.value("reset(), document.querySelector('#focus').focus(), 0");
    let start = browser.value("state.target").as_f64().unwrap();
    (0..5).for_each(|_| browser.key("ArrowRight"));
    assert!(browser.value("state.target").as_f64().unwrap() > start);
    browser.value("document.activeElement.blur(), 0");
    // Depth over the picture, the epipolar image of the row under the pointer, the other method, and back.
    browser.key("d");
    assert_eq!(browser.value("document.querySelector('#depth').hidden"), false);
    browser.key("d");
    browser.key("e");
    let strip = "document.querySelector('#epi').getContext('2d').getImageData(0, 0, 160, 5).data.join()";
    browser.mouse("mouseMoved", cx, at(0.0, 20.0)[1], false);
    browser.wait(&format!("new Set({strip}.split(',')).size > 20"));
    let one = browser.value(strip);
    browser.mouse("mouseMoved", cx, at(0.0, 90.0)[1], false);
    browser.wait(&format!("{strip} !== {one}"));
    browser.key("e");
    browser.key("m");
    let pressed = "[...document.querySelectorAll('#methods button')].map(b => b.getAttribute('aria-pressed')).join()";
    browser.wait(&format!("state.set === 1 && {pressed} === 'false,true' && painted.still"));
    browser.key("0");
    assert_eq!(browser.value("state.aperture"), 1);
}
