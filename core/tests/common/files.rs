//! Small sound files of every kind to be damaged, and what is asked of whoever reads them.

#![allow(dead_code, clippy::print_stdout)] // every test file uses a part, and says what it did

use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};

use lenslet_core::calibration::{
    Calibration, CalibrationOrigin, CalibrationQuality, Grid, Lattice, Lenslet, Vignetting,
};
use lenslet_core::container::segments::Container;
use lenslet_core::container::{CameraFacts, Capture, Cfa, ColourFacts, Levels, MlaHint, RawMosaic, write_lfp};
use lenslet_core::decode::HexSamples;
use lenslet_core::dictionary::{
    Anchored, Dictionary, Footprint, Layer, Model, Network, PatchModel, Recipe, SideInput, Storage,
};
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use ndarray::{Array1, Array2, Array3};

/// A capture of 16×16 pixels.
pub fn capture() -> Capture {
    capture_of(16)
}

/// A capture of this many pixels a side.
pub fn capture_of(side: usize) -> Capture {
    Capture {
        mosaic: RawMosaic {
            width: side,
            height: side,
            data: (0..side * side).map(|i| (i * 13 % 4096) as u16).collect(),
        },
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
        jpeg: false,
        white: None,
        warnings: Vec::new(),
    }
}

/// What every capture must keep, however odd its file.
pub fn check(c: &Capture) {
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
pub fn line(e: impl std::fmt::Display) {
    let text = e.to_string();
    assert!(!text.is_empty() && text.len() < 5000, "{text}");
}

/// A file that is written anew for each reading.
pub struct Slot {
    pub dir: tempfile::TempDir,
    pub path: PathBuf,
}

impl Slot {
    pub fn new(name: &str) -> Slot {
        let base = Path::new("/dev/shm");
        let dir = if base.is_dir() { tempfile::tempdir_in(base) } else { tempfile::tempdir() }.unwrap();
        Slot { path: dir.path().join(name), dir }
    }

    pub fn put(&self, bytes: &[u8]) -> &Path {
        fs::write(&self.path, bytes).unwrap();
        &self.path
    }
}

/// The most memory this process had so far, MiB; 0 where the system does not tell.
pub fn peak() -> usize {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with("VmHWM:")).unwrap_or_default();
    line.split_whitespace().nth(1).and_then(|n| n.parse::<usize>().ok()).unwrap_or(0) / 1024
}

/// Runs a test's body in a process of its own, and asks that it needs less than `mib` MiB: what other tests take at the same
/// time does not count. `test` is the test's path as the harness names it.
pub fn alone(test: &str, mib: usize, body: impl FnOnce()) {
    const ALONE: &str = "LENSLET_TEST_ALONE";
    if std::env::var(ALONE).is_ok_and(|name| name == test) {
        body();
        println!("{test}: peak memory {} MiB", peak());
        assert!(peak() < mib, "{} MiB", peak());
        return;
    }
    let mut again = std::process::Command::new(std::env::current_exe().unwrap());
    again.args(["--exact", test, "--include-ignored", "--nocapture", "--test-threads=1"]).env(ALONE, test);
    let output = again.output().unwrap();
    let said = [&output.stdout[..], &output.stderr].concat();
    let said = String::from_utf8_lossy(&said);
    assert!(output.status.success() && said.contains("1 passed"), "{said}");
    println!("{said}");
}

/// A number that tells values apart, from what `Debug` says of them.
pub fn told(value: &impl std::fmt::Debug) -> u64 {
    let mut hasher = DefaultHasher::new();
    format!("{value:?}").hash(&mut hasher);
    hasher.finish()
}

/// The same of numbers, by their bits.
pub fn bits<'a>(values: impl IntoIterator<Item = &'a f32>) -> u64 {
    let mut hasher = DefaultHasher::new();
    values.into_iter().for_each(|v| v.to_bits().hash(&mut hasher));
    hasher.finish()
}

/// The same of a capture's pixels and of all that is needed to develop them.
pub fn pixels(c: &Capture) -> u64 {
    let mut hasher = DefaultHasher::new();
    c.mosaic.data.hash(&mut hasher);
    (c.mosaic.width, c.mosaic.height, told(&(c.cfa, &c.levels, &c.colour))).hash(&mut hasher);
    hasher.finish()
}

/// A container of the capture of [`capture`].
pub fn container_bytes(white: bool) -> Vec<u8> {
    container_of(16, white)
}

/// A container of a capture of this many pixels a side, with a white image where asked.
pub fn container_of(side: usize, white: bool) -> Vec<u8> {
    let slot = Slot::new("a.lfp");
    let mut c = capture_of(side);
    if white {
        c.white = Some(Box::new(capture_of(side)));
    }
    write_lfp(&slot.path, &c, false).unwrap();
    fs::read(&slot.path).unwrap()
}

/// A tar archive of these files.
pub fn tar(files: &[(&str, &[u8])]) -> Vec<u8> {
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
pub fn parts() -> [Vec<u8>; 3] {
    parts_of(16)
}

/// The same of a capture of this many pixels a side.
pub fn parts_of(side: usize) -> [Vec<u8>; 3] {
    let c = Container::from_bytes(Path::new("a"), container_of(side, false)).unwrap();
    [1, 2, 3].map(|k| c.payload(&c.segments[k]).unwrap())
}

/// A calibration with a white image of 64×48.
pub fn small_calibration() -> Calibration {
    calibration_of(64, 48)
}

/// A calibration with a white image of this size.
pub fn calibration_of(width: usize, height: usize) -> Calibration {
    let lenslets =
        (0..20).map(|k| Lenslet { i: k % 5, j: k / 5, x: f64::from(k) * 3.0, y: f64::from(k), trust: 0.5 }).collect();
    let origin = [(width - 1) as f64 / 2.0, (height - 1) as f64 / 2.0];
    Calibration {
        width,
        height,
        lattice: Lattice { grid: Grid::HexRows, origin, a: [10.0, 0.03], b: [5.0, 8.66] },
        lenslets,
        quality: CalibrationQuality {
            residual_rms: 0.01,
            rejected: 0.0,
            confidence: 0.9,
            ..CalibrationQuality::default()
        },
        vignetting: Some(Vignetting { width, height, white: (0..width * height).map(|i| i as u16 * 10).collect() }),
        hot_pixels: Vec::new(),
        origin: CalibrationOrigin { method: "white".into(), ..CalibrationOrigin::default() },
    }
}

/// Samples of 3×3 views and this many lenslets.
pub fn small_samples(lenslets: i32) -> HexSamples {
    HexSamples {
        sensor: Size::new(64, 48),
        centres: (0..lenslets).map(|k| [f64::from(k), f64::from(k) * 2.0]).collect(),
        index: (0..lenslets).map(|k| [k, 0]).collect(),
        views: 3,
        view_step: 1.0,
        weights: vec![1.0; 9],
        values: Array3::from_shape_fn((9, lenslets as usize, 3), |(v, l, c)| (v + l + c) as f32),
    }
}

/// A dictionary of one model and a handful of atoms.
pub fn small_dictionary() -> Dictionary {
    let unit = |k: usize| Array2::from_shape_fn((k, 4), |(r, c)| if c == r % 4 { 1.0 } else { 0.0 });
    let patch_model = PatchModel {
        support: 5,
        patch: 3,
        filters: Array2::from_shape_fn((4, 25), |(r, c)| (r + c) as f32 * 0.01),
        floor: 0.1,
        lambda: 0.05,
        low: unit(6),
        high: Array2::from_elem((6, 9), 0.25),
        ridge: Array2::from_elem((4, 9), 0.125),
        anchored: Some(Anchored { anchors: unit(3), maps: Array3::from_elem((3, 4, 9), 0.5) }),
        network: Some(Network {
            support: 5,
            side_inputs: vec![SideInput::Cubic],
            filters_per_input: vec![2, 1],
            filters: Array2::from_shape_fn((3, 25), |(r, c)| (r + c) as f32 * 0.01),
            floor: 0.1,
            layers: vec![
                Layer { weights: Array2::from_elem((2, 4), 0.5), bias: Array1::from_elem(2, 0.125) },
                Layer { weights: Array2::from_elem((9, 2), 0.25), bias: Array1::zeros(9) },
            ],
        }),
    };
    let recipe = Recipe { tool: "test".into(), algorithm: "ksvd".into(), ..Recipe::default() };
    let model = Model { footprint: Footprint::Lenslet, base: Interpolation::Barycentric, pitch: 3.29, patch_model };
    Dictionary { recipe, storage: Storage::I8, models: vec![model] }
}

/// A dictionary as tensors whose checksum is under a key that nobody reads.
pub fn without_checksum(tensors: &[u8]) -> Vec<u8> {
    let at = tensors.windows(8).position(|w| w == b"\"sha256\"").unwrap();
    let mut bytes = tensors.to_vec();
    bytes[at + 1] = b'x';
    assert!(lenslet_core::dictionary::from_bytes(&bytes, "a").is_ok());
    bytes
}

/// Length of a dictionary file's header.
pub fn dictionary_header(bytes: &[u8]) -> usize {
    u64::from_le_bytes(bytes[16..24].try_into().unwrap()) as usize
}
