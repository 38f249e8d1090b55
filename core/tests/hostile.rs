//! Damaged and malicious files: every reader gives an error or a value that keeps its promises, within bounded memory.
//! Each reader is fed its small file cut off at every length and 20,000 seeded mutations of it.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use common::torment;
use lenslet_core::calibration::{self, Calibration, Grid, Lattice, Lenslet, Origin, Quality, Vignetting};
use lenslet_core::container::segments::{Container, MAGIC, sha1_of};
use lenslet_core::container::{
    self, CameraFacts, Capture, Cfa, ColourFacts, Levels, MlaHint, RawMosaic, extract, json, members, metadata, open,
    profile, whites, write_lfp,
};
use lenslet_core::decode::{HexSamples, npz};
use lenslet_core::dictionary::{self, Anchored, Base, Dictionary, Footprint, Model, Pass, Recipe, Storage};
use lenslet_core::lightfield::{self, ColourSpace, Format, Meta, ReadOptions};
use lenslet_core::progress::Silent;
use ndarray::{Array2, Array3};
use sha2::Digest;

const COUNT: usize = 20_000;

fn capture() -> Capture {
    let (width, height) = (16, 16);
    Capture {
        mosaic: RawMosaic { width, height, data: (0..256).map(|i| i * 13 % 4096).collect() },
        cfa: Cfa::Bggr,
        levels: Levels { black: [168.0; 4], white: [4095.0; 4] },
        colour: ColourFacts { white_balance: [1.0, 1.0, 1.0, 1.5], ccm: [0.5; 9], gamma: Some(0.4) },
        camera: CameraFacts {
            model: Some("F01".into()),
            serial: Some("A1".into()),
            zoom_step: Some(1),
            focus_step: Some(2),
            normalized_response: Some([0.8, 1.0, 1.0, 0.7]),
            ..CameraFacts::default()
        },
        mla: Some(MlaHint { pitch: 10.0, rotation: 0.001, row_stretch: 1.0004 }),
        source_sha256: String::new(),
        white: None,
        warnings: Vec::new(),
    }
}

/// What every capture must keep, however odd its file.
fn check(c: &Capture) {
    assert_eq!(c.mosaic.data.len(), c.mosaic.width * c.mosaic.height);
    assert!(c.mosaic.width > 0 && c.mosaic.height > 0);
    assert!(c.levels.black.iter().zip(&c.levels.white).all(|(b, w)| b.is_finite() && b < w));
    assert!(c.colour.white_balance.iter().all(|g| g.is_finite() && *g > 0.0));
    assert!(c.colour.ccm.iter().all(|v| v.is_finite()));
    assert!(
        c.mla
            .as_ref()
            .is_none_or(|m| m.pitch >= 2.0 && m.pitch <= 500.0 && m.rotation.is_finite() && m.row_stretch.is_finite())
    );
    c.white.iter().for_each(|w| check(w));
}

/// Any error must be one line that names something.
fn line(e: impl std::fmt::Display) {
    let text = e.to_string();
    assert!(!text.is_empty() && text.len() < 5000, "{text}");
}

/// A file that is written anew for each reading.
struct Slot {
    dir: tempfile::TempDir,
    path: PathBuf,
}

impl Slot {
    fn new(name: &str) -> Slot {
        let base = Path::new("/dev/shm");
        let dir = if base.is_dir() { tempfile::tempdir_in(base) } else { tempfile::tempdir() }.unwrap();
        Slot { path: dir.path().join(name), dir }
    }

    fn put(&self, bytes: &[u8]) -> &Path {
        fs::write(&self.path, bytes).unwrap();
        &self.path
    }
}

/// The most memory this process had so far, MiB; 0 where the system does not tell.
fn peak() -> usize {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with("VmHWM:")).unwrap_or_default();
    line.split_whitespace().nth(1).and_then(|n| n.parse::<usize>().ok()).unwrap_or(0) / 1024
}

/// The bound this file's readers keep together (tests run side by side).
fn bounded() {
    println!("peak memory so far: {} MiB", peak());
    assert!(peak() < 600, "{} MiB", peak());
}

fn container_bytes(white: bool) -> Vec<u8> {
    let slot = Slot::new("a.lfp");
    let mut c = capture();
    if white {
        c.white = Some(Box::new(capture()));
    }
    write_lfp(&slot.path, &c, false).unwrap();
    fs::read(&slot.path).unwrap()
}

#[test]
fn containers() {
    for (seed, white) in [(1, false), (2, true)] {
        let slot = Slot::new("a.lfp");
        let mut good = 0;
        torment(&container_bytes(white), seed, COUNT, |bytes| {
            match open(slot.put(bytes), None) {
                Ok(c) => {
                    check(&c);
                    good += 1;
                }
                Err(e) => line(e),
            }
            if let Ok(c) = Container::from_bytes(&slot.path, bytes.to_vec()) {
                for s in &c.segments {
                    assert!(c.checked(s).unwrap().0.len() as u64 == s.length);
                }
            }
        });
        assert!(good > 100, "damage was so great that nothing was left to read: {good}");
    }
    bounded();
}

#[test]
fn extraction() {
    let slot = Slot::new("a.lfp");
    let out = slot.dir.path().join("out");
    torment(&container_bytes(true), 3, 2000, |bytes| match extract::extract(slot.put(bytes), &out, false, &Silent) {
        Ok(_) => fs::remove_dir_all(&out).unwrap(),
        Err(e) => line(e),
    });
    let mut left: Vec<_> = fs::read_dir(slot.dir.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["a.lfp"]);
    bounded();
}

fn tar(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut tar = Vec::new();
    for (name, bytes) in files {
        let mut head = [0u8; 512];
        head[..name.len()].copy_from_slice(name.as_bytes());
        head[124..135].copy_from_slice(format!("{:011o}", bytes.len()).as_bytes());
        head[156] = b'0';
        head[257..262].copy_from_slice(b"ustar");
        tar.extend(head);
        tar.extend(*bytes);
        tar.resize(tar.len().next_multiple_of(512), 0);
    }
    tar.extend([0; 512]);
    tar
}

/// Metadata, image and private metadata of the written container.
fn parts() -> [Vec<u8>; 3] {
    let c = Container::from_bytes(Path::new("a"), container_bytes(false)).unwrap();
    [1, 2, 3].map(|k| c.payload(&c.segments[k]).unwrap())
}

#[test]
fn calibration_bundles_and_archives() {
    let [metadata, image, _] = parts();
    let manifest =
        br#"{"calibrationFiles":[{"name":"MOD_0002.GCT","hash":"sha1-0123456789012345678901234567890123456789"}]}"#;
    let archive =
        tar(&[("x/MOD_0002.RAW", &image), ("x/MOD_0002.TXT", &metadata), ("cal_file_manifest.json", manifest)]);
    let contents = serde_json::json!({"nextFile": "data.C.1", "files": [
        {"name": "C:\\T1CALIB\\MOD_0002.RAW", "dataRef": sha1_of(&image)},
        {"name": "C:\\T1CALIB\\MOD_0002.TXT", "dataRef": sha1_of(&metadata)}]});
    let mut bundle = MAGIC.to_vec();
    bundle.extend([0, 0, 0, 1, 0, 0, 0, 0]);
    for (letter, payload) in [(b'M', contents.to_string().as_bytes()), (b'C', &image), (b'C', &metadata)] {
        bundle.extend([0x89, b'L', b'F', letter, b'\r', b'\n', 0x1a, b'\n', 0, 0, 0, 0]);
        bundle.extend((payload.len() as u32).to_be_bytes());
        bundle.extend(sha1_of(payload).bytes());
        bundle.extend([0; 35]);
        bundle.extend(payload);
        bundle.resize(bundle.len().next_multiple_of(16), 0);
    }
    for (seed, name, bytes) in [(4, "caldata.tar", archive), (5, "data.C.0", bundle)] {
        let slot = Slot::new(name);
        let mut found = 0;
        torment(&bytes, seed, COUNT / 2, |bytes| match whites::list(slot.put(bytes)) {
            Ok(list) => {
                for c in &list.candidates {
                    assert!(c.mean.is_finite());
                    match c.load() {
                        Ok(white) => check(&white),
                        Err(e) => line(e),
                    }
                    found += 1;
                }
                let choice = whites::choose(&slot.path, list, &capture());
                assert!(!choice.lines().is_empty());
                members::members(&slot.path).unwrap();
            }
            Err(e) => line(e),
        });
        assert!(found > 100, "{name}: {found}");
    }
    bounded();
}

#[test]
fn metadata_and_profiles() {
    let [metadata, _, private] = parts();
    let private = json::parse(&private).unwrap();
    torment(&metadata, 6, COUNT, |bytes| match json::parse(bytes) {
        Ok(value) => {
            let (f, _) = metadata::frame(&value, Some(&private));
            assert!(f.levels.is_none_or(|l| l.black[0] < l.white[0]));
            assert!(f.white_balance.is_none_or(|g| g.iter().all(|g| *g > 0.0)));
            assert!(f.size.is_none_or(|(w, h)| w * h <= 1 << 30));
        }
        Err(e) => line(e),
    });
    torment(include_bytes!("../profiles/lytro-f01.toml"), 7, COUNT, |bytes| {
        match std::str::from_utf8(bytes).map(profile::parse) {
            Ok(Ok(p)) => assert!(p.raw_bytes().is_some() && p.colour().white_balance[0] > 0.0),
            Ok(Err(e)) => line(e),
            Err(_) => {}
        }
    });
    // Many keys, deep nesting, long text.
    let many = format!("{{{}}}", (0..200_000).map(|k| format!("\"{k}\":[]")).collect::<Vec<_>>().join(","));
    metadata::frame(&json::parse(many.as_bytes()).unwrap(), None);
    let many = format!("{{\"a\":[{}0]}}", "0,".repeat((8 << 20) / 2 - 10));
    metadata::frame(&json::parse(many.as_bytes()).unwrap(), None);
    for deep in ["[", "{\"a\":", "[{\"a\":"] {
        assert!(json::parse(deep.repeat(1_000_000).as_bytes()).is_err());
    }
    bounded();
}

#[test]
fn raw_files_with_text() {
    let [metadata, image, _] = parts();
    let slot = Slot::new("a.raw");
    fs::write(&slot.path, &image).unwrap();
    let text = slot.dir.path().join("a.txt");
    torment(&metadata, 8, COUNT / 2, |bytes| {
        fs::write(&text, bytes).unwrap();
        match open(&slot.path, None) {
            Ok(c) => check(&c),
            Err(e) => line(e),
        }
    });
    fs::write(&text, &metadata).unwrap();
    torment(&image, 9, COUNT / 2, |bytes| match open(slot.put(bytes), None) {
        Ok(c) => check(&c),
        Err(e) => line(e),
    });
    bounded();
}

#[test]
fn pictures() {
    let slot = Slot::new("source");
    let grey = image::ImageBuffer::<image::Luma<u16>, _>::from_fn(24, 20, |x, y| image::Luma([(x * 100 + y) as u16]));
    for (k, extension) in ["png", "tif", "pgm", "jpg"].iter().enumerate() {
        let made = slot.dir.path().join(format!("made.{extension}"));
        if *extension == "jpg" {
            image::DynamicImage::from(grey.clone()).into_luma8().save(&made).unwrap();
        } else {
            grey.save(&made).unwrap();
        }
        let bytes = fs::read(&made).unwrap();
        let slot = Slot::new(&format!("a.{extension}"));
        torment(&bytes, 10 + k as u64, COUNT, |bytes| match open(slot.put(bytes), None) {
            Ok(c) => check(&c),
            Err(e) => line(e),
        });
    }
    bounded();
}

fn png_chunk(out: &mut Vec<u8>, kind: &[u8; 4], data: &[u8]) {
    out.extend((data.len() as u32).to_be_bytes());
    let mut crc = flate2::Crc::new();
    crc.update(kind);
    crc.update(data);
    out.extend(kind);
    out.extend(data);
    out.extend(crc.sum().to_be_bytes());
}

#[test]
fn pictures_that_claim_to_be_huge() {
    let slot = Slot::new("huge.png");
    for (w, h, bits) in
        [(u32::MAX, u32::MAX, 16), (30_000, 30_000, 16), (1 << 31, 1, 8), (32_768, 32_768, 8), (0, 0, 8)]
    {
        let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
        let mut head = Vec::new();
        head.extend(w.to_be_bytes());
        head.extend(h.to_be_bytes());
        head.extend([bits, 0, 0, 0, 0]);
        png_chunk(&mut bytes, b"IHDR", &head);
        png_chunk(&mut bytes, b"IDAT", &[0x78, 0x9c, 0x03, 0, 0, 0, 0, 1]);
        png_chunk(&mut bytes, b"IEND", &[]);
        line(open(slot.put(&bytes), None).unwrap_err());
    }
    for text in ["P5 4294967295 4294967295 65535\n", "P5 30000 30000 65535\n", "P5 99999999999999999999 1 255\n"] {
        line(open(slot.put(text.as_bytes()), None).unwrap_err());
    }
    bounded();
}

fn small_calibration() -> Calibration {
    let lenslets =
        (0..20).map(|k| Lenslet { i: k % 5, j: k / 5, x: f64::from(k) * 3.0, y: f64::from(k), trust: 0.5 }).collect();
    Calibration {
        width: 64,
        height: 48,
        lattice: Lattice { grid: Grid::HexRows, origin: [31.5, 23.5], a: [10.0, 0.03], b: [5.0, 8.66] },
        lenslets,
        quality: Quality { residual_rms: 0.01, rejected: 0.0, confidence: 0.9, ..Quality::default() },
        vignetting: Some(Vignetting { width: 64, height: 48, white: (0..64 * 48).map(|i| i as u16 * 10).collect() }),
        hot_pixels: Vec::new(),
        origin: Origin { method: "white".into(), ..Origin::default() },
    }
}

#[test]
fn calibrations() {
    let slot = Slot::new("a.calib");
    let whole = small_calibration();
    calibration::save(&slot.path, &whole, false).unwrap();
    let bytes = fs::read(&slot.path).unwrap();
    torment(&bytes, 20, COUNT, |bytes| match calibration::load(slot.put(bytes)) {
        Ok(c) => {
            assert!(c.lattice.pitch().is_finite() && c.lattice.pitch() > 0.0, "{:?}", c.lattice);
            assert!(c.lenslets.iter().all(|l| l.x.is_finite() && l.y.is_finite() && l.trust.is_finite()));
            assert!(c.vignetting.is_none_or(|v| v.white.len() == v.width * v.height));
        }
        Err(e) => line(e),
    });
    bounded();
}

#[test]
fn light_fields() {
    let view = Array3::from_shape_fn((6, 8, 3), |(t, s, c)| (t * 8 + s + c) as f32 / 60.0);
    for (k, (name, format)) in
        [("a.npy", Format::Npy), ("a.mat", Format::Mat), ("a.png", Format::Eslf), ("dir", Format::Directory)]
            .into_iter()
            .enumerate()
    {
        let slot = Slot::new(name);
        let mut sink =
            lightfield::create(&slot.path, Meta::new([3, 3], [6, 8], 3, ColourSpace::Srgb), format, false).unwrap();
        for at in 0..9 {
            sink.write(at / 3, at % 3, &view).unwrap();
        }
        sink.finish().unwrap();
        let options = ReadOptions { views: (format == Format::Eslf).then_some([3, 3]), ..ReadOptions::default() };
        let target = if format == Format::Directory { slot.path.join("lightfield.json") } else { slot.path.clone() };
        let bytes = fs::read(&target).unwrap();
        lightfield::load(&slot.path, &options).unwrap();
        torment(&bytes, 30 + k as u64, COUNT, |bytes| {
            fs::write(&target, bytes).unwrap();
            let options = ReadOptions { max_bytes: 64 << 20, ..options.clone() };
            match lightfield::load(&slot.path, &options) {
                Ok(l) => assert_eq!(
                    l.data.len(),
                    l.meta.views[0] * l.meta.views[1] * l.meta.size[0] * l.meta.size[1] * l.meta.channels
                ),
                Err(e) => line(e),
            }
        });
    }
    bounded();
}

#[test]
fn samples() {
    let slot = Slot::new("samples.npz");
    let whole = HexSamples {
        sensor: (64, 48),
        centres: (0..12).map(|k| [f64::from(k), f64::from(k) * 2.0]).collect(),
        index: (0..12).map(|k| [k, 0]).collect(),
        views: 3,
        view_step: 1.0,
        weights: vec![1.0; 9],
        values: Array3::from_shape_fn((9, 12, 3), |(v, l, c)| (v + l + c) as f32),
    };
    npz::save(&slot.path, &whole, false).unwrap();
    let bytes = fs::read(&slot.path).unwrap();
    torment(&bytes, 40, COUNT, |bytes| match npz::load(slot.put(bytes)) {
        Ok(s) => {
            assert_eq!(s.values.dim(), (s.views * s.views, s.centres.len(), s.values.dim().2));
            assert_eq!(s.index.len(), s.centres.len());
            assert!(s.view_step > 0.0);
        }
        Err(e) => line(e),
    });
    bounded();
}

fn small_dictionary() -> Dictionary {
    let unit = |k: usize| Array2::from_shape_fn((k, 4), |(r, c)| if c == r % 4 { 1.0 } else { 0.0 });
    let pass = Pass {
        support: 5,
        patch: 3,
        filters: Array2::from_shape_fn((4, 25), |(r, c)| (r + c) as f32 * 0.01),
        floor: 0.1,
        lambda: 0.05,
        low: unit(6),
        high: Array2::from_elem((6, 9), 0.25),
        linear: Array2::from_elem((4, 9), 0.125),
        with_linear: true,
        anchored: Some(Anchored { anchors: unit(3), maps: Array3::from_elem((3, 4, 9), 0.5) }),
    };
    let recipe = Recipe { tool: "test".into(), algorithm: "ksvd".into(), ..Recipe::default() };
    let model = Model { footprint: Footprint::Lenslet, base: Base::Barycentric, pitch: 3.29, passes: vec![pass] };
    Dictionary { recipe, storage: Storage::I8, models: vec![model] }
}

#[test]
fn dictionaries() {
    let whole = small_dictionary();
    let bytes = dictionary::to_bytes(&whole).unwrap();
    assert_eq!(dictionary::from_bytes(&bytes, "a").unwrap().models.len(), 1);
    let read = |bytes: &[u8]| match dictionary::from_bytes(bytes, "a.lfd") {
        Ok(d) => dictionary::validate(&d).unwrap(),
        Err(e) => line(e),
    };
    torment(&bytes, 50, COUNT, read);
    // With its checksum made to fit, damage to the header gets past it.
    let body = &bytes[..bytes.len() - 32];
    let (head, payload) = body.split_at((24 + dictionary_header(body)).next_multiple_of(64));
    torment(head, 51, COUNT, |head| {
        let whole = [head, payload].concat();
        read(&[&whole[..], &sha2::Sha256::digest(&whole)].concat());
    });
    // Version 1 ends with the payload, and guards only that.
    let old = include_bytes!("../../tests/reference/golden-1.lfd");
    let (head, payload) = old.split_at((24 + dictionary_header(old)).next_multiple_of(64));
    torment(head, 52, COUNT, |head| read(&[head, payload].concat()));
    bounded();
}

/// Length of a dictionary file's header.
fn dictionary_header(bytes: &[u8]) -> usize {
    u64::from_le_bytes(bytes[16..24].try_into().unwrap()) as usize
}

#[test]
fn every_kind_of_file_is_refused_by_every_other_reader() {
    let slot = Slot::new("x");
    calibration::save(&slot.path, &small_calibration(), false).unwrap();
    let calibration_file = fs::read(&slot.path).unwrap();
    for bytes in
        [&b""[..], b"text", &container_bytes(false), &calibration_file, &[0; 4096], &[0xff; 4096], &tar(&[("a", b"b")])]
    {
        let path = slot.put(bytes);
        assert!(open(path, Some("lytro-f01")).is_err() || bytes.starts_with(&MAGIC));
        assert!(calibration::load(path).is_err() || bytes.starts_with(b"LENSCAL"));
        assert!(npz::load(path).is_err());
        assert!(lightfield::load(path, &ReadOptions::default()).is_err());
        assert!(container::profile(path.to_str().unwrap()).is_err());
    }
}
