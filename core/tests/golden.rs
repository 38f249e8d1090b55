//! A small file of every format version that this library wrote, kept for ever: each must load in every later version,
//! with the values that it was made of. Those of version 1 of dictionaries and calibrations are in `tests/golden.rs` of the
//! program, those of checkpoints beside `train/src/checkpoint.rs`.
//!
//! A new version gets a file of its own: change the writer, name the file here, and run once with
//! `LENSLET_WRITE_GOLDEN=1`. A file that exists is never written again.

#![allow(clippy::unwrap_used, clippy::expect_used)] // a test may fail loudly

mod common;

use std::path::{Path, PathBuf};

use common::files::{small_calibration, small_dictionary, small_samples};
use lenslet_core::decode::HexSamples;
use lenslet_core::dictionary::{self, Dictionary, SideInput};
use lenslet_core::lightfield::{self, ColourSpace, Format, LightField, Meta, ReadOptions};
use lenslet_core::{calibration, lightfield::load};
use ndarray::Array5;

/// A golden file; written by `write` where it is missing and that is asked for.
fn golden(name: &str, write: impl FnOnce(&Path)) -> PathBuf {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference").join(name);
    if !path.exists() {
        assert!(std::env::var("LENSLET_WRITE_GOLDEN").is_ok_and(|v| v == "1"), "{} is missing", path.display());
        write(&path);
    }
    path
}

/// The version an `.lfd` or `.calib` file says it has.
fn version(path: &Path) -> u32 {
    u32::from_le_bytes(std::fs::read(path).unwrap()[8..12].try_into().unwrap())
}

/// Without a network: what version 2 can hold.
fn plain() -> Dictionary {
    let mut dictionary = small_dictionary();
    dictionary.models[0].patch_model.network = None;
    dictionary
}

/// With a network that takes noise.
fn told_noise() -> Dictionary {
    let mut dictionary = small_dictionary();
    if let Some(network) = &mut dictionary.models[0].patch_model.network {
        network.side_inputs = vec![SideInput::Noise];
    }
    dictionary
}

#[test]
fn dictionaries_of_versions_2_to_4() {
    let all =
        [("golden-2.lfd", 2, plain()), ("golden-3.lfd", 3, small_dictionary()), ("golden-4.lfd", 4, told_noise())];
    for (name, number, truth) in all {
        let path = golden(name, |path| std::fs::write(path, dictionary::to_bytes(&truth).unwrap()).unwrap());
        assert_eq!(version(&path), number, "{name}");
        assert_eq!(dictionary::load(&path).unwrap(), truth, "{name}");
    }
}

#[test]
fn a_dictionary_of_tensors() {
    let path = golden("golden-1.safetensors", |path| {
        std::fs::write(path, dictionary::Format::Safetensors.to_bytes(&small_dictionary()).unwrap()).unwrap();
    });
    let read = dictionary::load(&path).unwrap();
    assert_eq!(read.models, small_dictionary().models);
    assert_eq!(read.recipe, small_dictionary().recipe);
}

#[test]
fn a_calibration_of_version_2() {
    let truth = small_calibration();
    let path = golden("golden-2.calib", |path| calibration::save(path, &truth, false).unwrap());
    assert_eq!(version(&path), 2);
    let read = calibration::load(&path).unwrap();
    assert_eq!((read.width, read.height, read.lattice), (truth.width, truth.height, truth.lattice));
    assert_eq!((&read.quality, &read.origin, &read.hot_pixels), (&truth.quality, &truth.origin, &truth.hot_pixels));
    assert_eq!(read.lenslets.len(), truth.lenslets.len());
    for (r, t) in read.lenslets.iter().zip(&truth.lenslets) {
        assert_eq!((r.i, r.j), (t.i, t.j));
        // As the format rounds them.
        assert!((r.x - t.x).abs() <= 0.5 / 16384.0 && (r.y - t.y).abs() <= 0.5 / 16384.0, "{r:?} {t:?}");
        assert!((r.trust - t.trust).abs() <= 0.5 / 255.0 + 1e-6, "{r:?} {t:?}");
    }
    let (read, truth) = (read.vignetting.unwrap(), truth.vignetting.unwrap());
    assert_eq!((read.width, read.height, read.white.len()), (truth.width, truth.height, truth.white.len()));
    for (&r, &t) in read.white.iter().zip(&truth.white) {
        let (r, t) = (f64::from(r), f64::from(t));
        // Half a step of its root, and half a unit.
        assert!((r - t).abs() <= 2.0 * t.sqrt() * 0.5 / 1024.0 * 65535f64.sqrt() + 1.0, "{r} {t}");
    }
}

#[test]
fn samples() {
    let truth = small_samples(7);
    let path = golden("golden-2-samples.npz", |path| truth.save(path, false).unwrap());
    assert_eq!(HexSamples::load(&path).unwrap(), truth);
}

/// A light field whose values 16 bits hold exactly.
fn field() -> LightField {
    let data = Array5::from_shape_fn((2, 3, 4, 5, 3), |(v, u, t, s, c)| {
        (1000 * v + 5000 * u + 700 * t + 300 * s + 11000 * c) as f32 / 65535.0
    });
    let meta = Meta {
        pitch: Some(3.29),
        provenance: vec![serde_json::json!({"tool": "test", "version": "1"})],
        ..Meta::new([2, 3], [4, 5], 3, ColourSpace::Linear)
    };
    LightField { meta, data }
}

#[test]
fn a_light_field_directory() {
    let truth = field();
    let path = golden("golden-1-lightfield", |path| {
        let mut sink = lightfield::create(path, truth.meta.clone(), Format::Directory, false).unwrap();
        for v in 0..2 {
            for u in 0..3 {
                sink.write(v, u, &truth.data.slice(ndarray::s![v, u, .., .., ..]).to_owned()).unwrap();
            }
        }
        sink.finish().unwrap();
    });
    assert_eq!(load(&path, &ReadOptions::default()).unwrap(), truth);
}
