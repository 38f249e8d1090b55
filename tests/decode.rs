//! `lenslet decode` as a whole: one capture, several, a folder, bad ones among them, and what is left behind.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

mod fixtures;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use fixtures::f01_capture;
use lenslet_core::calibration::{self, Calibration, Vignetting};
use lenslet_core::container;
use lenslet_core::decode::{HexSamples, SAMPLES_FILE};
use lenslet_core::geometry::{Lattice, Size};
use lenslet_core::lightfield::{self, ReadOptions, ViewOrigin};

const SIDE: usize = 120;

/// A capture of a grey ramp and the calibration that fits it, both as files.
fn camera(dir: &Path) -> (PathBuf, PathBuf) {
    let lattice = Lattice::hexagonal(10.0, 0.003, 1.0, [60.2, 59.7]);
    let pixels = || (0..SIDE * SIDE).map(|k| (k % SIDE, k / SIDE));
    let ramp = pixels().map(|(x, _)| 600 + 20 * x as u16).collect();
    let capture = f01_capture(SIDE, SIDE, ramp, Some("A000000001"), Some(900), None);
    let lfp = dir.join("ramp.lfp");
    container::write_lfp(&lfp, &capture, false).unwrap();
    let mut camera = Calibration::of_lattice(lattice, Size::new(SIDE, SIDE));
    camera.vignetting = Some(Vignetting { width: SIDE, height: SIDE, white: vec![32768; SIDE * SIDE] });
    camera.origin.serial = Some("A000000001".into());
    camera.origin.zoom_step = Some(700);
    let calib = dir.join("near.calib");
    calibration::save(&calib, &camera, false).unwrap();
    (lfp, calib)
}

fn run(args: &[&Path]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lenslet")).arg("decode").args(args).output().unwrap()
}

macro_rules! decode {
    ($($arg:expr),* $(,)?) => { run(&[$(Path::new(&$arg)),*]) };
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn one_capture_to_a_folder_of_views_with_its_samples() {
    let dir = tempfile::tempdir().unwrap();
    let (lfp, calib) = camera(dir.path());
    let out = dir.path().join("lf");
    let done = decode!(
        lfp,
        "--calibration",
        calib,
        "--out",
        out,
        "--size",
        "60",
        "--method",
        "barycentric",
        "--linear",
        "--json"
    );
    assert!(done.status.success(), "{}", said(&done));
    let report: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(report["views"], serde_json::json!([7, 7]));
    let field = lightfield::load(&out, &ReadOptions::default()).unwrap();
    assert_eq!(field.data.dim(), (7, 7, 60, 60, 3));
    assert_eq!(field.meta.method.as_ref().map(ViewOrigin::name), Some("barycentric"));
    // The ramp: output pixel s looks at sensor x = 2s + 1/2.
    for s in 10..50 {
        let truth = (600.0 + 20.0 * (2.0 * s as f32 + 0.5) - 168.0) / (4095.0 - 168.0);
        for c in 0..3 {
            let got = field.data[[3, 3, 30, s, c]];
            assert!((got - truth).abs() < 0.006, "column {s}: {got} for {truth}");
        }
    }
    let samples = HexSamples::load(&out.join(SAMPLES_FILE)).unwrap();
    assert_eq!((samples.sensor, samples.views), (Size::new(SIDE, SIDE), 7));
    assert_eq!(report["lenslets"], samples.centres.len());
    // Not twice, unless told; and nothing is left beside it.
    let again = decode!(lfp, "--calibration", calib, "--out", out, "--size", "60");
    assert_eq!(again.status.code(), Some(1));
    assert!(said(&again).contains("--force"));
    let forced = decode!(lfp, "--calibration", calib, "--out", out, "--size", "48x40", "--force", "--no-samples", "-q");
    assert!(forced.status.success(), "{}", said(&forced));
    assert!(said(&forced).is_empty());
    assert!(!out.join(SAMPLES_FILE).exists());
    let names: Vec<_> = std::fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(names.len(), 3, "{names:?}");
}

#[test]
fn one_file_formats_and_native_size_and_threads() {
    let dir = tempfile::tempdir().unwrap();
    let (lfp, calib) = camera(dir.path());
    let out = dir.path().join("lf.npy");
    let done = decode!(lfp, "--calibration", calib, "--out", out, "--size", "native", "--npy", "--threads", "1");
    assert!(done.status.success(), "{}", said(&done));
    let field = lightfield::load(&out, &ReadOptions::default()).unwrap();
    assert_eq!(field.data.dim(), (7, 7, 12, 12, 3));
    assert!(HexSamples::load(&dir.path().join("lf.npy.samples.npz")).is_ok());
    let other = dir.path().join("other.npy");
    let done = decode!(lfp, "--calibration", calib, "--out", other, "--size", "native", "--npy", "--threads", "3");
    assert!(done.status.success(), "{}", said(&done));
    assert_eq!(std::fs::read(&out).unwrap(), std::fs::read(&other).unwrap());
}

#[test]
fn several_captures_one_of_them_bad() {
    let dir = tempfile::tempdir().unwrap();
    let (lfp, calib) = camera(dir.path());
    let shots = dir.path().join("shots");
    std::fs::create_dir(&shots).unwrap();
    std::fs::copy(&lfp, shots.join("a.lfp")).unwrap();
    std::fs::write(shots.join("b.lfp"), b"not a capture").unwrap();
    std::fs::copy(&lfp, shots.join("c.lfp")).unwrap();
    let out = dir.path().join("fields");
    let first = decode!(shots, "--calibration", calib, "--out", out, "--size", "24", "--views", "3");
    assert_eq!(first.status.code(), Some(1));
    let words = said(&first);
    assert!(words.contains("2 decoded, 0 there already, 1 failed") && words.contains("b.lfp"), "{words}");
    assert!(out.join("a").is_dir() && out.join("c").is_dir() && !out.join("b").exists());
    std::fs::remove_file(shots.join("b.lfp")).unwrap();
    let second = decode!(shots, "--calibration", calib, "--out", out, "--size", "24", "--views", "3");
    assert!(second.status.success(), "{}", said(&second));
    assert!(String::from_utf8_lossy(&second.stdout).contains("0 decoded, 2 there already"));
}

#[test]
fn the_calibration_is_chosen_with_its_reason() {
    let dir = tempfile::tempdir().unwrap();
    let (lfp, calib) = camera(dir.path());
    let shelf = dir.path().join("shelf");
    std::fs::create_dir(&shelf).unwrap();
    let mut other = calibration::load(&calib).unwrap();
    other.origin.zoom_step = Some(100);
    calibration::save(&shelf.join("far.calib"), &other, false).unwrap();
    std::fs::copy(&calib, shelf.join("near.calib")).unwrap();
    std::fs::write(shelf.join("broken.calib"), b"no").unwrap();
    let out = dir.path().join("lf");
    let done = decode!(lfp, "--calibration", shelf, "--out", out, "--size", "24", "--views", "1");
    let words = said(&done);
    assert!(done.status.success(), "{words}");
    assert!(words.contains("near.calib") && words.contains("nearest zoom 700 to 900"), "{words}");
    assert!(words.contains("broken.calib"), "{words}");
    // None of this camera: what was looked for, and what was there.
    let empty = dir.path().join("strangers");
    std::fs::create_dir(&empty).unwrap();
    for serial in ["A7", "A8"] {
        other.origin.serial = Some(serial.into());
        calibration::save(&empty.join(format!("{serial}.calib")), &other, false).unwrap();
    }
    let none = decode!(lfp, "--calibration", empty, "--out", dir.path().join("no"), "--size", "24");
    let words = said(&none);
    assert_eq!(none.status.code(), Some(1));
    assert!(words.contains("A000000001") && words.contains("A7") && words.lines().count() == 1, "{words}");
}

#[test]
fn a_calibration_of_another_camera_is_refused_with_the_reason() {
    let dir = tempfile::tempdir().unwrap();
    let (lfp, calib) = camera(dir.path());
    let own = calibration::load(&calib).unwrap();
    let out = dir.path().join("lf");
    let of = |change: &dyn Fn(&mut Calibration)| {
        let mut other = own.clone();
        change(&mut other);
        let path = dir.path().join("other.calib");
        calibration::save(&path, &other, true).unwrap();
        let done = decode!(lfp, "--calibration", path, "--out", out, "--size", "24", "--views", "1");
        let words = said(&done);
        assert!(
            done.status.code() == Some(1) && words.lines().count() == 1 && words.contains("other.calib"),
            "{words}"
        );
        words
    };
    let serial = of(&|c| c.origin.serial = Some("A7".into()));
    assert!(serial.contains("camera A7") && serial.contains("A000000001"), "{serial}");
    let model = of(&|c| c.origin.model = Some("ILLUM".into()));
    assert!(model.contains("ILLUM") && model.contains("F01"), "{model}");
    let size = of(&|c| {
        (c.width, c.vignetting) = (SIDE + 2, None);
    });
    assert!(size.contains("122x120") && size.contains("120x120"), "{size}");
    assert!(!out.exists());
    // Its own, of another zoom: decoded, and said.
    let done = decode!(lfp, "--calibration", calib, "--out", out, "--size", "24", "--views", "1");
    assert!(
        done.status.success() && said(&done).contains("zoom step 700, the capture taken at 900"),
        "{}",
        said(&done)
    );
}

#[test]
fn wrong_usage_is_exit_code_two_and_failures_are_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let (lfp, calib) = camera(dir.path());
    let out = dir.path().join("lf");
    for bad in [
        ["--views", "4"],
        ["--view-step", "0"],
        ["--size", "0"],
        ["--method", "magic"],
        ["--base", "cubic"],
        ["--white-balance", "0,1,1"],
        ["--without", "sense"],
        ["--exposure", "99"],
    ] {
        let done = decode!(lfp, "--calibration", calib, "--out", out, bad[0], bad[1]);
        assert_eq!(done.status.code(), Some(2), "{bad:?}: {}", said(&done));
    }
    let done = decode!(lfp, "--out", out);
    assert_eq!(done.status.code(), Some(2), "{}", said(&done));
    let missing = dir.path().join("missing.lfp");
    let text = dir.path().join("text.lfp");
    std::fs::write(&text, "hello").unwrap();
    for capture in [missing, text] {
        let done = decode!(capture, "--calibration", calib, "--out", out);
        assert_eq!(done.status.code(), Some(1));
        assert!(said(&done).lines().count() == 1 && said(&done).contains(".lfp"), "{}", said(&done));
    }
    assert!(!out.exists());
}

#[test]
fn mosaics_in_pictures_and_raw_files_decode_like_the_container() {
    let dir = tempfile::tempdir().unwrap();
    let (lfp, calib) = camera(dir.path());
    let capture = container::open_capture(&lfp, None).unwrap();
    let decoded = |path: &Path, more: &[&str]| {
        let out = PathBuf::from(format!("{}.npy", path.display()));
        let mut words = vec![path, Path::new("--calibration"), &calib, Path::new("--out"), &out];
        words.extend(
            ["--size", "40", "--views", "3", "--method", "cubic", "-q", "--white-balance", "1,1,1"].map(Path::new),
        );
        words.extend(["--without", "colour-matrix", "--without", "exposure-bias"].map(Path::new));
        words.extend(more.iter().map(Path::new));
        let done = run(&words);
        assert!(done.status.success(), "{}: {}", path.display(), said(&done));
        lightfield::load(&out, &ReadOptions::default()).unwrap().data
    };
    let truth = decoded(&lfp, &[]);
    let profile = ["--profile", "lytro-f01"];
    let side = SIDE as u32;
    let sixteen = |x: u32, y: u32| capture.mosaic.data[(y * side + x) as usize];
    let deep = image::ImageBuffer::from_fn(side, side, |x, y| image::Luma([sixteen(x, y)]));
    let eight = image::GrayImage::from_fn(side, side, |x, y| image::Luma([(sixteen(x, y) / 16) as u8]));
    let path = |name: &str| dir.path().join(name);
    for name in ["deep.png", "deep.tif"] {
        deep.save(path(name)).unwrap();
        let got = decoded(&path(name), &profile);
        assert_eq!(got, truth, "{name}");
    }
    for name in ["eight.png", "eight.tif", "eight.jpg"] {
        eight.save(path(name)).unwrap();
        let got = decoded(&path(name), &profile);
        // Half of 1/256 on average, and what the JPEG coder adds.
        let mean = got.iter().zip(&truth).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>() / got.len() as f64;
        assert!(mean < 0.008, "{name}: {mean}");
    }
    // A packed raw with its facts beside it, under either name, as `extract` leaves it.
    let parts = path("parts");
    let done =
        Command::new(env!("CARGO_BIN_EXE_lenslet")).args(["extract", "--out"]).args([&parts, &lfp]).output().unwrap();
    assert!(done.status.success(), "{}", said(&done));
    let of = |ending: &str| {
        let mut names = std::fs::read_dir(&parts).unwrap().map(|e| e.unwrap().path());
        names.find(|p| p.extension().is_some_and(|e| e == ending))
    };
    let raw = of("raw").expect("a raw file");
    let facts =
        std::fs::read(raw.with_extension("json")).or_else(|_| std::fs::read(raw.with_extension("txt"))).unwrap();
    for ending in ["txt", "json"] {
        let alone = path(&format!("as-{ending}.raw"));
        std::fs::copy(&raw, &alone).unwrap();
        std::fs::write(alone.with_extension(ending), &facts).unwrap();
        assert_eq!(decoded(&alone, &[]), truth, ".raw with .{ending}");
    }
}

/// JPEG leaves much noise in the colours of a mosaic, which decoding smooths. Neither noise nor smoothing of colours may decide
/// about luminance: with trust and places asked of all channels the joint fit was no better than least squares on this capture.
#[test]
fn the_joint_fit_is_best_on_mosaics_saved_as_jpeg() {
    let dir = tempfile::tempdir().unwrap();
    let lenslet = |args: &[&str]| {
        let done = Command::new(env!("CARGO_BIN_EXE_lenslet")).current_dir(dir.path()).args(args).output().unwrap();
        assert!(done.status.success(), "{args:?}: {}", said(&done));
        done.stdout
    };
    lenslet(&[
        "simulate", "--scene", "planes", "--sensor", "820", "--size", "270", "--seed", "7", "--optics", "jpeg=75",
        "--out", "sim",
    ]);
    lenslet(&["calibrate", "sim/white-00.lfp", "sim/white-01.lfp", "--out", "camera.calib"]);
    let luminance = |fit: &str| {
        lenslet(&[
            "decode",
            "sim/capture.jpg",
            "--calibration",
            "camera.calib",
            "--method",
            "multiview",
            "--fit",
            fit,
            "--size",
            "270",
            "--out",
            fit,
        ]);
        let scores = lenslet(&["score", fit, "sim/truth/sharp", "--border", "12", "--json"]);
        let scores: serde_json::Value = serde_json::from_slice(&scores).unwrap();
        scores["mean"]["psnr_y"].as_f64().unwrap()
    };
    let (joint, least_squares) = (luminance("joint"), luminance("least-squares"));
    println!("joint {joint:.2} dB, least squares {least_squares:.2} dB");
    assert!(joint > least_squares + 0.5, "{joint} {least_squares}");
}
