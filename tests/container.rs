//! `lenslet info` and `lenslet extract` as a user calls them.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

mod fixtures;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use assert_cmd::Command;
use fixtures::{container, f01_capture};
use lenslet_core::container::packing::{Packing, pack};
use lenslet_core::container::segments::sha1_of;
use lenslet_core::container::{Capture, MlaHint, RawMosaic, open_capture, write_lfp};
use serde_json::{Value, json};

fn lenslet(args: &[&str]) -> Output {
    Command::cargo_bin("lenslet").unwrap().args(args).output().unwrap()
}

fn info(path: &Path) -> Value {
    let out = lenslet(&["info", "--json", path.to_str().unwrap()]);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

/// Exit code 1, one line on stderr, nothing on stdout; the line.
fn refused(args: &[&str]) -> String {
    let out = lenslet(args);
    let line = String::from_utf8(out.stderr).unwrap();
    assert_eq!((out.status.code(), out.stdout.len(), line.lines().count()), (Some(1), 0, 1), "{line}");
    line
}

fn capture(width: usize, height: usize) -> Capture {
    let data = (0..width * height).map(|i| (i * 31 % 4096) as u16).collect();
    let mut capture = f01_capture(width, height, data, Some("A1\u{1b}[2J"), Some(500), Some(300));
    capture.colour.white_balance = [1.0, 1.0, 1.0, 1.5];
    capture.mla = Some(MlaHint { pitch: 10.0, rotation: 0.001, row_stretch: 1.0004 });
    capture
}

#[test]
fn info_tells_the_parts_of_a_container() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a b.lfp");
    write_lfp(&path, &capture(64, 48), false).unwrap();
    let json = info(&path);
    assert_eq!(json["kind"], "container");
    let segments = json["segments"].as_array().unwrap();
    assert_eq!(segments.len(), 4);
    assert!(segments.iter().all(|s| s["sha1_ok"] == true));
    assert_eq!(segments[0]["used_as"], "table of contents");
    assert_eq!(segments[2]["used_as"], "picture.frameArray.0.frame.imageRef");
    assert_eq!(segments[2]["length"], 64 * 48 * 3 / 2);
    assert_eq!(json["image"]["width"], 64);
    assert_eq!(json["camera"]["zoom_step"], 500);
    assert_eq!((json["image_present"].as_bool(), json["missing"].as_array().unwrap().len()), (Some(true), 0));

    let mut bytes = fs::read(&path).unwrap();
    let at = segments[2]["offset"].as_u64().unwrap() as usize + 100;
    bytes[at] ^= 1;
    fs::write(&path, &bytes).unwrap();
    let out = lenslet(&["info", path.to_str().unwrap()]);
    let text = String::from_utf8(out.stdout).unwrap();
    assert!(text.contains("DAMAGED") && String::from_utf8_lossy(&out.stderr).contains("damaged"));
    assert!(!text.contains('\u{1b}') && text.contains("A1\\u{1b}[2J"), "control characters are shown, not sent");
}

#[test]
fn info_tells_mosaics_raw_files_calibrations_and_profiles() {
    let dir = tempfile::tempdir().unwrap();
    let png = dir.path().join("m.png");
    image::ImageBuffer::<image::Luma<u16>, _>::from_fn(100, 80, |x, y| image::Luma([(x * y % 4096) as u16]))
        .save(&png)
        .unwrap();
    let json = info(&png);
    assert_eq!((json["kind"].as_str(), json["image"]["cfa"].as_str()), (Some("raw mosaic"), Some("bggr")));
    assert_eq!(json["values"]["max"], 4095);
    assert!(json["warnings"][0].as_str().unwrap().contains("fit no known camera"));

    let raw = dir.path().join("MOD_0002.RAW");
    fs::write(&raw, pack(Packing::Be12, &capture(64, 48).mosaic.data).unwrap()).unwrap();
    assert!(refused(&["info", raw.to_str().unwrap()]).contains("4608 bytes fit no known camera"));
    let four = |v: u32| json!({"r": v, "gr": v, "gb": v, "b": v});
    let text = json!({"image": {"width": 64, "height": 48, "rawDetails": {
        "pixelFormat": {"black": four(168), "white": four(4095)},
        "pixelPacking": {"endianness": "big", "bitsPerPixel": 12},
        "mosaic": {"tile": "r,gr:gb,b", "upperLeftPixel": "gr"}}}});
    fs::write(dir.path().join("MOD_0002.txt"), text.to_string()).unwrap();
    assert_eq!(info(&raw)["image"]["cfa"], "grbg");
    assert_eq!(info(&dir.path().join("MOD_0002.txt"))["kind"], "camera metadata");

    let toml = dir.path().join("mine.toml");
    fs::write(&toml, include_str!("../core/profiles/lytro-f01.toml")).unwrap();
    assert_eq!(info(&toml)["profile"]["sensor"]["width"], 3280);
    assert!(refused(&["info", png.to_str().unwrap(), "--profile", "nikon"]).contains("lytro-f01"));

    let photo = dir.path().join("p.jpg");
    image::RgbImage::from_fn(64, 64, |x, y| image::Rgb([x as u8 * 3, y as u8 * 3, 0])).save(&photo).unwrap();
    assert_eq!(info(&photo)["kind"], "picture");
}

#[test]
fn info_refuses_what_is_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let full = dir.path().join("full.lfp");
    write_lfp(&full, &capture(64, 48), false).unwrap();
    let full = fs::read(&full).unwrap();
    for (name, bytes, word) in [
        ("text.lfp", &b"only text"[..], "not a capture"),
        ("empty.lfp", b"", "empty"),
        ("cut.lfp", &full[..full.len() - 400], "cut off"),
        ("half.calib", b"LENSCAL\0\x01\0\0\0", "half.calib"),
        ("odd.json", b"{\"a\": 1}", "not the metadata"),
        ("deep.json", &b"{\"a\":".repeat(2000), "recursion"),
        ("nan.json", b"{\"image\": {\"width\": NaN}}", "not valid JSON"),
    ] {
        let path = dir.path().join(name);
        fs::write(&path, bytes).unwrap();
        let line = refused(&["info", path.to_str().unwrap()]);
        assert!(line.contains(word) && line.contains(name), "{line}");
    }
    assert!(refused(&["info", dir.path().join("absent").to_str().unwrap()]).contains("cannot read"));
    assert_eq!(lenslet(&["info"]).status.code(), Some(2));
}

#[test]
fn extracted_raw_images_are_captures_again() {
    let dir = tempfile::tempdir().unwrap();
    let (path, out) = (dir.path().join("a.lfr"), dir.path().join("out"));
    let mut original = capture(64, 48);
    let mut white = capture(64, 48);
    white.mosaic.data.reverse();
    original.white = Some(Box::new(white.clone()));
    write_lfp(&path, &original, false).unwrap();
    let run = lenslet(&["extract", "--json", path.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert!(run.status.success());
    let json: Value = serde_json::from_slice(&run.stdout).unwrap();
    assert!(json["files"].as_array().unwrap().iter().all(|f| f["intact"] == true));
    let image = open_capture(&out.join("image.raw"), None).unwrap();
    assert_eq!((&image.mosaic, &image.levels, &image.mla), (&original.mosaic, &original.levels, &original.mla));
    assert_eq!(open_capture(&out.join("white.raw"), None).unwrap().mosaic, white.mosaic);
    let index: Value = serde_json::from_slice(&fs::read(out.join("index.json")).unwrap()).unwrap();
    assert_eq!(index["files"].as_array().unwrap().len(), 6);

    let line = refused(&["extract", path.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert!(line.contains("exists already"));
    assert!(lenslet(&["extract", path.to_str().unwrap(), "--out", out.to_str().unwrap(), "--force"]).status.success());
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 2, "nothing temporary is left");
}

#[test]
fn bundles_never_write_outside_their_folder() {
    let dir = tempfile::tempdir().unwrap();
    let (one, two) = (b"first".as_slice(), b"second file".as_slice());
    let names = [
        "C:\\T1CALIB\\MOD_0001.RAW",
        "..\\..\\..\\escape.txt",
        "/etc/lenslet-test",
        "C:\\T1CALIB\\mod_0001.raw",
        "..",
        "a\0b",
    ];
    let files: Vec<Value> = names
        .iter()
        .enumerate()
        .map(|(k, name)| json!({"name": name, "dataRef": sha1_of(if k % 2 == 0 { one } else { two })}))
        .collect();
    let inner = dir.path().join("x/y");
    fs::create_dir_all(&inner).unwrap();
    let bundle = inner.join("data.C.0");
    fs::write(&bundle, container(&json!({ "files": files }), &[one, two])).unwrap();
    let out = inner.join("out");
    let run = lenslet(&["extract", bundle.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let mut found: Vec<PathBuf> = Vec::new();
    let mut folders = vec![dir.path().to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() { folders.push(path) } else { found.push(path) }
        }
    }
    // The bundle, its files, the description and the list of what was written.
    assert_eq!(found.len(), 1 + names.len() + 2, "{found:?}");
    assert!(out.join(".lenslet").exists());
    assert!(found.iter().all(|p| p.starts_with(&out) || *p == bundle));
    assert_eq!(fs::read(out.join("T1CALIB/MOD_0001.RAW")).unwrap(), one);
    assert_eq!(fs::read(out.join("escape.txt")).unwrap(), two);
    assert!(!Path::new("/etc/lenslet-test").exists());
}

/// A white image of 400x400 pixels with lenslets of pitch 10, times `gain`.
fn lenslets(gain: f64) -> RawMosaic {
    let (side, pitch) = (400usize, 10.0);
    let row = pitch * 3f64.sqrt() / 2.0;
    let value = |x: f64, y: f64| {
        let near = (y / row).round() as i64;
        let r2 = (near - 1..=near + 1)
            .map(|j| {
                let shift = if j % 2 == 0 { 0.0 } else { pitch / 2.0 };
                let dx = (x - shift) - ((x - shift) / pitch).round() * pitch;
                dx * dx + (y - j as f64 * row).powi(2)
            })
            .fold(f64::INFINITY, f64::min);
        168.0 + gain * 3000.0 * (1.0 - 0.8 * r2 / 25.0).max(0.06)
    };
    let data = (0..side * side).map(|i| value((i % side) as f64, (i / side) as f64) as u16).collect();
    RawMosaic { width: side, height: side, data }
}

#[test]
fn decode_finds_the_white_image_of_a_capture_in_a_bundle() {
    let dir = tempfile::tempdir().unwrap();
    let mut parts = Vec::new();
    let mut files = Vec::new();
    for (name, serial, zoom, gain) in [
        ("MOD_0000", "A1", 500, 0.0),
        ("MOD_0002", "A1", 500, 0.8),
        ("MOD_0003", "A1", 500, 0.4),
        ("MOD_0004", "B2", 500, 0.9),
    ] {
        let mut white = capture(400, 400);
        white.mosaic = lenslets(gain);
        white.camera.serial = Some(serial.into());
        white.camera.zoom_step = Some(zoom);
        let path = dir.path().join("made.lfp");
        write_lfp(&path, &white, true).unwrap();
        let made = lenslet_core::container::segments::Container::open(&path).unwrap();
        let part = |k: usize| serde_json::from_slice(&made.payload(&made.segments[k]).unwrap()).unwrap();
        let (metadata, private): (Value, Value) = (part(1), part(3));
        let text = json!({"master": {"picture": {"frameArray": [{"frame": {"metadata": metadata, "privateMetadata": private}}]}}});
        for (extension, bytes) in
            [("RAW", pack(Packing::Be12, &white.mosaic.data).unwrap()), ("TXT", text.to_string().into_bytes())]
        {
            files.push(json!({"name": format!("C:\\T1CALIB\\{name}.{extension}"), "dataRef": sha1_of(&bytes)}));
            parts.push(bytes);
        }
        fs::remove_file(path).unwrap();
    }
    let parts: Vec<&[u8]> = parts.iter().map(Vec::as_slice).collect();
    let bundle = dir.path().join("data.C.0");
    fs::write(&bundle, container(&json!({ "files": files }), &parts)).unwrap();
    let scene = dir.path().join("scene.lfp");
    let mut shot = capture(400, 400);
    shot.mosaic = lenslets(0.5);
    shot.camera.serial = Some("A1".into());
    write_lfp(&scene, &shot, false).unwrap();

    let json = info(&bundle);
    let states: Vec<_> = json["images"].as_array().unwrap().iter().map(|i| i["state"].as_str().unwrap()).collect();
    assert_eq!(
        (json["kind"].as_str().unwrap(), states),
        ("calibration bundle", vec!["black", "white", "white", "white"])
    );

    let out = dir.path().join("lf.npy");
    let decode = |place: &Path, out: &Path| {
        let arguments = ["decode", "--calibration", place.to_str().unwrap(), "--out", out.to_str().unwrap()];
        lenslet(
            &[
                &arguments[..],
                &["--method", "barycentric", "--size", "60", "--views", "3", "--npy", scene.to_str().unwrap()],
            ]
            .concat(),
        )
    };
    let run = decode(&bundle, &out);
    let told = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.success(), "{told}");
    assert!(out.exists());
    for words in [
        "white image:",
        "MOD_0002",
        "same serial number, same zoom step",
        "a black image",
        "the darker exposure",
        "another camera, B2",
    ] {
        assert!(told.contains(words), "{words}: {told}");
    }
    // No camera fits: one line says what was looked for and what was there.
    shot.camera.serial = Some("C3".into());
    fs::remove_file(&scene).unwrap();
    write_lfp(&scene, &shot, false).unwrap();
    let run = decode(&bundle, &dir.path().join("none.npy"));
    let told = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(!run.status.success() && told.contains("serial C3") && told.contains("of another camera, A1"), "{told}");
    assert!(!dir.path().join("none.npy").exists());
}

#[test]
fn lytros_own_renderings_are_listed_and_extracted() {
    let Some(lfp) = lenslet_test_support::data("lfp") else { return };
    let json = info(&lfp.join("IMG_0001-stk.lfp"));
    assert_eq!(json["segments"].as_array().unwrap().len(), 14);
    assert_eq!((json["image_present"].as_bool(), json["missing"].as_array().unwrap().len()), (Some(false), 3));
    let dir = tempfile::tempdir().unwrap();
    let extract = |name: &str| {
        let out = dir.path().join(name.replace('.', "-"));
        let run = lenslet(&["extract", lfp.join(name).to_str().unwrap(), "--out", out.to_str().unwrap()]);
        assert!(run.status.success());
        out
    };
    let out = extract("IMG_0001-stk.lfp");
    for k in 0..12 {
        let slice = image::open(out.join(format!("refocus-{k:02}.jpg"))).unwrap();
        assert_eq!((slice.width(), slice.height()), (1080, 1080));
    }
    let index: Value = serde_json::from_slice(&fs::read(out.join("index.json")).unwrap()).unwrap();
    let of = |index: &Value, name: &str| {
        index["files"].as_array().unwrap().iter().find(|f| f["file"] == name).unwrap().clone()
    };
    assert_eq!(of(&index, "refocus-00.jpg")["facts"]["lambda"], -8.922_927_856_445_312);
    let depth = image::open(out.join("depth.png")).unwrap();
    assert_eq!((depth.width(), depth.height()), (20, 20));

    let out = extract("IMG_0002-stk.lfp");
    let index: Value = serde_json::from_slice(&fs::read(out.join("index.json")).unwrap()).unwrap();
    assert_eq!(of(&index, "parallax.h264")["facts"]["frames"].as_array().unwrap().len(), 37);
    assert_eq!(of(&index, "refocus.h264")["facts"]["frames"].as_array().unwrap().len(), 11);
    let pfm = fs::read(out.join("depth.pfm")).unwrap();
    let raw = fs::read(out.join("depth.raw")).unwrap();
    assert!(pfm.starts_with(b"Pf\n330 330\n-1.0\n"));
    assert_eq!(pfm[pfm.len() - 330 * 4..], raw[..330 * 4], "the last row of a .pfm is the first of the map");
}

/// Files as Lytro's own software writes them, planted: what `data/lfp` shows in the large.
#[test]
fn processed_files_give_slices_depth_maps_and_video_blocks_as_they_are() {
    let dir = tempfile::tempdir().unwrap();
    let slice = |level: u8| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        image::GrayImage::from_pixel(16, 8, image::Luma([level]))
            .write_to(&mut bytes, image::ImageFormat::Jpeg)
            .unwrap();
        bytes.into_inner()
    };
    let (near, far) = (slice(200), slice(50));
    let floats = |n: usize, of: &dyn Fn(usize) -> f32| (0..n).flat_map(|k| of(k).to_le_bytes()).collect::<Vec<u8>>();
    let lut = floats(4 * 3, &|k| k as f32 - 5.0);
    let map = floats(2 * 6 * 5, &|k| k as f32 * 0.25);
    let video = b"\0\0\0\x01\x67 not really a film".to_vec();
    let picture = |lambda: f64, bytes: &[u8]| json!({"representation": "jpeg", "width": 16, "height": 8, "lambda": lambda, "imageRef": sha1_of(bytes)});
    let stack = json!({"picture": {"accelerationArray": [
        {"type": "com.lytro.acceleration.refocusStack", "vendorContent": {
            "depthLut": {"width": 4, "height": 3, "representation": "raw", "imageRef": sha1_of(&lut)},
            "imageArray": [picture(-3.5, &near), picture(4.25, &far)]}},
        {"type": "com.lytro.acceleration.edofParallax", "vendorContent": {"blockOfImages": {
            "representation": "h264", "blockOfImagesRef": sha1_of(&video), "metadataArray": [{"coord": {"x": 0, "y": 1}}]}}},
    ]}});
    let depth = json!({"picture": {"accelerationArray": [{"type": "com.lytro.acceleration.depthMap", "vendorContent":
        {"width": 6, "height": 5, "minLambda": 0.0, "maxLambda": 15.0, "imageRef": sha1_of(&map)}}]}});
    let extracted = |name: &str, contents: &Value, parts: &[&[u8]]| {
        let (file, out) = (dir.path().join(name), dir.path().join(name).with_extension("parts"));
        fs::write(&file, container(contents, parts)).unwrap();
        assert_eq!(info(&file)["segments"].as_array().unwrap().len(), parts.len() + 1);
        let run = lenslet(&["extract", file.to_str().unwrap(), "--out", out.to_str().unwrap()]);
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        out
    };
    let out = extracted("a-stk.lfp", &stack, &[&lut, &near, &far, &video]);
    assert_eq!(fs::read(out.join("refocus-00.jpg")).unwrap(), near);
    assert_eq!(fs::read(out.join("refocus-01.jpg")).unwrap(), far);
    assert_eq!(fs::read(out.join("parallax.h264")).unwrap(), video);
    assert_eq!(fs::read(out.join("depth.raw")).unwrap(), lut);
    let index: Value = serde_json::from_slice(&fs::read(out.join("index.json")).unwrap()).unwrap();
    let of = |name: &str| index["files"].as_array().unwrap().iter().find(|f| f["file"] == name).unwrap().clone();
    assert_eq!(
        (&of("refocus-00.jpg")["facts"]["lambda"], &of("refocus-01.jpg")["facts"]["lambda"]),
        (&json!(-3.5), &json!(4.25))
    );
    assert_eq!(of("parallax.h264")["facts"]["frames"][0]["coord"]["y"], 1);

    let out = extracted("a-dm.lfp", &depth, &[&map]);
    assert_eq!(fs::read(out.join("depth.raw")).unwrap(), map);
    // Rows of a .pfm go upwards; the second half of the map is the confidence.
    let last = |name: &str| {
        let pfm = fs::read(out.join(name)).unwrap();
        pfm[pfm.len() - 6 * 4..].to_vec()
    };
    assert_eq!((last("depth.pfm"), last("confidence.pfm")), (map[..24].to_vec(), map[120..144].to_vec()));
    let picture = image::open(out.join("depth.png")).unwrap().into_luma16();
    assert_eq!((picture.dimensions(), picture.get_pixel(0, 0)[0], picture.get_pixel(5, 4)[0]), ((6, 5), 0, 65535));
}
