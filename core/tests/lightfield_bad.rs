//! Damaged light fields: cut off at every length and with random changes, every reader answers with an error or with
//! finite values of the declared shape, and never panics.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::fs;
use std::path::{Path, PathBuf};

use lenslet_core::lightfield::{ColourSpace, Error, Format, LightField, Meta, ReadOptions, create, load};
use ndarray::{Array3, Array5, ShapeBuilder};
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};

/// Changed copies of each file that are tried; LENSLET_MUTATIONS asks for more (20000 take minutes, all of them file
/// access).
fn mutations() -> usize {
    std::env::var("LENSLET_MUTATIONS").ok().and_then(|n| n.parse().ok()).unwrap_or(500)
}

fn reference(name: &str) -> Vec<u8> {
    fs::read(PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/reference").join(name)).unwrap()
}

fn read(path: &Path, views: Option<[usize; 2]>) -> Result<LightField, Error> {
    // A change can make a small file declare a large light field, which is fine as long as somebody says no.
    load(path, &ReadOptions { views, max_bytes: 64 << 20, ..ReadOptions::default() })
}

fn sound(result: Result<LightField, Error>) -> bool {
    match result {
        Ok(field) => {
            let (t, s, c) = field.meta.view_shape();
            assert_eq!(field.data.dim(), (field.meta.views[0], field.meta.views[1], t, s, c));
            assert!(field.data.iter().all(|x| x.is_finite()));
            true
        }
        Err(e) => {
            assert!(!e.to_string().is_empty());
            false
        }
    }
}

/// What guards a file's numbers.
#[derive(Clone, Copy, PartialEq)]
enum Guard {
    /// A checksum over all of them: a changed file is refused, or read as it was written.
    Checksum,
    /// Nothing: a changed number is another number. This share of changes, in percent, is refused at least, since it hits
    /// what describes the numbers.
    Description(usize),
}

/// Cuts and changes the file `name` of a light field at `root`; `whole` is its sound content and `spare` the number of
/// bytes at its end that nobody needs.
fn torment(root: &Path, name: &str, whole: &[u8], spare: usize, views: Option<[usize; 2]>, guard: Guard) {
    let file = if name.is_empty() { root.to_path_buf() } else { root.join(name) };
    fs::write(&file, whole).unwrap();
    let truth = read(root, views).expect("sound to begin with").data;
    for length in 0..whole.len() {
        fs::write(&file, &whole[..length]).unwrap();
        let sound = sound(read(root, views));
        assert!(!sound || length >= whole.len() - spare, "{} bytes of {name} were taken for sound", length);
    }
    let mut rng = ChaCha8Rng::seed_from_u64(whole.len() as u64);
    let mut survived = 0;
    let mutations = mutations();
    for _ in 0..mutations {
        let mut bytes = whole.to_vec();
        for _ in 0..rng.random_range(1..4) {
            let at = rng.random_range(0..bytes.len());
            match rng.random_range(0..4) {
                0 => bytes[at] = rng.random(),
                1 => bytes[at] ^= 1 << rng.random_range(0..8),
                2 => bytes[at] = [0x00, 0xff, 0x7f, 0x80][rng.random_range(0..4)],
                _ => {
                    let end = (at + rng.random_range(1..9)).min(bytes.len());
                    bytes[at..end].fill([0x00, 0xff, b'9'][rng.random_range(0..3)]);
                }
            }
        }
        fs::write(&file, &bytes).unwrap();
        let result = read(root, views);
        if guard == Guard::Checksum
            && let Ok(field) = &result
        {
            assert_eq!(field.data, truth, "a changed {name} is read as another light field");
        }
        survived += usize::from(sound(result));
    }
    println!("{}: {survived} of {mutations} changes were read", file.display());
    let least = if let Guard::Description(share) = guard { share } else { 50 };
    assert!(100 * (mutations - survived) >= least * mutations, "{survived} of {mutations} changes to {name} were read");
    fs::write(&file, whole).unwrap();
}

fn pattern() -> Array5<f32> {
    Array5::from_shape_fn((2, 2, 3, 4, 3), |(v, u, t, s, c)| (v + 2 * u + 3 * t + 4 * s + c) as f32 / 30.0)
}

#[test]
fn npy() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.npy");
    for fortran in [false, true] {
        let mut data = Array5::<f32>::zeros((2, 2, 3, 4, 3).set_f(fortran));
        data.assign(&pattern());
        ndarray_npy::write_npy(&path, &data).unwrap();
        let whole = fs::read(&path).unwrap();
        torment(&path, "", &whole, 0, None, Guard::Description(20));
    }
}

#[test]
fn matlab() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.mat");
    // Behind the light field there is nothing but padding, or the checksum of the compressed stream.
    torment(&path, "", &reference("lf_uint16_plain.mat"), 0, None, Guard::Description(5));
    torment(&path, "", &reference("lf_uint16_compressed.mat"), 0, None, Guard::Checksum);
}

fn directory(root: &Path) -> LightField {
    let data = pattern();
    let meta =
        Meta { provenance: vec![serde_json::json!({"tool": "x"})], ..Meta::new([2, 2], [3, 4], 3, ColourSpace::Srgb) };
    let mut sink = create(root, meta.clone(), Format::Directory, false).unwrap();
    for (v, row) in data.outer_iter().enumerate() {
        for (u, view) in row.outer_iter().enumerate() {
            let view: Array3<f32> = view.to_owned();
            sink.write(v, u, &view).unwrap();
        }
    }
    sink.finish().unwrap();
    LightField { meta, data }
}

#[test]
fn description() {
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path().join("lf");
    directory(&root);
    let whole = fs::read(root.join("lightfield.json")).unwrap();
    torment(&root, "lightfield.json", &whole, 1, None, Guard::Description(50));
}

#[test]
fn views_of_a_directory_and_lenslet_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path().join("lf");
    directory(&root);
    let whole = fs::read(root.join("view_01_00.png")).unwrap();
    // A PNG decoder may not ask for the end mark (12 bytes) nor the picture's last checksums (4 + 4).
    torment(&root, "view_01_00.png", &whole, 20, None, Guard::Checksum);
    let picture = dir.path().join("eslf.png");
    torment(&picture, "", &whole, 20, Some([1, 2]), Guard::Checksum);
}
