//! SSIM and PSNR against scikit-image, on pictures stored by `reference/make_ssim_fixture.py`.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::path::PathBuf;

use lenslet_core::metrics::{SsimWindow, psnr, ssim};
use ndarray::Array2;

fn reference(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/reference").join(name)
}

#[test]
fn same_as_scikit_image() {
    let text = std::fs::read_to_string(reference("ssim.json")).unwrap();
    let expected: serde_json::Value = serde_json::from_str(&text).unwrap();
    let picture: Array2<f32> = ndarray_npy::read_npy(reference("ssim_reference.npy")).unwrap();
    let cases = expected["cases"].as_object().unwrap();
    assert_eq!(cases.len(), 5);
    for (name, scores) in cases {
        let other: Array2<f32> = ndarray_npy::read_npy(reference(&format!("ssim_{name}.npy"))).unwrap();
        let close = |got: f64, key: &str, tolerance: f64| {
            let expected = scores[key].as_f64().unwrap();
            assert!((got - expected).abs() < tolerance, "{name} {key}: {got}, scikit-image {expected}");
        };
        // Same formula in the same precision: only the order of sums differs.
        close(ssim(other.view(), picture.view(), SsimWindow::Gaussian).unwrap(), "gaussian", 1e-9);
        close(ssim(other.view(), picture.view(), SsimWindow::Uniform).unwrap(), "uniform", 1e-9);
        close(psnr(other.view(), picture.view()).unwrap(), "psnr", 1e-9);
    }
}
