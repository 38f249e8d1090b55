//! Folders of captures as cameras and programs leave them, and what messages say to do next.

use std::fs;

use super::bench::Bench;
use super::containers::{changed, edited};
use super::fields::{aloud, told};

const DECODE: &str = "--size 40 --views 1 --method barycentric --out";

/// What lies beside captures failed the whole batch.
#[test]
fn files_beside_captures_are_left_out_with_a_count() {
    let bench = Bench::new();
    fs::create_dir(bench.at("batch")).unwrap();
    fs::copy(bench.at("s1/capture.lfp"), bench.at("batch/IMG_0001.lfp")).unwrap();
    fs::copy(bench.at("s1/white-00.lfp"), bench.at("batch/white-00.lfp")).unwrap();
    fs::copy(bench.at("s1/white-00.lfp"), bench.at("batch/tagged.lfp")).unwrap();
    bench.put("batch/._IMG_0001.lfp", [0, 5, 22, 7, 0, 0, 0, 0]);
    bench.put("batch/.hidden.lfp", "");
    // A processed file as the camera's program lays it beside: renderings, no raw image.
    let rendered = edited(&bench.at("s1/capture.lfp"), |used, bytes| match used {
        "contents" => changed(&bytes, |c| {
            let none = format!("sha1-{}", "0".repeat(40));
            c["picture"]["frameArray"][0]["frame"]["imageRef"] = none.into();
            c["picture"]["accelerationArray"] = serde_json::json!([{"type": "com.lytro.acceleration.refocusStack"}]);
        }),
        _ => bytes,
    });
    bench.put("batch/IMG_0001-stk.lfp", &rendered);
    bench.put("batch/IMG_0001-dm.lfp", &rendered);
    let out = told(bench.path(), &format!("decode batch -c cam.calib {DECODE} o"));
    assert_eq!((out["decoded"].as_array().unwrap().len(), out["left_out"].as_array().unwrap().len()), (1, 6), "{out}");
    assert!(bench.at("o/IMG_0001").is_dir() && !bench.at("o/white-00").exists());
    let again = bench.done(&format!("decode batch -c cam.calib {DECODE} o"));
    assert!(
        again.out.contains("1 there already, 0 failed, 6 left out (2 hidden, 2 processed, 2 white image)"),
        "{}",
        again.out
    );
    // By itself the reason is an error.
    bench.refused(&format!("decode batch/IMG_0001-stk.lfp -c cam.calib {DECODE} x"), &["processed file", ".lfp"]);
    fs::remove_file(bench.at("batch/IMG_0001.lfp")).unwrap();
    bench.refused(&format!("decode batch -c cam.calib {DECODE} p"), &["batch", "no capture", "2 white image"]);
}

/// A capture that carries its white image failed where the folder held none for its camera.
#[test]
fn a_capture_uses_its_own_white_image_where_none_fits() {
    let bench = Bench::new();
    bench.done("simulate --camera lytro-illum --sensor 320x240 --size 54 --views 1 --whites 1 --out i");
    bench.done("simulate --sensor 160 --size 40 --views 1 --whites 1 --seed 3 --out s3");
    fs::create_dir_all(bench.at("batch")).unwrap();
    fs::create_dir_all(bench.at("cals")).unwrap();
    fs::create_dir_all(bench.at("whites")).unwrap();
    fs::copy(bench.at("s1/capture.lfp"), bench.at("batch/IMG_0001.lfp")).unwrap();
    fs::copy(bench.at("i/capture.lfr"), bench.at("batch/IMG_0002.LFR")).unwrap();
    fs::copy(bench.at("cam.calib"), bench.at("cals/f01.calib")).unwrap();
    fs::copy(bench.at("s1/white-00.lfp"), bench.at("whites/white-00.lfp")).unwrap();
    for place in ["cals", "whites"] {
        let out = told(bench.path(), &format!("decode batch -c {place} {DECODE} o-{place}"));
        let reasons: Vec<&str> =
            out["decoded"].as_array().unwrap().iter().map(|d| d["calibration"].as_str().unwrap()).collect();
        assert!(reasons.len() == 2 && !reasons[0].contains("inside the capture"), "{reasons:?}");
        assert!(reasons[1].contains("inside the capture"), "{reasons:?}");
    }
    // One calibration asked for by name is not replaced in silence.
    bench.refused(&format!("decode batch/IMG_0002.LFR -c cals/f01.calib {DECODE} x"), &["IMG_0002.LFR", "f01.calib"]);
}

/// Errors named no file: which image, and inside which.
#[test]
fn errors_name_the_file_and_what_in_it() {
    let bench = Bench::new();
    bench.done("simulate --camera lytro-illum --sensor 320x240 --size 54 --views 1 --whites 1 --out i");
    let black =
        edited(
            &bench.at("i/capture.lfr"),
            |used, bytes| {
                if used == "modulationDataRef" { vec![0; bytes.len()] } else { bytes }
            },
        );
    bench.put("black.lfr", black);
    bench.refused(&format!("decode black.lfr {DECODE} x"), &["black.lfr", "white image inside", "black"]);
    bench.refused(&format!("decode i/capture.lfr -c cam.calib {DECODE} x"), &["i/capture.lfr", "cam.calib"]);
    let mut samples = lenslet_core::decode::HexSamples::load(&bench.at("lf/samples.npz")).unwrap();
    let first = samples.centres[0];
    samples.centres.iter_mut().for_each(|c| *c = first);
    samples.save(&bench.at("lf/samples.npz"), true).unwrap();
    bench.refused("refine lf --out x", &["lf/samples.npz"]);
}

/// Messages name the next command.
#[test]
fn messages_name_the_next_command() {
    let bench = Bench::new();
    for command in ["view", "refine", "depth", "convert", "infer", "viewpoint", "refocus --disparity 0"] {
        let out = if command == "view" { "x.html" } else { "x.npy" };
        let out = if ["depth", "viewpoint"].contains(&command) { "x" } else { out };
        let out = if command.starts_with("refocus") { "x.png" } else { out };
        let words = ["s1/capture.lfp", "lenslet decode s1/capture.lfp"];
        bench.refused(&format!("{command} s1/capture.lfp --out {out}"), &words);
    }
    let answer = bench.run(&format!("decode s1/capture.lfp {DECODE} x"));
    assert_eq!(answer.code, Some(2), "{}", answer.err);
    assert!(answer.err.contains("lenslet calibrate") && answer.err.contains("--from-captures"), "{}", answer.err);
    bench.refused(&format!("decode lf -c cam.calib {DECODE} x"), &["lf", "light field", "lenslet view"]);
    bench.done("convert lf --out lf.npy");
    bench.refused(&format!("decode lf.npy -c cam.calib {DECODE} x"), &["lf.npy", "light field", "lenslet view"]);
    let answer = bench.run("s1/capture.lfp");
    assert_eq!(answer.code, Some(2), "{}", answer.err);
    assert!(answer.err.contains("lenslet decode s1/capture.lfp"), "{}", answer.err);
    bench.refused("calibrate s1 --out x.calib", &["s1", "folder", "--bundle"]);
}

/// Text from files reached the terminal as it was.
#[test]
fn nothing_in_a_file_reaches_the_terminal_as_a_command() {
    let bench = Bench::new();
    let serial = "A\u{1b}[31m\u{9b}2J\u{202e}\u{2066}\u{7}B";
    let bytes = edited(&bench.at("s1/capture.lfp"), |used, bytes| match used {
        "privateMetadataRef" => changed(&bytes, |m| m["camera"]["serialNumber"] = serial.into()),
        _ => bytes,
    });
    bench.put("esc.lfp", bytes);
    fs::copy(bench.at("esc.lfp"), bench.at("white-esc.lfp")).unwrap();
    fs::create_dir(bench.at("w")).unwrap();
    fs::copy(bench.at("esc.lfp"), bench.at("w/white-esc.lfp")).unwrap();
    for line in [
        format!("decode esc.lfp -c cam.calib {DECODE} x"),
        format!("decode esc.lfp -c w {DECODE} y"),
        "info esc.lfp".into(),
        "info w".into(),
        "calibrate --from-captures esc.lfp --out e.calib".into(),
        "info e.calib".into(),
        "calibrate --bundle w --out b".into(),
        "--json info esc.lfp".into(),
    ] {
        let answer = aloud(bench.path(), &line);
        for text in [&answer.out, &answer.err] {
            assert!(!text.contains(['\u{1b}', '\u{9b}', '\u{202e}', '\u{2066}', '\u{7}']), "{line}: {text:?}");
        }
    }
    // What a program reads is the same text.
    assert!(told(bench.path(), "info esc.lfp").to_string().contains("\u{202e}"));
}
