//! The examples that others call: keys, types and plausible values of the one JSON object that each prints.
//!
//! `cargo test` builds the examples with the tests; a run of this file alone uses those that were built last.

#![allow(clippy::unwrap_used, clippy::expect_used)] // a test may fail loudly

use std::path::{Path, PathBuf};
use std::process::Command;

use fixtures::real;
use lenslet_test_support::{Skip, skip};
use ndarray::{Array1, Array2};
use serde_json::Value;

mod fixtures;

/// What an example prints; nothing, and the calling test skipped, where it was not built.
#[track_caller]
fn example(name: &str, arguments: &[&str]) -> Option<Value> {
    let program = Path::new(env!("CARGO_BIN_EXE_lenslet")).with_file_name("examples").join(name);
    if !program.exists() {
        skip(Skip::Owed, &format!("{} was not built", program.display()));
        return None;
    }
    let output = Command::new(program).args(arguments).output().unwrap();
    assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_slice(&output.stdout).unwrap())
}

fn number(json: &Value, key: &str) -> f64 {
    json[key].as_f64().unwrap_or_else(|| panic!("{key} is no number in {json}"))
}

fn reference(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("core/tests/reference").join(name)
}

#[test]
fn sparse_code_solves_what_scikit_learn_solves() {
    let folder = tempfile::tempdir().unwrap();
    let objectives = folder.path().join("objectives.npy");
    let (atoms, signals) = (reference("sparse_atoms.npy"), reference("sparse_signals.npy"));
    let files = [atoms.to_str().unwrap(), signals.to_str().unwrap()];
    let options = ["0.3", "--threads", "2", "--tol", "1e-6", "--objectives", objectives.to_str().unwrap()];
    let Some(said) = example("sparse_code", &[&files[..], &options].concat()) else { return };
    // Objectives of scikit-learn, one a signal.
    let theirs: Array1<f64> = ndarray_npy::read_npy(reference("sparse_sklearn_0.3.npy")).unwrap();
    let mean = theirs.iter().sum::<f64>() / theirs.len() as f64;
    let found = number(&said, "mean_objective");
    assert!((found / mean - 1.0).abs() < 1e-4, "{found} against {mean}");
    let ours: Array1<f64> = ndarray_npy::read_npy(&objectives).unwrap();
    assert_eq!(ours.len(), theirs.len());
    assert!(ours.iter().zip(theirs.iter()).all(|(o, t)| (o - t).abs() < 1e-4 * t.max(1.0)));
    assert!((ours.mean().unwrap() - found).abs() < 1e-9);
    assert_eq!(said["objectives_file"], objectives.to_str().unwrap());
    let nonzeros = number(&said, "mean_nonzeros");
    assert!((1.0..30.0).contains(&nonzeros), "{nonzeros}");
    assert!(number(&said, "max_gap") >= 0.0 && number(&said, "max_gap") < 1e-3, "{said}");
    let rate = theirs.len() as f64 / number(&said, "seconds");
    assert!((number(&said, "patches_per_second") / rate - 1.0).abs() < 1e-6, "{said}");
    assert!(number(&said, "cpu_seconds") >= 0.0);
}

#[test]
fn centres_are_those_that_were_labelled() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("centres.npy");
    let white = real("f01-white-crop/white.png");
    let Some(said) = example("centres", &[white.to_str().unwrap(), out.to_str().unwrap()]) else { return };
    assert!(number(&said, "seconds") > 0.0);
    assert!((number(&said, "pitch") - 9.927).abs() < 0.03, "{said}");
    assert!((number(&said, "rotation") - 0.00213).abs() < 0.0007, "{said}");
    let found: Array2<f64> = ndarray_npy::read_npy(&out).unwrap();
    assert_eq!((Some(found.nrows() as u64), found.ncols()), (said["count"].as_u64(), 2));
    let labels = std::fs::read_to_string(real("f01-white-crop/centres.csv")).unwrap();
    let labels = labels.lines().filter_map(|l| l.split_once(','));
    let labels = labels.filter_map(|(x, y)| Some([x.parse::<f64>().ok()? - 0.5, y.parse::<f64>().ok()? - 0.5]));
    let near = |[x, y]: [f64; 2]| found.rows().into_iter().map(|c| (c[0] - x).hypot(c[1] - y)).fold(f64::MAX, f64::min);
    let distances: Vec<f64> = labels.map(near).collect();
    assert_eq!(distances.len(), 288);
    assert!(distances.iter().all(|d| *d < 1.0), "{distances:?}");
}

#[test]
fn hex_psnr_scores_every_method() {
    let folder = real("f01-jaramillo");
    let files =
        ["IMG_0001_066_07_06.png", "IMG_0001_033_04_08.png"].map(|f| folder.join(f).to_str().unwrap().to_owned());
    // Half of what LASSO gained over cubic interpolation when this was written (small pictures of a blurred camera).
    for (footprint, least) in [("point", 0.03), ("lenslet", 0.2)] {
        let dictionary = Path::new(env!("CARGO_MANIFEST_DIR")).join("dictionaries/default.lfd");
        let options = ["--footprint", footprint, "--seed", "3", "--dictionary", dictionary.to_str().unwrap()];
        let Some(said) = example("hex_psnr", &[&options[..], &[&files[0], &files[1]]].concat()) else { return };
        let images = said["images"].as_array().unwrap();
        assert_eq!(images.len(), 2);
        for (image, file) in images.iter().zip(&files) {
            assert!(file.ends_with(image["file"].as_str().unwrap()), "{image}");
        }
        let of = |method: &str, key: &str| number(&said["mean"][method], key);
        for method in ["bicubic", "barycentric", "cubic", "learned"] {
            assert!((15.0..45.0).contains(&of(method, "psnr")) && (0.3..1.0).contains(&of(method, "ssim")), "{said}");
            let mean = images.iter().map(|i| number(&i[method], "psnr")).sum::<f64>() / 2.0;
            assert!((mean - of(method, "psnr")).abs() < 1e-3, "{method}: {said}");
        }
        // Real views that no dictionary was trained on.
        assert!(of("barycentric", "psnr") > of("bicubic", "psnr"), "{said}");
        assert!(of("learned", "psnr") > of("cubic", "psnr") + least, "{footprint}: {said}");
    }
}
