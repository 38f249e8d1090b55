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

#[test]
fn reconstruction() {
    let world = World::new();
    for mode in ["--fast", "--best", "--step=1"] {
        same(&world, &["infer", "field.npy", "--out", "out/a.npy", "--scale", "3", mode]);
    }
}
