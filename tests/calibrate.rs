//! `lenslet calibrate` as a user calls it.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

mod fixtures;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use assert_cmd::Command;
use fixtures::{f01_capture, real};
use lenslet_core::calibration;
use lenslet_core::container::{Capture, write_lfp};
use lenslet_core::geometry::Size;
use lenslet_data_gen::simulate::{Camera, LensletGrid, Lenslets, expose_white, record_mosaic, white_pattern};
use serde_json::Value;

fn lenslet(args: &[&str]) -> Output {
    Command::cargo_bin("lenslet").unwrap().args(args).output().unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Exit code `code`, nothing on stdout; the last line of stderr.
fn refused(args: &[&str], code: i32) -> String {
    let out = lenslet(args);
    let all = String::from_utf8(out.stderr).unwrap();
    assert_eq!((out.status.code(), out.stdout.len()), (Some(code), 0), "{all}");
    let lines: Vec<&str> = all.lines().filter(|l| l.starts_with("lenslet:")).collect();
    assert!(code == 2 || lines.len() == 1, "{all}");
    all
}

fn json(args: &[&str]) -> Value {
    let out = lenslet(args);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

fn camera() -> Camera {
    let lenslets = LensletGrid { pitch: 10.2, rotation: -0.02, jitter: 0.05, ..LensletGrid::default() };
    Camera { sensor: Size::new(400, 400), lenslets, ..Camera::default() }
}

/// White images of one simulated camera, with zoom and focus as given, and the true centres.
fn whites(count: u32, serial: &str, zoom: i64) -> (Vec<Capture>, Vec<[f64; 2]>) {
    let camera = camera();
    let lenslets = Lenslets::new(&camera, 3).unwrap();
    let light = expose_white(&camera, &white_pattern(&camera, &lenslets));
    let one = |k| {
        let mosaic = record_mosaic(&light, &camera, 0.7, 3, k);
        f01_capture(mosaic.width, mosaic.height, mosaic.data, Some(serial), Some(zoom), Some(7))
    };
    ((1..=count).map(one).collect(), lenslets.centres_on_sensor())
}

fn written(dir: &Path, name: &str, capture: &Capture) -> PathBuf {
    let path = dir.join(name);
    write_lfp(&path, capture, false).unwrap();
    path
}

#[test]
fn white_images_become_a_calibration_with_the_true_centres() {
    let dir = tempfile::tempdir().unwrap();
    let (captures, truth) = whites(2, "A1", 5);
    let paths: Vec<PathBuf> =
        captures.iter().enumerate().map(|(k, c)| written(dir.path(), &format!("white-{k:02}.lfp"), c)).collect();
    let out = dir.path().join("cam.calib");
    let args = ["calibrate", "-q", "--json", text(&paths[0]), text(&paths[1]), "--out", text(&out)];
    let said = json(&args);
    assert!((said["pitch"].as_f64().unwrap() - 10.2).abs() < 0.005);
    assert!((said["rotation"].as_f64().unwrap() + 0.02).abs() < 5e-4);
    assert_eq!(said["origin"]["serial"], "A1");
    assert_eq!(said["origin"]["sources"].as_array().unwrap().len(), 2);

    let read = calibration::load(&out).unwrap();
    assert_eq!(read.lenslets.len() as u64, said["count"].as_u64().unwrap());
    let (mut sum, mut n) = (0.0, 0.0);
    for c in truth.iter().filter(|c| c.iter().all(|v| (20.0..380.0).contains(v))) {
        let nearest = read.lenslets.iter().map(|l| (l.x - c[0]).hypot(l.y - c[1])).fold(f64::INFINITY, f64::min);
        sum += nearest * nearest;
        n += 1.0;
    }
    let rms = f64::sqrt(sum / n);
    assert!(n > 1000.0 && rms < 0.03, "{rms} over {n}");

    assert!(refused(&args, 1).contains("--force"));
    // `info` says the same of the file, figures of quality among them.
    let told = json(&["info", "--json", text(&out)]);
    for key in ["scatter", "noise", "rejected", "confidence", "residual_rms", "pitch", "count"] {
        assert!(told[key].is_number() && told[key] == said[key], "{key}: {told}");
    }
    let printed = String::from_utf8(lenslet(&["info", text(&out)]).stdout).unwrap();
    for word in ["scatter:", "noise:", "rejected:", "confidence:"] {
        assert!(printed.contains(word), "{printed}");
    }
    // Two bytes a pixel and 28 a lenslet it would be, plainly written.
    let plain = 400 * 400 * 2 + read.lenslets.len() as u64 * 28;
    assert!(fs::metadata(&out).unwrap().len() < plain * 6 / 10);
}

#[test]
fn pictures_and_figures_are_written_whole_or_refused() {
    let dir = tempfile::tempdir().unwrap();
    let white = written(dir.path(), "white.lfp", &whites(1, "A1", 5).0[0]);
    let (out, picture, dump) = (dir.path().join("a.calib"), dir.path().join("p.png"), dir.path().join("figures"));
    let args =
        ["calibrate", "-q", text(&white), "--out", text(&out), "--picture", text(&picture), "--dump", text(&dump)];
    assert!(lenslet(&args).status.success());
    for name in ["p.png", "p-close.png", "p-residuals.png"] {
        assert!(image::open(dir.path().join(name)).unwrap().width() >= 70, "{name}");
    }
    // Ten figures, and the list of them.
    assert_eq!(fs::read_dir(&dump).unwrap().count(), 11);
    assert!(dump.join(".lenslet").exists());
    assert_eq!(image::open(&picture).unwrap().width(), 400);
    // Each output that exists is found before any work is done.
    fs::remove_file(&out).unwrap();
    assert!(refused(&args, 1).contains("p.png"));
    assert!(!out.exists());
}

#[test]
fn captures_alone_give_a_calibration() {
    let dir = tempfile::tempdir().unwrap();
    let (captures, _) = whites(3, "A1", 5);
    let mut args = vec!["calibrate".to_string(), "-q".into(), "--json".into()];
    args.push("--out".into());
    args.push(text(&dir.path().join("c.calib")).into());
    args.push("--from-captures".into());
    for (k, mut c) in captures.into_iter().enumerate() {
        for (n, v) in c.mosaic.data.iter_mut().enumerate() {
            let (x, y) = ((n % 400) as f64, (n / 400) as f64);
            let scene = 0.5 + 0.35 * ((x + 40.0 * k as f64) / 55.0).sin() * (y / 47.0 + k as f64).cos();
            *v = (168.0 + (f64::from(*v) - 168.0) * scene) as u16;
        }
        args.push(text(&written(dir.path(), &format!("{k}.lfp"), &c)).into());
    }
    let said = json(&args.iter().map(String::as_str).collect::<Vec<_>>());
    assert!((said["pitch"].as_f64().unwrap() - 10.2).abs() < 0.005, "{said}");
    assert_eq!(said["origin"]["method"], "captures");
    assert!(calibration::load(&dir.path().join("c.calib")).unwrap().vignetting.is_some());
}

/// Hot pixels, and a black image that shows them.
fn black(white: &Capture) -> (Vec<u32>, Capture) {
    let hot: Vec<u32> = (0..400u32 * 400).filter(|k| k % 3001 == 17).collect();
    let mut black = white.clone();
    black.mosaic.data = (0..400 * 400).map(|k: u32| 166 + (k * 7919 % 5) as u16).collect();
    hot.iter().for_each(|&k| black.mosaic.data[k as usize] = 900);
    (hot, black)
}

#[test]
fn black_images_give_the_hot_pixels_to_leave_out() {
    let dir = tempfile::tempdir().unwrap();
    let mut white = whites(1, "A1", 5).0.remove(0);
    let (hot, black) = black(&white);
    hot.iter().for_each(|&k| white.mosaic.data[k as usize] = 4095);
    let (white_file, black_file) = (written(dir.path(), "w.lfp", &white), written(dir.path(), "MOD_0000.lfp", &black));
    let out = dir.path().join("cam.calib");
    let args = ["calibrate", "--json", text(&white_file), "--black", text(&black_file), "--out", text(&out)];
    assert_eq!(json(&args)["hot_pixels"], hot.len());
    assert_eq!(calibration::load(&out).unwrap().hot_pixels, hot);
    // A white image is no black one, and one of another camera tells nothing of this.
    let other = dir.path().join("x.calib");
    let args = |black: &str| {
        ["calibrate", "-q", text(&white_file), "--black", black, "--out", text(&other)].map(str::to_string)
    };
    let line = |black: &Path| refused(&args(text(black)).iter().map(String::as_str).collect::<Vec<_>>(), 1);
    assert!(line(&white_file).contains("not black"));
    let mut strange = black.clone();
    strange.camera.serial = Some("B2".into());
    assert!(line(&written(dir.path(), "b2.lfp", &strange)).contains("not of the camera"));
    // A folder's own black images are found.
    let place = dir.path().join("folder");
    fs::create_dir(&place).unwrap();
    written(&place, "MOD_0000.lfp", &black);
    written(&place, "MOD_0001.lfp", &black);
    written(&place, "MOD_0002.lfp", &white);
    let out = dir.path().join("calibrations");
    let said = json(&["calibrate", "-q", "--json", "--bundle", text(&place), "--out", text(&out)]);
    assert_eq!(said["calibrations"][0]["hot_pixels"], hot.len(), "{said}");
}

#[test]
fn one_bad_file_does_not_cost_the_others() {
    let dir = tempfile::tempdir().unwrap();
    let (captures, _) = whites(3, "A1", 5);
    let mut files: Vec<PathBuf> =
        captures.iter().enumerate().map(|(k, c)| written(dir.path(), &format!("{k}.lfp"), c)).collect();
    let broken = dir.path().join("broken.lfp");
    fs::write(&broken, b"hello").unwrap();
    let dark = written(dir.path(), "dark.lfp", &black(&captures[0]).1);
    files.extend([broken.clone(), dark.clone()]);
    for (kind, name) in [(None, "whites"), (Some("--from-captures"), "captures")] {
        let out = dir.path().join(format!("{name}.calib"));
        let mut args = vec!["calibrate", "--json", "--out", text(&out)];
        args.extend(kind);
        args.extend(files.iter().map(|f| text(f)));
        let done = lenslet(&args);
        let notes = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.success(), "{notes}");
        let said: Value = serde_json::from_slice(&done.stdout).unwrap();
        assert_eq!(said["origin"]["sources"].as_array().unwrap().len(), 3, "{notes}");
        for left in ["broken.lfp", "dark.lfp"] {
            assert!(notes.lines().any(|l| l.contains(left) && l.contains("left out")), "{notes}");
        }
        // None usable: one line.
        let mut args = vec!["calibrate", "-q", "--out", "never.calib"];
        args.extend(kind);
        args.extend([text(&dark), text(&broken)]);
        assert!(refused(&args, 1).contains("black"));
    }
}

#[test]
fn a_size_that_does_not_fit_the_camera_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let mut white = whites(1, "A1", 5).0.remove(0);
    (white.mosaic.width, white.mosaic.height) = (40, 4000);
    let tall = written(dir.path(), "tall.lfp", &white);
    let out = dir.path().join("x.calib");
    let line = refused(&["calibrate", "-q", text(&tall), "--profile", "lytro-f01", "--out", text(&out)], 1);
    assert!(line.contains("tall.lfp") && line.contains("40x4000") && line.contains("3280x3280"), "{line}");
    assert!(!out.exists());
}

#[test]
fn a_bundle_gives_one_calibration_a_zoom() {
    let dir = tempfile::tempdir().unwrap();
    let place = dir.path().join("whites");
    fs::create_dir(&place).unwrap();
    for (zoom, count) in [(5, 2), (900, 1)] {
        for (k, c) in whites(count, "A1/..", zoom).0.iter().enumerate() {
            written(&place, &format!("white-{zoom}-{k}.lfp"), c);
        }
    }
    let out = dir.path().join("calibrations");
    let said = json(&["calibrate", "-q", "--json", "--bundle", text(&place), "--out", text(&out)]);
    let mut names: Vec<&str> =
        said["calibrations"].as_array().unwrap().iter().map(|c| c["file"].as_str().unwrap()).collect();
    names.sort_unstable();
    assert_eq!(names, ["A1-zoom5-focus7.calib", "A1-zoom900-focus7.calib"]);
    for name in names {
        assert_eq!(calibration::load(&out.join(name)).unwrap().origin.serial.as_deref(), Some("A1/.."));
    }
    let empty = dir.path().join("empty");
    fs::create_dir(&empty).unwrap();
    assert!(
        refused(&["calibrate", "--bundle", text(&empty), "--out", text(&dir.path().join("x"))], 1)
            .contains("give one with white images")
    );
    assert!(!dir.path().join("x").exists());
}

#[test]
fn wrong_input_ends_in_one_line_and_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("x.calib");
    let file = |name: &str, bytes: &[u8]| {
        let path = dir.path().join(name);
        fs::write(&path, bytes).unwrap();
        path
    };
    // Grey blobs: a photograph of one channel.
    let photo = dir.path().join("photo.png");
    image::GrayImage::from_fn(300, 260, |x, y| {
        let v = 90.0 + 60.0 * (f64::from(x) / 31.0).sin() + 50.0 * (f64::from(x * y) / 9000.0).cos();
        image::Luma([v as u8 + (x * 7919 + y * 104_729) as u8 % 9])
    })
    .save(&photo)
    .unwrap();
    assert!(refused(&["calibrate", "-q", text(&photo), "--out", text(&out)], 1).contains("no lenslet pattern"));
    let black = dir.path().join("black.png");
    image::GrayImage::from_pixel(128, 128, image::Luma([10])).save(&black).unwrap();
    assert!(refused(&["calibrate", "-q", text(&black), "--out", text(&out)], 1).contains("black"));
    let bright = dir.path().join("bright.png");
    image::GrayImage::from_pixel(128, 128, image::Luma([255])).save(&bright).unwrap();
    assert!(refused(&["calibrate", "-q", text(&bright), "--out", text(&out)], 1).contains("saturated"));
    for path in [file("text.lfp", b"hello"), file("empty.lfp", b""), dir.path().join("missing.lfp")] {
        assert!(refused(&["calibrate", "-q", text(&path), "--out", text(&out)], 1).contains(text(&path)));
    }
    let mut other = whites(1, "B2", 5).0.remove(0);
    let first = written(dir.path(), "w1.lfp", &whites(1, "A1", 5).0[0]);
    let second = written(dir.path(), "w2.lfp", &other);
    let line = refused(&["calibrate", "-q", text(&first), text(&second), "--out", text(&out)], 1);
    assert!(line.contains("w2.lfp") && line.contains("B2"), "{line}");
    other.mosaic.width = 200;
    other.mosaic.height = 800;
    let third = written(dir.path(), "w3.lfp", &other);
    assert!(refused(&["calibrate", "-q", text(&first), text(&third), "--out", text(&out)], 1).contains("200x800"));
    refused(&["calibrate", "--out", text(&out)], 2);
    refused(&["calibrate", text(&first), "--variant", "best", "--out", text(&out)], 2);
    assert!(!out.exists());
    assert!(fs::read_dir(dir.path()).unwrap().all(|e| !e.unwrap().file_name().to_string_lossy().contains("tmp")));
}

#[test]
fn a_real_camera_has_the_lattice_it_has() {
    let dir = tempfile::tempdir().unwrap();
    let Some(white) = lenslet_test_support::data("f01/pseudo_white_8bit.png") else { return };
    let out = dir.path().join("f01.calib");
    let said = json(&["calibrate", "-q", "--json", text(&white), "--out", text(&out)]);
    let of = |name: &str| said[name].as_f64().unwrap();
    assert!((9.92..=9.94).contains(&of("pitch")), "{said}");
    assert!((-0.288..=-0.276).contains(&of("rotation").to_degrees()), "{said}");
    assert!((1.0..=1.001).contains(&of("row_stretch")) && of("count") >= 110_000.0, "{said}");
}

#[test]
fn a_real_white_image_has_its_centres_where_they_were_labelled() {
    let dir = tempfile::tempdir().unwrap();
    let (white, labels) = (real("f01-white-crop/white.png"), real("f01-white-crop/centres.csv"));
    let out = dir.path().join("crop.calib");
    json(&["calibrate", "-q", "--json", text(&white), "--out", text(&out)]);
    let found = calibration::load(&out).unwrap();
    let (mut sum, mut n) = (0.0, 0.0);
    for line in fs::read_to_string(labels).unwrap().lines() {
        let Some((x, y)) =
            line.split_once(',').and_then(|(x, y)| Some((x.parse::<f64>().ok()?, y.parse::<f64>().ok()?)))
        else {
            continue;
        };
        // Labels are in pixel edges: the first pixel's middle is 0.5.
        let near = found.lenslets.iter().map(|l| (l.x - x + 0.5).hypot(l.y - y + 0.5)).fold(f64::INFINITY, f64::min);
        sum += near * near;
        n += 1.0;
    }
    let rms = f64::sqrt(sum / n);
    assert!(n == 288.0 && rms < 0.3, "{rms} over {n}");
}
