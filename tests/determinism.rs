//! The same bytes for 1, 2 and 8 threads, and across two runs. What is printed is the table of docs/robustness.md.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it did

mod tiny;

use std::fs;

use tiny::{World, hashes, said};

/// Runs `arguments` (writing below `out/`) with several numbers of threads, and twice with the last.
fn same(world: &World, arguments: &[&str]) {
    let mut first = None;
    for threads in ["1", "2", "8", "8"] {
        fs::create_dir(world.at("out")).unwrap();
        let mut all = vec!["--threads", threads];
        all.extend(arguments);
        let done = world.run(&all);
        assert!(done.status.success(), "{arguments:?}: {}", said(&done));
        let mut files = hashes(&world.at("out"));
        // The log of training tells how long an epoch took.
        files.retain(|name, _| !name.ends_with(".log.jsonl"));
        // And this one how long it took, so that the list of the folder differs as well.
        let timed = files.keys().any(|name| name.ends_with("depth.json"));
        files.retain(|name, _| !(timed && name.ends_with(".lenslet")));
        for (name, hash) in files.iter_mut().filter(|(name, _)| name.ends_with("depth.json")) {
            let text = fs::read_to_string(world.at("out").join(name)).unwrap();
            let mut json: serde_json::Value = serde_json::from_str(&text).unwrap();
            assert!(json.as_object_mut().unwrap().remove("seconds").is_some());
            *hash = json.to_string();
        }
        assert!(!files.is_empty());
        assert_eq!(*first.get_or_insert_with(|| files.clone()), files, "{arguments:?} with {threads} threads");
        fs::remove_dir_all(world.at("out")).unwrap();
    }
    println!("| `{}` | {} |", arguments.join(" "), first.unwrap().len());
}

#[test]
fn calibration() {
    let world = World::new();
    same(&world, &["calibrate", "white.lfp", "--out", "out/a.calib"]);
    same(
        &world,
        &["calibrate", "--from-captures", "shots/1.lfp", "shots/2.lfp", "shots/3.lfp", "--out", "out/a.calib"],
    );
}

#[test]
fn decoding() {
    let world = World::new();
    for method in ["bicubic", "barycentric", "cubic", "multiview", "learned"] {
        same(
            &world,
            &["decode", "shots/1.lfp", "-c", "cam.calib", "--out", "out/a", "--size", "60", "--method", method],
        );
    }
}

#[test]
fn pairs_and_training() {
    let world = World::new();
    same(&world, &["gen-pairs", "photos", "--out", "out/pairs", "--pairs", "3000", "--crop", "96", "--shrink", "1"]);
    for algorithm in ["online", "ksvd", "ista"] {
        same(
            &world,
            &["train-dict", "photos", "--parameters", "train.json", "--algorithm", algorithm, "--out", "out/a.lfd"],
        );
    }
}

/// Views refined by all others, and what follows them: the network, LASSO codes, a dictionary of their own.
#[test]
fn refined_views() {
    let world = World::new();
    let decode = ["decode", "shots/1.lfp", "-c", "cam.calib", "--out", "out/a", "--size", "60", "--views", "5"];
    let learned = [&decode[..], &["--method", "learned", "--base", "multiview"]].concat();
    for path in [&[][..], &["--path", "network"], &["--path", "lasso"], &["--best"]] {
        same(&world, &[&learned[..], path].concat());
    }
    let field = ["decode", "shots/1.lfp", "-c", "cam.calib", "--out", "lf", "--size", "60", "--views", "5"];
    let done = world.run(&[&field[..], &["--method", "multiview"]].concat());
    assert!(done.status.success(), "{}", said(&done));
    same(&world, &["infer", "lf", "--out", "out/a", "--path", "network"]);
    same(&world, &["refine", "lf", "--out", "out/a", "--scale", "2"]);
    same(&world, &["refine", "field.npy", "--out", "out/a.npy", "--scale", "2"]);
    same(&world, &["depth", "lf", "--out", "out/a"]);
    same(&world, &["depth", "field.npy", "--out", "out/a"]);
    // Photos go through the simulated camera here; a network beside the dictionary.
    let parameters = r#"{"base":"multiview","atoms":16,"features":12,"epochs":1,"refine":1,"coupling":"low","pairs":600,
        "crop":60,"crops":1,"patch":7,"window":7,"anchors":8,"neighbours":100,"held_out":0,
        "network":{"features":[20],"window":7,"hidden":[12],"pairs":400,"batch":64,"epochs":1}}"#;
    fs::write(world.at("refined.json"), parameters).unwrap();
    same(&world, &["train-dict", "photos", "--parameters", "refined.json", "--out", "out/a.lfd"]);
}

#[test]
fn reconstruction() {
    let world = World::new();
    for mode in ["--fast", "--best", "--step=1"] {
        same(&world, &["infer", "field.npy", "--out", "out/a.npy", "--scale", "3", mode]);
    }
}
