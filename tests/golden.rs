//! Files of format version 1, kept for ever: they must load in every later version, number for number.
//! `reference/golden.sh` says how they were made.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::path::{Path, PathBuf};

use lenslet_core::calibration::{self, Calibration};
use lenslet_core::dictionary::{self, Dictionary, Footprint, Storage};
use lenslet_core::interpolation::Interpolation;
use sha2::{Digest, Sha256};

fn reference(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference").join(name)
}

fn hex(hash: Sha256) -> String {
    hash.finalize().iter().map(|b| format!("{b:02x}")).collect()
}

/// Everything measured: lattice, lenslets and white image, to the last bit.
fn calibration_hash(c: &Calibration) -> String {
    let mut hash = Sha256::new();
    let l = &c.lattice;
    for v in [l.origin, l.a, l.b].as_flattened() {
        hash.update(v.to_le_bytes());
    }
    for l in &c.lenslets {
        hash.update(l.i.to_le_bytes());
        hash.update(l.j.to_le_bytes());
        hash.update(l.x.to_le_bytes());
        hash.update(l.y.to_le_bytes());
        hash.update(l.trust.to_le_bytes());
    }
    c.vignetting.iter().flat_map(|v| &v.white).for_each(|v| hash.update(v.to_le_bytes()));
    hex(hash)
}

/// Every number of every matrix, in the order of the struct.
fn dictionary_hash(d: &Dictionary) -> String {
    let mut hash = Sha256::new();
    for parts in d.models.iter().map(|m| &m.patch_model) {
        hash.update(parts.floor.to_le_bytes());
        hash.update(parts.lambda.to_le_bytes());
        for matrix in [&parts.filters, &parts.low, &parts.high, &parts.ridge] {
            matrix.iter().for_each(|v| hash.update(v.to_le_bytes()));
        }
        if let Some(a) = &parts.anchored {
            a.anchors.iter().chain(&a.maps).for_each(|v| hash.update(v.to_le_bytes()));
        }
    }
    hex(hash)
}

#[test]
fn the_calibration_of_version_1_still_loads() {
    let c = calibration::load(&reference("golden-1.calib")).unwrap();
    assert_eq!((c.width, c.height, c.lenslets.len()), (160, 160, 304));
    assert!((c.lattice.pitch() - 9.927481).abs() < 1e-6);
    assert!((c.lattice.rotation() - 0.001936).abs() < 1e-6);
    assert!((c.quality.residual_rms - 0.069776).abs() < 1e-6);
    assert_eq!((c.origin.method.as_str(), c.origin.serial.as_deref()), ("white", Some("SIMULATED")));
    assert_eq!(calibration_hash(&c), "e05c36fd6115be8e4f09a76cf97327bbfd6becdc7ab126539f54d9a98193ac14");
}

#[test]
fn the_dictionaries_of_version_1_still_load() {
    for (name, storage, sum) in [
        ("golden-1.lfd", Storage::I8, "0eeadf3daef46e1b7efd4924630ea4faf547cd38ccb0dd0bfb9c9919431a3baf"),
        ("golden-1-f32.lfd", Storage::F32, "3b33046fad8f24a36e5b06bc37ba7b77ad7225defa9e8c3a0da35dc8ee5973b9"),
    ] {
        let d = dictionary::load(&reference(name)).unwrap();
        assert_eq!((d.storage, d.models.len()), (storage, 2));
        assert_eq!((d.recipe.algorithm.as_str(), d.recipe.seed, d.recipe.photos.len()), ("online", 1, 1));
        assert_eq!(d.recipe.parameters["neighbours"], 100);
        for (model, footprint) in d.models.iter().zip([Footprint::Point, Footprint::Lenslet]) {
            assert_eq!((model.footprint, model.base), (footprint, Interpolation::Barycentric));
            let parts = &model.patch_model;
            assert_eq!((parts.low.dim(), parts.high.dim()), ((12, 8), (12, 25)));
            assert_eq!(parts.anchored.as_ref().unwrap().maps.dim(), (6, 8, 25));
        }
        assert_eq!(dictionary_hash(&d), sum, "{name}");
    }
}

#[test]
fn a_version_of_the_future_is_refused_with_what_to_do() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["golden-1.calib", "golden-1.lfd"] {
        for version in [1000, u32::MAX] {
            let mut bytes = std::fs::read(reference(name)).unwrap();
            bytes[8..12].copy_from_slice(&version.to_le_bytes());
            let path = dir.path().join(name);
            std::fs::write(&path, &bytes).unwrap();
            let output =
                std::process::Command::new(env!("CARGO_BIN_EXE_lenslet")).arg("info").arg(&path).output().unwrap();
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{said}");
            for word in [name, &version.to_string(), "lenslet"] {
                assert!(said.contains(word), "{word}: {said}");
            }
            assert!(said.contains("update") || said.contains("newer lenslet"), "{said}");
        }
    }
}
