//! Training that is killed, resumed, short of disk space, or given photos that are hard to use.

#![allow(clippy::unwrap_used, clippy::expect_used)] // a test may fail loudly

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use lenslet_core::geometry::Size;
fn text(p: &Path) -> &str {
    p.to_str().unwrap()
}

/// Slanted stripes, different for each number.
fn photo(path: &Path, number: u32) {
    let (a, b) = (0.15 + 0.05 * number as f32, 0.3 - 0.04 * number as f32);
    image::GrayImage::from_fn(180, 160, |x, y| {
        let (x, y) = (x as f32, y as f32);
        let stripes = ((a * x + b * y).sin() * 2.0).clamp(-1.0, 1.0) + ((a * y - b * x) * 0.7).sin().signum();
        image::Luma([(127.0 + 50.0 * stripes) as u8])
    })
    .save(path)
    .unwrap();
}

/// A folder with `count` photos and a small recipe of two epochs of each kind; its name.
fn world(folder: &Path, count: u32) -> PathBuf {
    std::fs::create_dir(folder.join("photos")).unwrap();
    (0..count).for_each(|n| photo(&folder.join(format!("photos/{n}.png")), n));
    let recipe = folder.join("recipe.json");
    std::fs::write(
        &recipe,
        r#"{"atoms":24,"patch":5,"window":5,"features":16,"epochs":2,"refine":2,"batch":64,"pairs":2000,"crop":100,
            "crops":2,"shrink":1.0,"anchors":8,"neighbours":200,"footprints":["point"]}"#,
    )
    .unwrap();
    recipe
}

fn arguments(folder: &Path, out: &str) -> Vec<String> {
    let at = |name: &str| text(&folder.join(name)).to_owned();
    vec!["train-dict".into(), at("photos"), "--parameters".into(), at("recipe.json"), "--out".into(), at(out)]
}

fn run(arguments: &[String]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lenslet")).args(arguments).output().unwrap()
}

fn succeeds(output: &Output) -> String {
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{error}");
    error
}

#[test]
fn a_killed_run_loses_at_most_the_epoch_in_work() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    world(folder.path(), 3);
    succeeds(&run(&arguments(folder.path(), "whole.lfd")));

    let cut = arguments(folder.path(), "cut.lfd");
    let log = at("cut.lfd.log.jsonl");
    // Killed (SIGKILL) at once after its first epochs have been written down. A run that ends before the kill must have
    // lost nothing either, and another one is started.
    let met = (0..20).find_map(|_| {
        let mut child = Command::new(env!("CARGO_BIN_EXE_lenslet"))
            .args([&cut[..], &["--force".into()]].concat())
            .stderr(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let seen = loop {
            let lines = std::fs::read_to_string(&log).map_or(0, |t| t.lines().count());
            if (lines >= 2 && at("cut.lfd.checkpoint").exists()) || child.try_wait().unwrap().is_some() {
                break lines;
            }
            std::thread::yield_now();
        };
        let _ = child.kill();
        child.wait().unwrap();
        if !at("cut.lfd").exists() {
            return Some(seen);
        }
        assert_eq!(std::fs::read(at("cut.lfd")).unwrap(), std::fs::read(at("whole.lfd")).unwrap());
        std::fs::remove_file(at("cut.lfd")).unwrap();
        std::fs::remove_file(&log).unwrap();
        None
    });
    let seen = met.expect("every run ended before it could be killed");

    let resumed = run(&[cut, vec!["--resume".into()]].concat());
    let news = succeeds(&resumed);
    assert_eq!(std::fs::read(at("cut.lfd")).unwrap(), std::fs::read(at("whole.lfd")).unwrap());
    // Epochs that were done again are told again; of those seen before the kill that is at most one.
    let again = news.lines().filter(|l| l.contains("objective")).count();
    assert!(again + seen <= 5 + 1, "{seen} epochs before, {again} after: {news}");
    let epochs = |name: &str| -> Vec<serde_json::Value> {
        let text = std::fs::read_to_string(at(name)).unwrap();
        let mut all: Vec<serde_json::Value> = text.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
        all.iter_mut().for_each(|e| e["seconds"] = 0.into());
        all
    };
    assert_eq!(epochs("cut.lfd.log.jsonl"), epochs("whole.lfd.log.jsonl"));
    assert_eq!(epochs("cut.lfd.log.jsonl").len(), 5);
    assert!(epochs("cut.lfd.log.jsonl")[0]["held_out_psnr"].is_null(), "photos too small to hold a part out");
    for picture in ["cut.lfd.plot.svg", "cut.lfd.atoms.png"] {
        assert!(std::fs::metadata(at(picture)).unwrap().len() > 500, "{picture}");
    }
    assert!(image::open(at("cut.lfd.atoms.png")).is_ok());
    assert!(!at("cut.lfd.checkpoint").exists());
}

/// A limit on the size of files stands for a disk that is full: the same writes fail.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_said_and_training_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let recipe = world(folder.path(), 3);
    // Statistics grow with the square of the atoms, the dictionary does not.
    let text = std::fs::read_to_string(&recipe).unwrap().replace("\"atoms\":24", "\"atoms\":96");
    std::fs::write(&recipe, text).unwrap();
    let limited = |kilobytes: usize, out: &str| {
        let script = format!("trap '' XFSZ; ulimit -f {}; exec \"$@\"", 2 * kilobytes);
        let mut command = Command::new("sh");
        command.args(["-c", &script, "sh", env!("CARGO_BIN_EXE_lenslet")]).args(arguments(folder.path(), out));
        command.output().unwrap()
    };
    // Room for the dictionary, not for checkpoints.
    let done = limited(48, "small.lfd");
    let news = succeeds(&done);
    assert!(news.contains("no checkpoint of this epoch") && news.contains("small.lfd.checkpoint"), "{news}");
    assert!(at("small.lfd").exists() && !at("small.lfd.checkpoint").exists());

    // No room for anything.
    let done = limited(4, "none.lfd");
    let news = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(1), "{news}");
    let last = news.lines().last().unwrap();
    assert!(last.contains("none.lfd") && last.contains("too large"), "{news}");
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert!(left.iter().all(|n| n.to_string_lossy() != "none.lfd"), "{left:?}");
}

#[test]
fn photos_that_cannot_be_used_are_named_and_the_rest_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    world(folder.path(), 2);
    let at = |name: &str| folder.path().join("photos").join(name);
    std::fs::write(at("broken.jpg"), b"not a photo").unwrap();
    image::GrayImage::from_pixel(200, 200, image::Luma([90])).save(at("grey.png")).unwrap();
    image::GrayImage::from_pixel(1, 1, image::Luma([90])).save(at("dot.png")).unwrap();
    let mut cut = std::fs::read(at("0.png")).unwrap();
    cut.truncate(cut.len() / 2);
    std::fs::write(at("cut.png"), cut).unwrap();
    // A CMYK photo and one of 16 bit are photos like others.
    std::fs::copy(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/reference/cmyk.jpg"), at("cmyk.jpg")).unwrap();
    image::ImageBuffer::from_fn(150, 150, |x, y| image::Luma([((x * x + 7 * y) % 251) as u16 * 260]))
        .save(at("deep.png"))
        .unwrap();
    let out = run(&[arguments(folder.path(), "mine.lfd"), vec!["--json".into()]].concat());
    let news = succeeds(&out);
    let report: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(report["photos"], 4, "{news}");
    assert_eq!(report["skipped"].as_array().unwrap().len(), 4);
    for (name, why) in [("broken.jpg", ""), ("grey.png", "one colour"), ("dot.png", "too few"), ("cut.png", "")] {
        let line = news.lines().find(|l| l.contains(name)).unwrap_or_else(|| panic!("{name} is not named: {news}"));
        assert!(line.contains("left out") && line.contains(why), "{line}");
    }

    // Pairs: the same photos, the same words.
    let pairs = folder.path().join("pairs");
    let made = Command::new(env!("CARGO_BIN_EXE_lenslet"))
        .args([
            "gen-pairs",
            text(&folder.path().join("photos")),
            "--out",
            text(&pairs),
            "--pairs",
            "300",
            "--crop",
            "60",
        ])
        .output()
        .unwrap();
    let news = succeeds(&made);
    assert_eq!(news.lines().filter(|l| l.contains("left out")).count(), 4, "{news}");
}

#[test]
fn shipped_dictionaries_are_found_by_name() {
    for (name, footprint, pitch) in [("small", "lenslet", 3.2927), ("x2", "grid", 2.0), ("x3", "grid", 3.0)] {
        let shown = run(&["dict".into(), "show".into(), name.into(), "--json".into()]);
        succeeds(&shown);
        let shown: serde_json::Value = serde_json::from_slice(&shown.stdout).unwrap();
        assert_eq!(shown["models"][0]["footprint"], footprint, "{name}");
        assert!((shown["models"][0]["pitch"].as_f64().unwrap() - pitch).abs() < 1e-3, "{name}");
        assert_eq!(shown["recipe"]["photos"].as_array().unwrap().len(), 55, "{name}");
    }
    let absent = run(&["dict".into(), "show".into(), "x5".into()]);
    let error = String::from_utf8_lossy(&absent.stderr);
    assert!(absent.status.code() == Some(1) && error.contains("x5") && error.contains("x3"), "{error}");
}

/// Views of another tool: the scale chooses the dictionary, and the result is nearer to the truth than bicubic enlargement.
#[test]
fn views_of_other_tools_are_enlarged_by_their_own_dictionaries() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let value = |y: f64, x: f64| {
        let inside = |cx: f64, cy: f64, r: f64| ((r - (x - cx).hypot(y - cy)) * 4.0).clamp(0.0, 1.0);
        (0.25 + 0.5 * inside(50.0, 40.0, 25.0) - 0.2 * inside(62.0, 60.0, 18.0)) as f32
    };
    for scale in [2usize, 3] {
        let side = 96;
        let fine = ndarray::Array2::from_shape_fn((side, side), |(y, x)| value(y as f64, x as f64));
        let mean = |y: usize, x: usize| {
            fine.slice(ndarray::s![y * scale..(y + 1) * scale, x * scale..(x + 1) * scale]).mean().unwrap()
        };
        let small = side / scale;
        let field = ndarray::Array5::from_shape_fn((1, 1, small, small, 3), |(_, _, y, x, _)| mean(y, x));
        ndarray_npy::write_npy(at("field.npy"), &field).unwrap();
        let input = text(&at("field.npy")).to_owned();
        let infer = |out: &str, options: &[&str]| -> (serde_json::Value, f32) {
            let out = text(&at(out)).to_owned();
            let mut all = vec!["infer", &input, "--out", &out, "--force", "--json"];
            all.extend(options);
            let done = Command::new(env!("CARGO_BIN_EXE_lenslet")).args(all).output().unwrap();
            succeeds(&done);
            let sharp: ndarray::Array5<f32> = ndarray_npy::read_npy(&out).unwrap();
            let apart = (8..side - 8).flat_map(|y| (8..side - 8).map(move |x| (y, x)));
            let error = apart.map(|(y, x)| (sharp[[0, 0, y, x, 0]] - fine[[y, x]]).powi(2)).sum::<f32>();
            (serde_json::from_slice(&done.stdout).unwrap(), error)
        };
        let factor = scale.to_string();
        let (said, error) = infer("sharp.npy", &["--scale", &factor]);
        assert_eq!((&said["dictionary"], &said["footprint"]), (&format!("x{scale}").into(), &"grid".into()));
        let image = ndarray::Array3::from_shape_fn((small, small, 1), |(y, x, _)| field[[0, 0, y, x, 0]]);
        let plain = lenslet_core::sampling::bicubic::resize_bicubic(image.view(), Size::new(side, side)).unwrap();
        let apart = (8..side - 8).flat_map(|y| (8..side - 8).map(move |x| (y, x)));
        let bicubic = apart.map(|(y, x)| (plain[[y, x, 0]] - fine[[y, x]]).powi(2)).sum::<f32>();
        assert!(error < 0.9 * bicubic, "x{scale}: {error} against {bicubic}");
        assert_eq!(infer("named.npy", &["--scale", &factor, "--dictionary", "default"]).0["dictionary"], "default");
    }
}

#[test]
fn a_memory_budget_lowers_the_number_of_pairs() {
    let folder = tempfile::tempdir().unwrap();
    world(folder.path(), 3);
    let recipe = folder.path().join("recipe.json");
    let many = std::fs::read_to_string(&recipe).unwrap().replace("\"pairs\":2000", "\"pairs\":9000000,\"epochs\":1");
    std::fs::write(&recipe, many.replacen("\"epochs\":2,", "", 1)).unwrap();
    let news =
        succeeds(&run(&[arguments(folder.path(), "m.lfd"), vec!["--pairs-memory".into(), "0.05".into()]].concat()));
    assert!(news.contains("pairs instead of 9000000") && news.contains("0.05 GiB"), "{news}");
}

#[test]
fn refined_views_are_learned_through_the_lenslets_of_a_calibration() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    world(folder.path(), 3);
    // Rows stretched and lenslets askew, as no pitch and rotation can say.
    let lattice = lenslet_core::geometry::Lattice::hexagonal(10.2, 0.004, 1.03, [1600.0, 1600.0]);
    let mut camera = lenslet_core::calibration::Calibration::of_lattice(lattice, Size::new(3200, 3200));
    for l in &mut camera.lenslets {
        let askew = (l.x + 0.2 * f64::from((l.i + l.j).rem_euclid(3)), l.y - 0.2 * f64::from(l.i.rem_euclid(2)));
        (l.x, l.y) = (askew.0.clamp(0.0, 3199.0), askew.1.clamp(0.0, 3199.0));
    }
    lenslet_core::calibration::save(&at("camera.calib"), &camera, false).unwrap();
    let recipe = r#"{"base":"multiview","pitch":3.4425,"rotation":0.004,"atoms":16,"features":12,"epochs":1,"refine":1,
        "coupling":"low","pairs":600,"crop":60,"crops":1,"patch":7,"window":7,"anchors":8,"neighbours":100,"held_out":0}"#;
    std::fs::write(at("recipe.json"), recipe).unwrap();
    let train = |out: &str, options: &[String]| {
        let mut all = arguments(folder.path(), out);
        all.extend_from_slice(options);
        succeeds(&run(&all));
        lenslet_core::dictionary::load(&at(out)).unwrap()
    };
    let regular = train("regular.lfd", &[]);
    let measured = train("measured.lfd", &["--calibration".into(), text(&at("camera.calib")).to_owned()]);
    for dictionary in [&regular, &measured] {
        let model = &dictionary.models[0];
        assert_eq!(model.base, lenslet_core::interpolation::Interpolation::Multiview);
        assert!((model.pitch - 3.4425).abs() < 1e-4, "{}", model.pitch);
    }
    assert_ne!(regular.models[0].patch_model.low, measured.models[0].patch_model.low);
    let lattice = |d: &lenslet_core::dictionary::Dictionary| d.recipe.parameters.get("lattice").cloned();
    assert!(
        lattice(&measured).is_some_and(|l| l.as_str().is_some_and(|hash| hash.len() == 64)),
        "{:?}",
        measured.recipe
    );
    assert!(lattice(&regular).is_none_or(|l| l.is_null()), "{:?}", regular.recipe);
}
