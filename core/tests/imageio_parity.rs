//! The same pixels as imageio's readers `lytro-f01-raw` and `lytro-illum-raw` (fixture and generator:
//! tests/reference/imageio_raw.*).

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use lenslet_core::container::{CameraProfile, open_capture};
use sha2::{Digest, Sha256};

#[test]
fn raw_pixels_are_those_of_imageio() {
    let fixture: serde_json::Value =
        serde_json::from_str(include_str!("../../tests/reference/imageio_raw.json")).unwrap();
    let dir = tempfile::tempdir().unwrap();
    for name in ["lytro-f01", "lytro-illum"] {
        let expected = &fixture[name];
        let length = CameraProfile::find(name).unwrap().raw_bytes().unwrap() as u64;
        let bytes: Vec<u8> = (0..length).map(|i| ((i * 2_654_435_761) >> 13 ^ (i * 40503) >> 3) as u8).collect();
        let path = dir.path().join("x.raw");
        std::fs::write(&path, bytes).unwrap();
        let mosaic = open_capture(&path, None).unwrap().mosaic;
        assert_eq!(
            (mosaic.width as u64, mosaic.height as u64),
            (expected["width"].as_u64().unwrap(), expected["height"].as_u64().unwrap())
        );
        for p in expected["pixels"].as_array().unwrap() {
            let at = |k: usize| p[k].as_u64().unwrap() as usize;
            assert_eq!(usize::from(mosaic.data[at(0) * mosaic.width + at(1)]), at(2), "{name} {p}");
        }
        let pixels: Vec<u8> = mosaic.data.iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(format!("{:x}", Sha256::digest(&pixels)), expected["sha256"].as_str().unwrap(), "{name}");
    }
}
