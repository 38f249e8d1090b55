//! Wrong input to the whole program: one line on stderr, the right exit code, nothing half-written.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn lenslet(args: &[&str], directory: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lenslet")).args(args).current_dir(directory).output().unwrap()
}

/// Fails with `code`, says why in one line that holds `words`, and leaves no file but those that were there.
fn refuses(args: &[&str], directory: &Path, code: i32, words: &[&str]) {
    let before = listing(directory);
    let output = lenslet(args, directory);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {stderr}");
    assert!(output.stdout.is_empty(), "{args:?} wrote to stdout");
    if code == 1 {
        assert_eq!(stderr.trim_end().lines().count(), 1, "{args:?}: {stderr}");
    }
    for word in words {
        assert!(stderr.to_lowercase().contains(&word.to_lowercase()), "{args:?} should mention {word:?}: {stderr}");
    }
    assert_eq!(before, listing(directory), "{args:?} left something behind");
}

fn listing(directory: &Path) -> Vec<String> {
    fn walk(directory: &Path, out: &mut Vec<String>) {
        for entry in fs::read_dir(directory).unwrap() {
            let path = entry.unwrap().path();
            out.push(path.display().to_string());
            if path.is_dir() {
                walk(&path, out);
            }
        }
    }
    let mut out = Vec::new();
    walk(directory, &mut out);
    out.sort();
    out
}

fn photo(path: &Path) {
    let mut state = 1u32;
    image::RgbImage::from_fn(700, 500, |x, y| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let noise = (state >> 28) as u8;
        let wave = 90.0 * (f64::from(x) / 57.0).sin() * (f64::from(y) / 83.0).cos();
        image::Rgb([(120.0 + wave) as u8 + noise, (x / 4) as u8, (y / 4) as u8])
    })
    .save(path)
    .unwrap();
}

#[test]
fn files_that_are_not_captures() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("text.lfp"), "This is a letter, not a photograph.\n").unwrap();
    fs::write(at("empty.lfp"), "").unwrap();
    let mut head = b"\x89LFP\r\n\x1a\n\0\0\0\x01\0\0\0\0".to_vec();
    head.extend_from_slice(b"\x89LFM\r\n\x1a\n\0\0\0\0\x00\x10\x00\x00sha1-");
    fs::write(at("cut.lfp"), &head).unwrap();
    fs::create_dir(at("a folder")).unwrap();
    for name in ["text.lfp", "empty.lfp", "cut.lfp", "absent.lfp"] {
        refuses(&["info", name], dir.path(), 1, &[name]);
        refuses(&["calibrate", name, "--out", "x.calib"], dir.path(), 1, &[name]);
        refuses(&["decode", name, "--calibration", "x.calib", "--out", "x"], dir.path(), 1, &[]);
    }
    refuses(&["info", "a folder"], dir.path(), 1, &["a folder"]);
}

#[test]
fn a_photo_is_no_white_image() {
    let dir = tempfile::tempdir().unwrap();
    photo(&dir.path().join("photo.jpg"));
    photo(&dir.path().join("photo.png"));
    for name in ["photo.jpg", "photo.png"] {
        refuses(&["calibrate", name, "--out", "x.calib"], dir.path(), 1, &[name]);
    }
}

#[test]
fn a_dictionary_of_another_version_or_kind() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let mut newer = include_bytes!("../dictionaries/default.lfd").to_vec();
    // The format version follows the magic; whatever its width, a very high byte there is a version of the future.
    newer[8] = 0xf0;
    fs::write(at("newer.lfd"), &newer).unwrap();
    fs::write(at("text.lfd"), "atoms").unwrap();
    fs::create_dir(at("lf")).unwrap();
    for row in 1..=3 {
        for column in 1..=3 {
            photo(&at("lf").join(format!("view_{row}_{column}.png")));
        }
    }
    refuses(&["infer", "lf", "--out", "x", "--dictionary", "newer.lfd"], dir.path(), 1, &["newer.lfd", "version"]);
    refuses(&["infer", "lf", "--out", "x", "--dictionary", "text.lfd"], dir.path(), 1, &["text.lfd"]);
    refuses(&["infer", "lf", "--out", "x", "--dictionary", "no-such-name"], dir.path(), 1, &["no-such-name"]);
    refuses(&["info", "newer.lfd"], dir.path(), 1, &["newer.lfd", "version"]);
}

#[test]
fn folders_that_are_missing_and_outputs_that_exist() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    refuses(&["infer", "absent", "--out", "x"], dir.path(), 1, &["absent"]);
    refuses(&["score", "absent", "absent-too"], dir.path(), 1, &["absent"]);
    refuses(&["train-dict", "absent", "--out", "x.lfd"], dir.path(), 1, &["absent"]);
    refuses(&["gen-pairs", "absent.jpg", "--out", "pairs"], dir.path(), 1, &["absent.jpg"]);

    fs::create_dir(at("out")).unwrap();
    fs::write(at("out/precious"), "mine").unwrap();
    fs::write(at("out.lfd"), "mine").unwrap();
    photo(&at("photo.png"));
    refuses(&["simulate", "--out", "out"], dir.path(), 1, &["out", "is kept"]);
    refuses(&["demo", "--out", "out"], dir.path(), 1, &["out", "is kept"]);
    refuses(&["gen-pairs", "photo.png", "--out", "out"], dir.path(), 1, &["out", "is kept"]);
    refuses(&["train-dict", "photo.png", "--out", "out.lfd"], dir.path(), 1, &["out.lfd", "is kept"]);
    assert_eq!(fs::read(at("out.lfd")).unwrap(), b"mine");
}

#[test]
fn wrong_usage_is_exit_code_two() {
    let dir = tempfile::tempdir().unwrap();
    for args in [
        &["decode"][..],
        &["no-such-command"],
        &["decode", "x.lfp", "--calibration", "x.calib", "--out", "x", "--method", "magic"],
        &["calibrate", "--out", "x.calib"],
        &["train-dict", "x.jpg", "--out", "x.lfd", "--algorithm", "prayer"],
        &["info", "x", "--threads", "0"],
    ] {
        refuses(args, dir.path(), 2, &[]);
    }
}
