//! Captures of every kind, written and read again; wrong ones refused with a reason.

#![allow(clippy::excessive_precision)] // published values are kept as published
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

#[path = "../../tests/fixtures/mod.rs"]
mod fixtures;

use std::fs;
use std::path::Path;

use fixtures::real;
use lenslet_core::container::packing::{Packing, pack};
use lenslet_core::container::segments::Container;
use lenslet_core::container::{
    self, CameraFacts, Capture, Cfa, ColourFacts, Error, Levels, MlaHint, RawMosaic, open_capture, write_lfp,
};
use lenslet_test_support::data;

/// A small capture with every fact filled in.
fn sample(white: f32) -> Capture {
    let (width, height) = (64, 40);
    let max = white as u32;
    Capture {
        mosaic: RawMosaic {
            width,
            height,
            data: (0..(width * height) as u32).map(|i| (i * 7919 % (max + 1)) as u16).collect(),
        },
        cfa: Cfa::Grbg,
        levels: Levels { black: [64.0, 65.0, 66.0, 67.0], white: [white; 4] },
        colour: ColourFacts {
            white_balance: [1.5, 1.0, 1.0625, 1.1875],
            ccm: [2.19, -1.02, -0.17, -0.41, 1.76, -0.35, -0.18, -0.7, 1.89],
            gamma: Some(0.41666),
        },
        camera: CameraFacts {
            make: Some("Lytro, Inc.".into()),
            model: Some("X99".into()),
            serial: Some("A123".into()),
            zoom_step: Some(-981),
            focus_step: Some(582),
            iso: Some(87.0),
            exposure_seconds: Some(0.004),
            exposure_bias: Some(-1.125),
            normalized_response: Some([0.75, 1.0, 1.0, 0.5]),
            white_ref: Some(format!("sha1-{}", "0123456789".repeat(4))),
        },
        mla: Some(MlaHint { pitch: 14.25, rotation: -0.00055, row_stretch: 1.0004 }),
        source_sha256: String::new(),
        jpeg: false,
        white: None,
        warnings: Vec::new(),
    }
}

fn bare(mut capture: Capture) -> Capture {
    capture.source_sha256.clear();
    if let Some(m) = capture.mla.as_mut() {
        m.pitch = (m.pitch * 1e9).round() / 1e9;
    }
    capture.white = capture.white.map(|w| Box::new(bare(*w)));
    capture
}

#[test]
fn a_written_container_is_read_the_same() {
    let dir = tempfile::tempdir().unwrap();
    for white in [1023.0, 4095.0, 65535.0] {
        let path = dir.path().join(format!("{white}.lfp"));
        let capture = sample(white);
        write_lfp(&path, &capture, false).unwrap();
        assert!(bare(open_capture(&path, None).unwrap()) == capture);
        assert!(write_lfp(&path, &capture, false).is_err(), "existing file");
        assert!(write_lfp(&path, &capture, true).is_err(), "a capture is never replaced");
    }
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 3);
}

#[test]
fn a_container_carries_its_white_image() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.lfr");
    let mut capture = sample(1023.0);
    let mut white = sample(1023.0);
    white.mosaic.data.reverse();
    white.camera.white_ref = None;
    capture.white = Some(Box::new(white));
    write_lfp(&path, &capture, false).unwrap();
    let read = bare(open_capture(&path, None).unwrap());
    assert_eq!(read.warnings, Vec::<String>::new());
    assert!(read == capture);
}

#[test]
fn what_does_not_fit_is_not_written() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.lfp");
    let mut capture = sample(4095.0);
    capture.mosaic.data[5] = 4096;
    assert!(matches!(write_lfp(&path, &capture, false), Err(Error::Parameter(_))));
    capture.mosaic.data.pop();
    assert!(matches!(write_lfp(&path, &capture, false), Err(Error::Parameter(_))));
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn raw_files_take_their_facts_from_the_text_beside_them() {
    let dir = tempfile::tempdir().unwrap();
    let capture = sample(4095.0);
    write_lfp(&dir.path().join("a.lfp"), &capture, false).unwrap();
    let container = Container::open(&dir.path().join("a.lfp")).unwrap();
    let metadata = container.payload(&container.segments[1]).unwrap();
    let raw = dir.path().join("MOD_0002.RAW");
    fs::write(&raw, pack(Packing::Be12, &capture.mosaic.data).unwrap()).unwrap();
    assert!(matches!(open_capture(&raw, None), Err(Error::NotRecognised { .. })));
    for name in ["MOD_0002.TXT", "MOD_0002.json"] {
        let text = dir.path().join(name);
        fs::write(&text, [&metadata[..], b"\0\0 trailing"].concat()).unwrap();
        let read = open_capture(&raw, None).unwrap();
        assert_eq!(read.mosaic, capture.mosaic);
        assert_eq!(read.levels, capture.levels);
        assert_eq!(read.camera.zoom_step, Some(-981));
        fs::remove_file(text).unwrap();
    }
}

fn f01(value: impl Fn(usize) -> u16) -> RawMosaic {
    RawMosaic { width: 3280, height: 3280, data: (0..3280 * 3280).map(value).collect() }
}

#[test]
fn raw_files_of_a_known_size_need_no_text() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.raw");
    let mosaic = f01(|i| (i % 4096) as u16);
    fs::write(&path, pack(Packing::Be12, &mosaic.data).unwrap()).unwrap();
    let capture = open_capture(&path, None).unwrap();
    assert_eq!(capture.mosaic, mosaic);
    assert_eq!(capture.cfa, Cfa::Bggr);
    assert_eq!(capture.levels.black, [168.0; 4]);
    assert!(capture.warnings.iter().any(|w| w.contains("lytro-f01")), "{:?}", capture.warnings);
    assert!(open_capture(&path, Some("lytro-illum")).unwrap_err().to_string().contains("need"));
}

fn save(path: &Path, mosaic: &RawMosaic, eight: bool) {
    let (w, h) = (mosaic.width as u32, mosaic.height as u32);
    if eight {
        image::GrayImage::from_raw(w, h, mosaic.data.iter().map(|&v| v as u8).collect()).unwrap().save(path).unwrap();
    } else {
        image::ImageBuffer::<image::Luma<u16>, _>::from_raw(w, h, mosaic.data.clone()).unwrap().save(path).unwrap();
    }
}

#[test]
fn pictures_of_mosaics_get_levels_that_fit_their_values() {
    let dir = tempfile::tempdir().unwrap();
    let near = |a: f32, b: f64| assert!((f64::from(a) - b).abs() < 1e-2, "{a} {b}");
    let twelve = f01(|i| (i % 4096) as u16);
    for name in ["a.png", "a.tif", "a.pgm"] {
        let path = dir.path().join(name);
        save(&path, &twelve, false);
        let capture = open_capture(&path, None).unwrap();
        assert_eq!(capture.mosaic, twelve, "{name}");
        assert_eq!(capture.levels, Levels { black: [168.0; 4], white: [4095.0; 4] });
        assert_eq!(capture.cfa, Cfa::Bggr);
        assert_eq!(capture.mla, None, "a size alone does not tell the lenslets");
        assert!(open_capture(&path, Some("lytro-f01")).unwrap().mla.is_some());
    }
    let sixteen = f01(|i| (i % 4096 * 16) as u16);
    let path = dir.path().join("b.png");
    save(&path, &sixteen, false);
    let capture = open_capture(&path, None).unwrap();
    near(capture.levels.black[0], 168.0 * 65535.0 / 4095.0);
    near(capture.levels.white[0], 65535.0);
    let eight = f01(|i| (i % 256) as u16);
    let path = dir.path().join("c.png");
    save(&path, &eight, true);
    let capture = open_capture(&path, None).unwrap();
    assert_eq!(capture.mosaic, eight);
    near(capture.levels.black[3], 168.0 * 255.0 / 4095.0);
    near(capture.levels.white[3], 255.0);
    assert!(capture.warnings.iter().any(|w| w.contains("8-bit")));
    let path = dir.path().join("c.jpg");
    save(&path, &eight, true);
    near(open_capture(&path, None).unwrap().levels.black[3], 10.46);
}

#[test]
fn a_photo_is_no_mosaic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("photo.jpg");
    image::RgbImage::from_fn(128, 96, |x, y| image::Rgb([x as u8, y as u8, 99])).save(&path).unwrap();
    let error = open_capture(&path, None).unwrap_err();
    assert!(matches!(error, Error::Unsupported { .. }));
    assert!(error.to_string().contains("photo.jpg") && error.to_string().contains("colour"));
    let path = dir.path().join("grey.png");
    image::RgbImage::from_fn(128, 96, |x, _| image::Rgb([x as u8; 3])).save(&path).unwrap();
    let capture = open_capture(&path, None).unwrap();
    assert_eq!((capture.mosaic.width, capture.mosaic.data[5]), (128, 5));
    assert!(capture.warnings.iter().any(|w| w.contains("fit no known camera")));
}

#[test]
fn wrong_files_are_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let path = dir.path().join(name);
        fs::write(&path, bytes).unwrap();
        path
    };
    let full = {
        let path = dir.path().join("full.lfp");
        write_lfp(&path, &sample(4095.0), false).unwrap();
        fs::read(path).unwrap()
    };
    for (path, word) in [
        (file("text.lfp", b"this is a text file, not a container"), "not a capture"),
        (file("empty.lfp", b""), "empty"),
        (file("cut.lfp", &full[..full.len() / 2]), "cut off"),
        (file("start.lfp", &full[..12]), "only 12 bytes"),
        (file("bad.png", b"\x89PNG\r\n\x1a\n nothing more"), "decoded"),
        (file("bad.raw", &[0; 100]), "100 bytes"),
        (dir.path().join("absent.lfp"), "cannot read"),
        (dir.path().to_path_buf(), "folder"),
    ] {
        let error = open_capture(&path, None).unwrap_err().to_string();
        assert!(error.contains(word) && error.contains(path.to_str().unwrap()) && !error.contains('\n'), "{error}");
    }
    assert!(matches!(open_capture(&dir.path().join("full.lfp"), Some("nikon")), Err(Error::Parameter(_))));
}

#[test]
fn damage_is_a_warning_and_an_absent_image_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.lfp");
    write_lfp(&path, &sample(4095.0), false).unwrap();
    let container = Container::open(&path).unwrap();
    let image = container.segments[2].clone();
    let mut bytes = fs::read(&path).unwrap();
    bytes[image.offset as usize + 96 + 10] ^= 0x10;
    fs::write(&path, &bytes).unwrap();
    let warnings = open_capture(&path, None).unwrap().warnings;
    assert!(warnings.len() == 1 && warnings[0].contains("damaged"), "{warnings:?}");
    bytes[image.offset as usize + 30] = b'0';
    bytes[image.offset as usize + 31] = b'0';
    fs::write(&path, &bytes).unwrap();
    let error = open_capture(&path, None).unwrap_err();
    assert!(matches!(&error, Error::Missing { what, .. } if what == "imageRef"), "{error}");
}

#[test]
fn every_real_container_is_read_with_its_checksums() {
    let Some(dir) = data("lfp") else { return };
    let mut seen = 0;
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        let container = Container::open(&path).unwrap();
        assert_eq!(container.warnings, Vec::<String>::new());
        for s in &container.segments {
            assert_eq!(container.checked(s).unwrap().1, None, "{}", path.display());
        }
        container.contents().unwrap();
        // None of them holds the raw image it names.
        assert!(matches!(open_capture(&path, None), Err(Error::Missing { .. })));
        seen += container.segments.len();
    }
    assert!(seen >= 3 + 13 + 4, "{seen}");
}

#[test]
fn real_metadata_gives_typed_facts() {
    let dir = real("metadata");
    let read = |name: &str| {
        let value = container::json::parse(&fs::read(dir.join(name)).unwrap()).unwrap();
        let (frame, warnings) = container::metadata::read_frame(&value, None);
        assert_eq!(warnings, Vec::<String>::new(), "{name}");
        frame
    };
    for (name, pitch, rotation) in [
        ("f01-frame-a.json", 9.92757, 0.0019290975760668516),
        ("f01-frame-b.json", 9.92758, -0.00028155732434242963791),
    ] {
        let f = read(name);
        assert_eq!((f.size, f.packing, f.cfa), (Some((3280, 3280)), Some(Packing::Be12), Some(Cfa::Bggr)));
        assert_eq!(f.levels, Some(Levels { black: [168.0; 4], white: [4095.0; 4] }));
        let mla = f.mla.unwrap();
        assert!((mla.pitch - pitch).abs() < 1e-4 && mla.rotation == rotation, "{mla:?}");
        assert_eq!(f.camera.zoom_step, Some(981));
        assert_eq!(f.camera.model.as_deref(), Some("F01"));
        assert!(f.ccm.unwrap()[0] > 3.1 && f.gamma.is_some() && f.camera.exposure_bias.unwrap() < -1.0);
    }
    let f = read("illum-white.json");
    assert_eq!((f.size, f.packing, f.cfa), (Some((7728, 5368)), Some(Packing::Le10), Some(Cfa::Grbg)));
    assert_eq!(f.camera.serial.as_deref(), Some("B5143909630"));
    assert_eq!(f.camera.normalized_response, Some([0.776_166_3, 1.0, 1.0, 0.734_497_67]));
    assert_eq!((f.is_white, f.is_dark, f.camera.focus_step), (Some(true), Some(false), Some(-300)));
    assert!((f.mla.unwrap().pitch - 14.2857).abs() < 1e-3);
    let f = read("illum-frame.json");
    assert_eq!((f.size, f.packing, f.cfa), (Some((7728, 5368)), Some(Packing::Le10), Some(Cfa::Grbg)));
    assert_eq!(f.levels, Some(Levels { black: [66.0; 4], white: [1023.0; 4] }));
    assert_eq!(f.white_balance, Some([1.512_220_5, 1.0, 1.0, 1.188_954_8]));
    assert_eq!((f.camera.zoom_step, f.camera.focus_step), (Some(-563), Some(-17)));
    assert_eq!(f.camera.serial.as_deref(), Some("B5152102610"));
}

#[test]
fn real_mosaics_are_read() {
    let Some(dir) = data("f01") else { return };
    let capture = open_capture(&dir.join("IMG_4.jpg"), None).unwrap();
    assert_eq!((capture.mosaic.width, capture.mosaic.height), (3280, 3280));
    let mut values = capture.mosaic.data.clone();
    values.sort_unstable();
    let dark = values[values.len() / 1000];
    assert!(
        (f32::from(dark) - capture.levels.black[0]).abs() < 4.0,
        "darkest values {dark}, black {}",
        capture.levels.black[0]
    );
    assert!(open_capture(&dir.join("image_cords.mat"), None).is_err());
}
