//! Which white image belongs to a capture, out of folders, bundles and archives.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

#[path = "../../tests/fixtures/mod.rs"]
mod fixtures;

use std::fs;
use std::path::Path;

use fixtures::{container, f01_capture};
use lenslet_core::container::packing::{Packing, pack};
use lenslet_core::container::segments::sha1_of;
use lenslet_core::container::{Capture, Error, open_capture, whites, write_lfp};
use serde_json::{Value, json};

const SIDE: usize = 64;

fn metadata(serial: &str, zoom: i64, focus: i64) -> Value {
    let four = |v: f64| json!({"r": v, "gr": v, "gb": v, "b": v});
    json!({"master": {"picture": {"frameArray": [{"frame": {
        "metadata": {
            "image": {"width": SIDE, "height": SIDE, "rawDetails": {
                "pixelFormat": {"black": four(168.0), "white": four(4095.0)},
                "pixelPacking": {"endianness": "big", "bitsPerPixel": 12},
                "mosaic": {"tile": "r,gr:gb,b", "upperLeftPixel": "b"}}},
            "devices": {"lens": {"zoomStep": zoom, "focusStep": focus}},
            "camera": {"make": "Lytro, Inc.", "model": "F01"}},
        "privateMetadata": {"camera": {"serialNumber": serial}}}}]}}})
}

fn image(level: u16) -> Vec<u8> {
    let pixels: Vec<u16> = (0..SIDE * SIDE).map(|i| level + (i % 7) as u16).collect();
    pack(Packing::Be12, &pixels).unwrap()
}

/// Name, serial, zoom, focus, brightness.
type Entry = (&'static str, &'static str, i64, i64, u16);

const ENTRIES: [Entry; 8] = [
    ("MOD_0000", "A1", 500, 300, 168),
    ("MOD_0001", "A1", 500, 300, 170),
    ("MOD_0002", "A1", 500, 300, 1800),
    ("MOD_0003", "A1", 500, 300, 900),
    ("MOD_0004", "A1", 500, 400, 1700),
    ("MOD_0005", "A1", 700, 390, 1900),
    ("MOD_0006", "A1", 510, 395, 300),
    ("MOD_0007", "B2", 505, 400, 1800),
];

fn fill(dir: &Path, entries: &[Entry]) {
    for &(name, serial, zoom, focus, level) in entries {
        fs::write(dir.join(format!("{name}.RAW")), image(level)).unwrap();
        fs::write(dir.join(format!("{name}.TXT")), metadata(serial, zoom, focus).to_string()).unwrap();
    }
}

fn capture(serial: Option<&str>, zoom: Option<i64>, focus: Option<i64>) -> Capture {
    f01_capture(SIDE, SIDE, vec![700; SIDE * SIDE], serial, zoom, focus)
}

fn stem(choice: &whites::WhiteChoice) -> String {
    choice.chosen.as_ref().unwrap().member.stem_and_extension().0
}

#[test]
fn nearest_zoom_then_focus_of_the_same_camera() {
    let dir = tempfile::tempdir().unwrap();
    fill(dir.path(), &ENTRIES);
    for (serial, zoom, focus, expected, words) in [
        ("A1", 500, 300, "MOD_0002", "same serial number, same zoom step, same focus step"),
        ("A1", 504, 380, "MOD_0004", "nearest zoom step (4 from the capture's 504), nearest focus step (20"),
        ("A1", 690, 300, "MOD_0005", "nearest zoom step (10"),
        ("B2", 500, 300, "MOD_0007", "same serial number"),
    ] {
        let choice = whites::find_white_image(dir.path(), &capture(Some(serial), Some(zoom), Some(focus))).unwrap();
        assert_eq!(stem(&choice), expected);
        assert!(choice.reason.contains(words), "{}", choice.reason);
        assert_eq!(choice.passed.len(), ENTRIES.len() - 1);
        let white = choice.load().unwrap();
        assert_eq!(white.camera.serial.as_deref(), Some(serial));
        assert_eq!(white.mosaic.width, SIDE);
    }
    let choice = whites::find_white_image(dir.path(), &capture(Some("A1"), Some(500), Some(300))).unwrap();
    let why =
        |stem: &str| choice.passed.iter().find(|(c, _)| c.member.stem_and_extension().0 == stem).unwrap().1.clone();
    assert!(why("MOD_0000").contains("black"));
    assert!(why("MOD_0003").contains("darker exposure"));
    assert!(why("MOD_0004").contains("focus step 100 away"));
    assert!(why("MOD_0005").contains("zoom step 200 away"));
    assert!(why("MOD_0006").contains("too dark"));
    assert!(why("MOD_0007").contains("another camera, B2"));
    assert_eq!(choice.lines().len(), ENTRIES.len());
    let list = whites::list_calibration_images(dir.path()).unwrap();
    let blacks = whites::black_images(&list, &capture(Some("A1"), None, None).camera);
    assert_eq!(blacks.len(), 2);
}

#[test]
fn a_reference_goes_first_unless_it_leads_to_a_black_image() {
    let dir = tempfile::tempdir().unwrap();
    fill(dir.path(), &ENTRIES);
    let hash = |c: char| format!("sha1-{}", c.to_string().repeat(40));
    let manifest = json!({"calibrationFiles": [
        {"name": "mod_0005.GCT", "hash": hash('5')}, {"name": "MOD_0001.GCT", "hash": hash('1')}]});
    fs::write(dir.path().join("cal_file_manifest.json"), manifest.to_string()).unwrap();
    let mut wanted = capture(Some("A1"), Some(500), Some(300));
    wanted.camera.white_ref = Some(hash('5'));
    let choice = whites::find_white_image(dir.path(), &wanted).unwrap();
    assert_eq!(stem(&choice), "MOD_0005");
    assert!(choice.reason.contains("sha1"));
    wanted.camera.white_ref = Some(hash('1'));
    let choice = whites::find_white_image(dir.path(), &wanted).unwrap();
    assert_eq!(stem(&choice), "MOD_0002");
}

#[test]
fn nothing_found_says_what_was_looked_for_and_what_was_there() {
    let dir = tempfile::tempdir().unwrap();
    let wanted = capture(Some("C3"), Some(500), None);
    let error = whites::find_white_image(dir.path(), &wanted).unwrap().load().unwrap_err().to_string();
    assert!(error.contains("serial C3, zoom 500, focus unknown") && error.contains("no .RAW images"), "{error}");
    fill(dir.path(), &ENTRIES);
    let choice = whites::find_white_image(dir.path(), &wanted).unwrap();
    assert!(choice.chosen.is_none());
    let error = choice.load().unwrap_err().to_string();
    for words in
        ["of the 8 images there", "2 a black image", "1 too dark", "4 of another camera, A1", "1 of another camera, B2"]
    {
        assert!(error.contains(words), "{error}");
    }
    assert!(whites::find_white_image(&dir.path().join("absent"), &wanted).is_err());
}

fn volume(entries: &[Entry], next: Option<&str>) -> Vec<u8> {
    let mut files = Vec::new();
    let mut parts = Vec::new();
    for &(name, serial, zoom, focus, level) in entries {
        for (extension, bytes) in
            [("RAW", image(level)), ("TXT", metadata(serial, zoom, focus).to_string().into_bytes())]
        {
            files.push(json!({"name": format!("C:\\T1CALIB\\{name}.{extension}"), "dataRef": sha1_of(&bytes)}));
            parts.push(bytes);
        }
    }
    let mut contents = json!({"files": files});
    if let Some(next) = next {
        contents["nextFile"] = next.into();
    }
    let parts: Vec<&[u8]> = parts.iter().map(Vec::as_slice).collect();
    container(&contents, &parts)
}

#[test]
fn bundles_of_several_volumes_are_searched() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("data.C.0"), volume(&ENTRIES[..4], Some("data.C.1"))).unwrap();
    fs::write(dir.path().join("data.C.1"), volume(&ENTRIES[4..], Some("data.C.0"))).unwrap();
    for place in [dir.path().to_path_buf(), dir.path().join("data.C.0")] {
        let list = whites::list_calibration_images(&place).unwrap();
        assert_eq!(list.warnings, Vec::<String>::new());
        assert_eq!(list.images.len(), ENTRIES.len());
        let choice = whites::find_white_image(&place, &capture(Some("A1"), Some(700), Some(390))).unwrap();
        assert_eq!(stem(&choice), "MOD_0005");
        assert!(choice.load().unwrap().warnings.is_empty());
    }
    assert!(matches!(open_capture(&dir.path().join("data.C.0"), None), Err(Error::Unsupported { .. })));
    // By the sha1 of the pixels themselves.
    let mut wanted = capture(None, None, None);
    wanted.camera.white_ref = Some(sha1_of(&image(1700)));
    assert_eq!(stem(&whites::find_white_image(dir.path(), &wanted).unwrap()), "MOD_0004");
    // A volume that is absent, and one that points elsewhere.
    fs::remove_file(dir.path().join("data.C.1")).unwrap();
    assert!(whites::list_calibration_images(dir.path()).unwrap().warnings[0].contains("data.C.1"));
    fs::write(dir.path().join("data.C.0"), volume(&ENTRIES[..4], Some("../data.C.1"))).unwrap();
    assert!(whites::list_calibration_images(dir.path()).unwrap().warnings[0].contains("plain file name"));
}

#[test]
fn archives_are_searched() {
    let dir = tempfile::tempdir().unwrap();
    let mut tar = Vec::new();
    for &(name, serial, zoom, focus, level) in &ENTRIES {
        for (extension, bytes) in
            [("RAW", image(level)), ("TXT", metadata(serial, zoom, focus).to_string().into_bytes())]
        {
            let mut head = [0u8; 512];
            let path = format!("unitdata/{name}.{extension}");
            head[..path.len()].copy_from_slice(path.as_bytes());
            let size = format!("{:011o}", bytes.len());
            head[124..135].copy_from_slice(size.as_bytes());
            head[156] = b'0';
            head[257..262].copy_from_slice(b"ustar");
            tar.extend(head);
            tar.extend(&bytes);
            tar.resize(tar.len().next_multiple_of(512), 0);
        }
    }
    tar.extend([0; 1024]);
    let path = dir.path().join("caldata-A1.tar");
    fs::write(&path, &tar).unwrap();
    let choice = whites::find_white_image(&path, &capture(Some("B2"), None, None)).unwrap();
    assert_eq!(stem(&choice), "MOD_0007");
    choice.load().unwrap();
    fs::write(&path, &tar[..9000]).unwrap();
    assert!(whites::list_calibration_images(&path).unwrap_err().to_string().contains("cut off"));
    // Within a folder a damaged archive is a warning.
    assert!(whites::list_calibration_images(dir.path()).unwrap().warnings[0].contains("cut off"));
}

#[test]
fn containers_of_white_images_are_found_and_the_capture_beside_them_is_not() {
    let dir = tempfile::tempdir().unwrap();
    let mut white = capture(Some("A1"), Some(1), Some(2));
    white.mosaic.data.fill(1500);
    write_lfp(&dir.path().join("white-00.lfp"), &white, false).unwrap();
    white.camera.normalized_response = Some([0.8, 1.0, 1.0, 0.7]);
    write_lfp(&dir.path().join("other.lfp"), &white, false).unwrap();
    write_lfp(&dir.path().join("capture.lfp"), &capture(Some("A1"), Some(1), Some(2)), false).unwrap();
    let list = whites::list_calibration_images(dir.path()).unwrap();
    assert_eq!(list.warnings, Vec::<String>::new());
    assert_eq!(list.images.len(), 2);
    let choice = whites::find_white_image(dir.path(), &capture(Some("A1"), Some(1), Some(2))).unwrap();
    assert_eq!(choice.load().unwrap().mosaic, white.mosaic);
}
