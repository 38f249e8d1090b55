//! `simulate`, and the way back from its captures: calibrate, decode, compare with the truth.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::path::Path;
use std::process::{Command, Output};

use lenslet_core::calibration::{self, Calibration};
use lenslet_core::container;
use lenslet_core::decode::{self, HexSamples};
use lenslet_core::dictionary::PatchPredictor;
use lenslet_core::geometry::Size;
use lenslet_core::image::GaussianFilter;
use lenslet_core::lightfield::{self, ColourSpace, ReadOptions, colour};
use lenslet_core::metrics;
use lenslet_core::progress::Silent;
use lenslet_data_gen::simulate::{
    self, Camera, Imperfections, Lenslets, Scene, SceneName, ScenePair, Simulation, SimulationOptions,
};
use lenslet_views::reconstruct::{self, Mode};
use lenslet_views::{Learned, Method, RenderSamples as _};
use ndarray::{Array2, Array3, s};

fn lenslet(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lenslet")).arg("-q").args(arguments).output().unwrap()
}

/// Takes a capture of a named scene on a small sensor and calibrates from its white images.
fn taken(kind: SceneName, side: usize, noise: f64) -> (Camera, Scene, Simulation, Calibration) {
    let camera = Camera::with_sensor(side);
    let options = SimulationOptions { seed: 3, noise, ..SimulationOptions::default() };
    let scene = Scene::named(kind, &camera, None, 3, &Silent).unwrap();
    let simulation = simulate::render_capture(&scene, &camera, &options, &Silent).unwrap();
    let found =
        calibration::calibrate(&simulation.whites, &calibration::CalibrationOptions::default(), &Silent).unwrap();
    (camera, scene, simulation, found)
}

fn central(simulation: &Simulation, found: &Calibration) -> HexSamples {
    let options = decode::Options { views: 1, ..decode::Options::default() };
    decode::sample_views(&simulation.capture, found, &options, &Silent).unwrap()
}

/// The central view by `method`, sRGB-encoded.
fn view(samples: &HexSamples, target: Size, method: Method) -> Array3<f32> {
    samples.renderer(method).size(target).prepare().unwrap().view(0, 0).unwrap().encode().into_pixels()
}

fn luminance_psnr(a: &Array3<f32>, b: &Array3<f32>) -> f64 {
    metrics::Scores::between(a.view(), b.view(), &metrics::Window::without_border(12)).unwrap().psnr_y
}

#[test]
fn calibration_finds_the_true_centres_and_methods_come_in_their_order() {
    let (camera, scene, simulation, found) = taken(SceneName::Natural, 820, 0.0);
    let lenslets = Lenslets::new(&camera, 3).unwrap();
    let squares: f64 = found.lenslets.iter().map(|l| lenslets.nearest(l.x, l.y).1).sum();
    let rms = (squares / found.lenslets.len() as f64).sqrt();
    assert!(rms < 0.1, "centres are {rms} px RMS from the truth");
    let (n, all) = (found.lenslets.len() as f64, simulation.centres.len() as f64);
    assert!((n / all - 1.0).abs() < 0.03, "{n} of {all} lenslets");
    assert!((found.lattice.pitch() - camera.lenslets.pitch).abs() < 0.005, "{}", found.lattice.pitch());
    assert!((found.lattice.rotation() - camera.lenslets.rotation).abs() < 0.0005, "{}", found.lattice.rotation());

    let size = simulate::output_size(&camera, 270);
    let mut truth = simulate::true_view(&scene, &camera, [0.0, 0.0], size);
    colour::convert(&mut truth, ColourSpace::Linear, ColourSpace::Srgb);
    let samples = central(&simulation, &found);
    let target = size;
    let psnr = |method| luminance_psnr(&view(&samples, target, method), &truth);
    let (bicubic, barycentric, cubic) = (psnr(Method::bicubic()), psnr(Method::barycentric()), psnr(Method::cubic()));
    let by = |mode| {
        let options = reconstruct::Options { mode, ..reconstruct::Options::default() };
        psnr(Method::barycentric().learned_with(Learned { options, ..Learned::default() }))
    };
    let (learned, no_codes, ridge) =
        (by(Mode::Learned), by(Mode::Only(PatchPredictor::NoCodes)), by(Mode::Only(PatchPredictor::Ridge)));
    println!("bicubic {bicubic:.2} dB, barycentric {barycentric:.2} dB, cubic {cubic:.2} dB");
    println!("no codes {no_codes:.2} dB, ridge {ridge:.2} dB, LASSO {learned:.2} dB");
    assert!(bicubic > 20.0 && barycentric > bicubic + 0.5, "{bicubic} {barycentric}");
    // Half of the margins of `cargo test --release --test simulate calibration -- --nocapture`: +1.63, +0.18, +0.69, +0.42.
    for (worse, least) in [(barycentric, 0.8), (cubic, 0.09), (no_codes, 0.34), (ridge, 0.21)] {
        assert!(learned > worse + least, "{learned} is not {least} over {worse}");
    }
}

#[test]
fn white_decodes_to_even_white_and_colours_to_themselves() {
    let (_, _, simulation, found) = taken(SceneName::White, 400, 0.0);
    let samples = central(&simulation, &found);
    let inside = |c: &[f64; 2]| c.iter().all(|v| (20.0..380.0).contains(v));
    for channel in 0..3 {
        let values: Vec<f32> = samples
            .centres
            .iter()
            .enumerate()
            .filter(|(_, c)| inside(c))
            .map(|(k, _)| samples.values[[0, k, channel]])
            .collect();
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        let spread = (values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / values.len() as f32).sqrt();
        println!("white, channel {channel}: mean {mean:.4}, deviation {spread:.4}");
        assert!(values.len() > 1000 && (mean / simulate::WHITE - 1.0).abs() < 0.006, "channel {channel}: {mean}");
        assert!(spread / mean < 0.002, "channel {channel}: {spread}");
    }

    let (_, scene, simulation, found) = taken(SceneName::Colour, 600, 0.0);
    let samples = central(&simulation, &found);
    let mut worst = 0f32;
    for region in &scene.regions {
        let [left, top, right, bottom] = region.bounds.map(|b| b * 600.0);
        let seen: Vec<usize> = (0..samples.centres.len())
            .filter(|k| {
                let [x, y] = samples.centres[*k];
                x > left + 15.0 && x < right - 15.0 && y > top + 15.0 && y < bottom - 15.0
            })
            .collect();
        assert!(seen.len() > 10);
        for channel in 0..3 {
            let mean = seen.iter().map(|k| samples.values[[0, *k, channel]]).sum::<f32>() / seen.len() as f32;
            worst = worst.max((mean - region.colour.unwrap()[channel]).abs());
        }
    }
    println!("colours: worst channel off by {worst:.4} of full scale");
    assert!(worst < 0.01, "{worst}");
}

fn files(root: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![root.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                found.push((path.strip_prefix(root).unwrap().display().to_string(), std::fs::read(&path).unwrap()));
            }
        }
    }
    found.sort();
    found
}

#[test]
fn the_command_writes_everything_and_the_same_on_any_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let run = |name: &str, seed: &str, threads: &str| {
        let out = dir.path().join(name);
        let output = lenslet(&[
            "--threads",
            threads,
            "--json",
            "simulate",
            "--scene",
            "planes",
            "--sensor",
            "200",
            "--size",
            "66",
            "--views",
            "3",
            "--seed",
            seed,
            "--out",
            out.to_str().unwrap(),
        ]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(json["whites"], 2);
        files(&out)
    };
    let (one, three, other) = (run("one", "7", "1"), run("three", "7", "3"), run("other", "8", "2"));
    let names: Vec<_> = one.iter().map(|f| f.0.as_str()).collect();
    for name in
        ["capture.lfp", "white-00.lfp", "white-01.lfp", "truth/centres.npy", "truth/disparity.npy", "truth/scene.json"]
    {
        assert!(names.contains(&name), "{name} is missing from {names:?}");
    }
    for truth in ["truth/views", "truth/sharp"] {
        assert_eq!(names.iter().filter(|n| n.starts_with(truth) && n.ends_with(".png")).count(), 9, "{truth}");
    }
    assert_eq!(one, three);
    for name in ["capture.lfp", "truth/centres.npy"] {
        let of = |all: &[(String, Vec<u8>)]| all.iter().find(|f| f.0 == name).unwrap().1.clone();
        assert_ne!(of(&one), of(&other), "{name} does not follow the seed");
    }

    // What was written is what was simulated.
    let camera = Camera::with_sensor(200);
    let scene = Scene::named(SceneName::Planes, &camera, None, 7, &Silent).unwrap();
    let simulation = simulate::render_capture(
        &scene,
        &camera,
        &SimulationOptions { seed: 7, ..SimulationOptions::default() },
        &Silent,
    )
    .unwrap();
    let capture = container::open_capture(&dir.path().join("one/capture.lfp"), None).unwrap();
    assert_eq!(capture.mosaic, simulation.capture.mosaic);
    assert_eq!(capture.colour.white_balance, simulation.capture.colour.white_balance);
    assert!(capture.warnings.is_empty(), "{:?}", capture.warnings);
    let centres: Array2<f64> = ndarray_npy::read_npy(dir.path().join("one/truth/centres.npy")).unwrap();
    assert_eq!(centres.dim(), (simulation.centres.len(), 2));
    let views = lightfield::load(&dir.path().join("one/truth/views"), &ReadOptions::default()).unwrap();
    let mut corner = simulate::true_view(&scene, &camera, [-1.0, 1.0], Size::new(66, 66));
    colour::convert(&mut corner, ColourSpace::Linear, ColourSpace::Srgb);
    let stored = views.data.slice(s![2, 0, .., .., ..]);
    assert!(corner.iter().zip(&stored).all(|(a, b)| (a - b).abs() < 1e-4));
}

#[test]
fn lenslets_gather_the_sharp_scene() {
    let camera = Camera::with_sensor(300);
    let scenes = ScenePair::draw(&camera, |camera| Scene::named(SceneName::Slanted, camera, None, 4, &Silent)).unwrap();
    let size = Size::new(200, 200);
    let by = |scene: &Scene| simulate::true_view(scene, &camera, [1.0, -1.0], size);
    let (gathered, sharp) = (by(&scenes.gathered), by(&scenes.sharp));
    // What the sharp scene lacks of the lenslets' blur, in output pixels.
    let pixels = camera.lenslets.pitch * 200.0 / 300.0;
    let sigma = (camera.optics.footprint.powi(2) - camera.sharp().optics.footprint.powi(2)).sqrt() * pixels;
    let (mut error, mut change) = (0.0, 0.0);
    for c in 0..3 {
        let mut blurred: Vec<f32> = sharp.slice(s![.., .., c]).iter().copied().collect();
        GaussianFilter::new(sigma as f32, 4.0).smooth(&mut blurred, size);
        let blurred = Array2::from_shape_vec((200, 200), blurred).unwrap();
        let inner = s![20..180, 20..180];
        let squares = |a: &Array2<f32>, b: &Array2<f32>| (&a.slice(inner) - &b.slice(inner)).mapv(|d| d * d).sum();
        let channel = |a: &Array3<f32>| a.slice(s![.., .., c]).to_owned();
        error += squares(&channel(&gathered), &blurred);
        change += squares(&channel(&gathered), &channel(&sharp));
    }
    assert!(error < 0.02 * change, "blurred, the sharp truth is what lenslets gather: {error} of {change}");
}

#[test]
fn every_imperfection_is_written_and_read_again() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    for name in Imperfections::NAMES {
        let folder = at(name);
        let base = ["simulate", "--scene", "white", "--sensor", "220", "--size", "60", "--views", "1"];
        let out = lenslet(&[&base[..], &["--optics", name, "--out", &folder]].concat());
        assert!(out.status.success(), "{name}: {}", String::from_utf8_lossy(&out.stderr));
        let jpeg = ["jpeg", "real"].contains(&name);
        let capture = format!("{folder}/capture.{}", if jpeg { "jpg" } else { "lfp" });
        let out = lenslet(&["info", &capture]);
        assert!(out.status.success(), "{capture}: {}", String::from_utf8_lossy(&out.stderr));
        // The simulated camera's own colours, also of a JPEG, which does not say them.
        let said = String::from_utf8_lossy(&out.stdout);
        assert!(said.contains("white balance: 1.0 1.117188 1.117188 1.722656"), "{said}");
        // Lenslet's own folder: it takes its place again when asked to, and only then.
        let again = [&base[..], &["--optics", name, "--out", &folder]].concat();
        assert!(!lenslet(&again).status.success());
        assert!(lenslet(&[&again[..], &["--force"]].concat()).status.success());
    }
}

#[test]
fn photos_become_layers() {
    let dir = tempfile::tempdir().unwrap();
    let photo = |name: &str, of: &dyn Fn(u32, u32) -> [u8; 3]| {
        let path = dir.path().join(name);
        image::RgbImage::from_fn(120, 90, |x, y| image::Rgb(of(x, y))).save(&path).unwrap();
        path
    };
    let back = photo("back.png", &|x, y| [(x * 2) as u8, (y * 2) as u8, 90]);
    let print = photo("print.png", &|_, _| [250, 20, 20]);
    let camera = Camera::with_sensor(300);
    let alone = simulate::photo_scene(std::slice::from_ref(&back), &camera, None, 1, &Silent).unwrap();
    // One photo alone lies at disparity 0: the middle of the canvas is the photo's middle, in every view.
    for delta in [[0.0, 0.0], [3.0, -2.0]] {
        let seen = alone.sample(149.5, 149.5, delta).map(|v| lenslet_core::colour::srgb_encode(v / 0.95) * 255.0);
        assert!((seen[0] - 119.0).abs() < 3.0 && (seen[1] - 89.0).abs() < 3.0, "{seen:?}");
    }
    let both = simulate::photo_scene(&[back, print], &camera, None, 1, &Silent).unwrap();
    let map = simulate::true_disparity(&both, &camera, 1.0, Size::new(100, 100));
    let near = map.iter().filter(|d| (**d - 0.3 * 9.9276 / 3.0).abs() < 1e-3).count();
    let far = map.iter().filter(|d| (**d + 0.3 * 9.9276 / 3.0).abs() < 1e-3).count();
    assert!(near > 300 && far > 3000 && near + far == 10_000, "{near} {far}");
}

#[test]
fn wrong_use_is_told_in_one_line_and_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let out_name = out.to_str().unwrap();
    let text = dir.path().join("text.png");
    std::fs::write(&text, "not a picture").unwrap();
    let cases: [(&[&str], i32, &str); 12] = [
        (&["--sensor", "63"], 2, "63"),
        (&["--sensor", "100000"], 2, "100000"),
        (&["--scene", "nowhere"], 2, "nowhere"),
        (&["--pitch", "nan"], 2, "pitch"),
        (&["--noise", "-1"], 2, "noise"),
        (&["--views", "4"], 2, "views"),
        (&["--size", "0"], 2, "size"),
        (&["--disparity", "inf"], 2, "disparity"),
        (&["--offset", "1"], 2, "offset"),
        (&["--whites", "99"], 2, "99"),
        (&["--photo", text.to_str().unwrap()], 1, "text.png"),
        (&["--photo", "/nowhere.jpg"], 1, "nowhere.jpg"),
    ];
    for (arguments, code, word) in cases {
        let mut all = vec!["simulate", "--out", out_name];
        if !arguments.contains(&"--sensor") {
            all.extend(["--sensor", "200"]);
        }
        all.extend(arguments);
        let output = lenslet(&all);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {said}");
        assert!(said.contains(word), "{arguments:?}: {said}");
        assert!(said.starts_with("error:") || said.trim_end().lines().count() == 1, "{said}");
        assert!(output.stdout.is_empty());
    }
    assert!(!out.exists());
    std::fs::create_dir(&out).unwrap();
    let output = lenslet(&["simulate", "--out", out_name]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("--force"));
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 2);
}
