//! Damaged and malicious files: every reader gives an error or a value that keeps its promises, within bounded memory.
//! Each reader is fed its small file cut off at every length and 20,000 seeded mutations of it.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

mod common;

use std::fs;

use common::files::{
    Slot, alone, capture, check, container_bytes, dictionary_header, line, parts, small_calibration, small_dictionary,
    small_samples, tar, without_checksum,
};
use common::torment;
use lenslet_core::calibration;
use lenslet_core::container::segments::{Container, MAGIC, sha1_of};
use lenslet_core::container::{self, CameraProfile, extract, json, members, metadata, open_capture, whites};
use lenslet_core::decode::HexSamples;
use lenslet_core::dictionary;
use lenslet_core::lightfield::{self, ColourSpace, Format, Meta, ReadOptions};
use lenslet_core::progress::Silent;
use lenslet_test_support::{lfp_segment, png_chunk};
use ndarray::Array3;
use sha2::Digest;

const COUNT: usize = 20_000;

#[test]
fn containers() {
    alone("containers", 600, || {
        for (seed, white) in [(1, false), (2, true)] {
            let slot = Slot::new("a.lfp");
            let mut good = 0;
            torment(&container_bytes(white), seed, COUNT, |bytes| {
                match open_capture(slot.put(bytes), None) {
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
    });
}

#[test]
fn extraction() {
    alone("extraction", 600, || {
        let slot = Slot::new("a.lfp");
        let out = slot.dir.path().join("out");
        torment(&container_bytes(true), 3, 2000, |bytes| {
            match extract::extract(slot.put(bytes), &out, false, &Silent) {
                Ok(_) => fs::remove_dir_all(&out).unwrap(),
                Err(e) => line(e),
            }
        });
        let mut left: Vec<_> = fs::read_dir(slot.dir.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
        left.sort();
        assert_eq!(left, ["a.lfp"]);
    });
}

#[test]
fn calibration_bundles_and_archives() {
    alone("calibration_bundles_and_archives", 600, || {
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
            lfp_segment(&mut bundle, letter, &sha1_of(payload), payload);
        }
        for (seed, name, bytes) in [(4, "caldata.tar", archive), (5, "data.C.0", bundle)] {
            let slot = Slot::new(name);
            let mut found = 0;
            torment(&bytes, seed, COUNT / 2, |bytes| match whites::list_calibration_images(slot.put(bytes)) {
                Ok(list) => {
                    for c in &list.images {
                        assert!(c.mean.is_finite());
                        match c.load() {
                            Ok(white) => check(&white),
                            Err(e) => line(e),
                        }
                        found += 1;
                    }
                    let choice = whites::choose_white_image(&slot.path, list, &capture());
                    assert!(!choice.lines().is_empty());
                    members::list_members(&slot.path).unwrap();
                }
                Err(e) => line(e),
            });
            assert!(found > 100, "{name}: {found}");
        }
    });
}

#[test]
fn metadata_and_profiles() {
    alone("metadata_and_profiles", 600, || {
        let [metadata, _, private] = parts();
        let private = json::parse(&private).unwrap();
        torment(&metadata, 6, COUNT, |bytes| match json::parse(bytes) {
            Ok(value) => {
                let (f, _) = metadata::read_frame(&value, Some(&private));
                assert!(f.levels.is_none_or(|l| l.black[0] < l.white[0]));
                assert!(f.white_balance.is_none_or(|g| g.iter().all(|g| *g > 0.0)));
                assert!(f.size.is_none_or(|(w, h)| w * h <= 1 << 30));
            }
            Err(e) => line(e),
        });
        torment(include_bytes!("../profiles/lytro-f01.toml"), 7, COUNT, |bytes| {
            match std::str::from_utf8(bytes).map(CameraProfile::from_toml) {
                Ok(Ok(p)) => assert!(p.raw_bytes().is_some() && p.colour().white_balance[0] > 0.0),
                Ok(Err(e)) => line(e),
                Err(_) => {}
            }
        });
        // Many keys, deep nesting, long text.
        let many = format!("{{{}}}", (0..200_000).map(|k| format!("\"{k}\":[]")).collect::<Vec<_>>().join(","));
        metadata::read_frame(&json::parse(many.as_bytes()).unwrap(), None);
        let many = format!("{{\"a\":[{}0]}}", "0,".repeat((8 << 20) / 2 - 10));
        metadata::read_frame(&json::parse(many.as_bytes()).unwrap(), None);
        for deep in ["[", "{\"a\":", "[{\"a\":"] {
            assert!(json::parse(deep.repeat(1_000_000).as_bytes()).is_err());
        }
    });
}

#[test]
fn raw_files_with_text() {
    alone("raw_files_with_text", 600, || {
        let [metadata, image, _] = parts();
        let slot = Slot::new("a.raw");
        fs::write(&slot.path, &image).unwrap();
        let text = slot.dir.path().join("a.txt");
        torment(&metadata, 8, COUNT / 2, |bytes| {
            fs::write(&text, bytes).unwrap();
            match open_capture(&slot.path, None) {
                Ok(c) => check(&c),
                Err(e) => line(e),
            }
        });
        fs::write(&text, &metadata).unwrap();
        torment(&image, 9, COUNT / 2, |bytes| match open_capture(slot.put(bytes), None) {
            Ok(c) => check(&c),
            Err(e) => line(e),
        });
    });
}

#[test]
fn pictures() {
    alone("pictures", 600, || {
        let slot = Slot::new("source");
        let grey =
            image::ImageBuffer::<image::Luma<u16>, _>::from_fn(24, 20, |x, y| image::Luma([(x * 100 + y) as u16]));
        for (k, extension) in ["png", "tif", "pgm", "jpg"].iter().enumerate() {
            let made = slot.dir.path().join(format!("made.{extension}"));
            if *extension == "jpg" {
                image::DynamicImage::from(grey.clone()).into_luma8().save(&made).unwrap();
            } else {
                grey.save(&made).unwrap();
            }
            let bytes = fs::read(&made).unwrap();
            let slot = Slot::new(&format!("a.{extension}"));
            torment(&bytes, 10 + k as u64, COUNT, |bytes| match open_capture(slot.put(bytes), None) {
                Ok(c) => check(&c),
                Err(e) => line(e),
            });
        }
    });
}

#[test]
fn pictures_that_claim_to_be_huge() {
    alone("pictures_that_claim_to_be_huge", 600, || {
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
            line(open_capture(slot.put(&bytes), None).unwrap_err());
        }
        for text in ["P5 4294967295 4294967295 65535\n", "P5 30000 30000 65535\n", "P5 99999999999999999999 1 255\n"] {
            line(open_capture(slot.put(text.as_bytes()), None).unwrap_err());
        }
    });
}

#[test]
fn calibrations() {
    alone("calibrations", 600, || {
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
    });
}

#[test]
fn light_fields() {
    alone("light_fields", 600, || {
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
            let target =
                if format == Format::Directory { slot.path.join("lightfield.json") } else { slot.path.clone() };
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
    });
}

#[test]
fn samples() {
    alone("samples", 600, || {
        let slot = Slot::new("samples.npz");
        let whole = small_samples(12);
        whole.save(&slot.path, false).unwrap();
        let bytes = fs::read(&slot.path).unwrap();
        torment(&bytes, 40, COUNT, |bytes| match HexSamples::load(slot.put(bytes)) {
            Ok(s) => {
                assert_eq!(s.values.dim(), (s.views * s.views, s.centres.len(), s.values.dim().2));
                assert_eq!(s.index.len(), s.centres.len());
                assert!(s.view_step > 0.0);
            }
            Err(e) => line(e),
        });
    });
}

/// What is read is valid, and its header alone says the same.
fn read_dictionary(bytes: &[u8]) {
    let kinds = dictionary::read_kinds(bytes, "a");
    match dictionary::from_bytes(bytes, "a") {
        Ok(d) => {
            dictionary::validate(&d).unwrap();
            assert_eq!(kinds.unwrap(), d.models.iter().map(|m| m.kind()).collect::<Vec<_>>());
        }
        Err(e) => line(e),
    }
}

#[test]
fn dictionaries() {
    alone("dictionaries", 600, || {
        let whole = small_dictionary();
        let bytes = dictionary::to_bytes(&whole).unwrap();
        assert_eq!(dictionary::from_bytes(&bytes, "a").unwrap().models.len(), 1);
        torment(&bytes, 50, COUNT, read_dictionary);
        // With its checksum made to fit, damage to the header gets past it.
        let body = &bytes[..bytes.len() - 32];
        let (head, payload) = body.split_at((24 + dictionary_header(body)).next_multiple_of(64));
        torment(head, 51, COUNT, |head| {
            let whole = [head, payload].concat();
            read_dictionary(&[&whole[..], &sha2::Sha256::digest(&whole)].concat());
        });
        // Version 1 ends with the payload, and guards only that.
        let old = include_bytes!("../../tests/reference/golden-1.lfd");
        let (head, payload) = old.split_at((24 + dictionary_header(old)).next_multiple_of(64));
        torment(head, 52, COUNT, |head| read_dictionary(&[head, payload].concat()));
    });
}

#[test]
fn dictionaries_as_tensors() {
    alone("dictionaries_as_tensors", 600, || {
        let bytes = dictionary::Format::Safetensors.to_bytes(&small_dictionary()).unwrap();
        assert_eq!(dictionary::from_bytes(&bytes, "a").unwrap().models.len(), 1);
        torment(&bytes, 53, COUNT, read_dictionary);
        // Without its checksum, damage to numbers and matrices gets further.
        let unchecked = without_checksum(&bytes);
        read_dictionary(&unchecked);
        torment(&unchecked, 54, COUNT, read_dictionary);
    });
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
        assert!(open_capture(path, Some("lytro-f01")).is_err() || bytes.starts_with(&MAGIC));
        assert!(calibration::load(path).is_err() || bytes.starts_with(b"LENSCAL"));
        assert!(HexSamples::load(path).is_err());
        assert!(lightfield::load(path, &ReadOptions::default()).is_err());
        assert!(container::CameraProfile::find(path.to_str().unwrap()).is_err());
    }
}
