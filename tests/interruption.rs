//! Ctrl-C and kill at random moments: nothing half-written under its final name, and what goes on afterwards ends as if it had
//! never been stopped. Each command is stopped LENSLET_INTERRUPTIONS times (three times, an ablation once, unless
//! told otherwise) by either signal.
//!
//! A moment is a number of changes in the folder of outputs, not a time: a fast machine and a busy one are stopped in the
//! same places. A run that ends before its moment is checked like any other that ends, and the next moment is earlier.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it did

mod tiny;

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Command, Stdio};

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use tiny::{World, hashes, said, unfinished};

const SIGINT: i32 = 2;
const SIGKILL: i32 = 9;
/// Stops in a row before a run is left to finish.
const IN_A_ROW: usize = 6;

fn times(usual: usize) -> usize {
    std::env::var("LENSLET_INTERRUPTIONS").ok().and_then(|n| n.parse().ok()).unwrap_or(usual)
}

/// One kind of work: its arguments (writing below `out/`), what a result is, and what may stand there unfinished.
struct Work<'a> {
    world: &'a World,
    arguments: &'a [&'a str],
    /// Arguments instead, once this file stands.
    resume: Option<(&'a str, &'a [&'a str])>,
    /// What a finished run leaves, comparable.
    result: &'a dyn Fn(&Path) -> BTreeMap<String, String>,
    /// Whether the files of one entry of `out/` are one output, which appears at once.
    together: bool,
    /// How often each signal must hit.
    times: usize,
    /// Files that are for going on, or that hold times.
    grows: &'a [&'a str],
}

impl Work<'_> {
    fn start(&self) -> Command {
        let arguments = match self.resume {
            Some((file, arguments)) if self.world.at(file).exists() => arguments,
            _ => self.arguments,
        };
        let mut command = self.world.command(arguments);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        command
    }

    /// Stops runs until each signal has hit `times` of them.
    fn torment(&self, seed: u64) {
        let out = self.world.at("out");
        let mut child = self.start().spawn().unwrap();
        let usual = tiny::watch(&mut child, &out, usize::MAX);
        let whole = child.wait_with_output().unwrap();
        assert!(whole.status.success(), "{}", said(&whole));
        let truth = (self.result)(&out);
        assert!(!truth.is_empty());
        fs::remove_dir_all(&out).unwrap();

        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (mut stopped, mut finished, mut late, mut before, mut row) = ([0, 0], 0, 0, 0, 0);
        let mut latest = usual;
        // Each stop takes a run; each run that ends early halves the moments, down to the start, which none misses.
        let bound = 2 * self.times * (2 + usual.max(1).ilog2() as usize) + IN_A_ROW + 2;
        for attempt in 0.. {
            assert!(attempt < 2 * bound, "{attempt} runs: {stopped:?} stops, {finished} ends");
            let enough = stopped.iter().all(|&n| n >= self.times);
            if enough && finished > 0 {
                break;
            }
            let signal = if stopped[0] <= stopped[1] { SIGINT } else { SIGKILL };
            let before_it = unfinished(self.world.folder.path());
            let mut child = self.start().spawn().unwrap();
            if row < IN_A_ROW && !enough {
                tiny::watch(&mut child, &out, rng.random_range(0..=latest));
                tiny::signal(&child, &signal.to_string());
            }
            let output = child.wait_with_output().unwrap();
            let (code, by) = (output.status.code(), output.status.signal());
            if code == Some(0) {
                assert_eq!((self.result)(&out), truth, "{:?} after {row} stops", self.arguments);
                assert_eq!(unfinished(self.world.folder.path()), Vec::<std::path::PathBuf>::new());
                fs::remove_dir_all(&out).unwrap();
                (finished, row, latest) = (finished + 1, 0, latest / 2);
                continue;
            }
            self.nothing_half(&truth);
            row += 1;
            latest = usual;
            stopped[usize::from(signal == SIGKILL)] += 1;
            // A program that has not yet said what it does on Ctrl-C dies of it, having done nothing.
            if signal == SIGINT && by == Some(SIGINT) {
                before += 1;
            } else if signal == SIGINT {
                assert_eq!(code, Some(130), "{}", said(&output));
                // Its own; what a killed run left goes when its target is written again, which this one may not have reached.
                let left = unfinished(self.world.folder.path());
                assert!(left.iter().all(|p| before_it.contains(p)), "{left:?}");
                assert_eq!(said(&output).trim_end().lines().count(), 1, "{}", said(&output));
            } else {
                assert_eq!(by, Some(SIGKILL), "{}", said(&output));
            }
            let now = if out.exists() { (self.result)(&out) } else { BTreeMap::new() };
            if truth.iter().all(|(name, hash)| now.get(name) == Some(hash)) {
                // It had its result already, and was stopped on its way out.
                fs::remove_dir_all(&out).unwrap();
                (late, row) = (late + 1, 0);
            }
        }
        println!(
            "{}: {} stops by SIGINT ({before} before its handler stood), {} by SIGKILL, {late} with the result there \
             already; {finished} runs came to their end and the same result",
            self.arguments[0], stopped[0], stopped[1]
        );
        let _ = fs::remove_dir_all(&out);
    }

    /// What stands under a final name is as a finished run leaves it.
    fn nothing_half(&self, truth: &BTreeMap<String, String>) {
        let out = self.world.at("out");
        for (name, hash) in hashes(&out) {
            if name.contains(tiny::MARK) || self.grows.iter().any(|g| name == *g) {
                continue;
            }
            assert_eq!(truth.get(&name), Some(&hash), "{name} is not as a finished run leaves it");
            let entry = name.split('/').next().unwrap();
            for other in truth.keys().filter(|t| self.together && t.split('/').next() == Some(entry)) {
                assert!(out.join(other).exists(), "{name} stands, and {other} does not");
            }
        }
    }
}

#[test]
fn training_goes_on_from_its_checkpoint() {
    let world = World::new();
    let first = ["train-dict", "photos", "--parameters", "train.json", "--out", "out/a.lfd"];
    let more = ["train-dict", "photos", "--parameters", "train.json", "--out", "out/a.lfd", "--resume"];
    Work {
        world: &world,
        arguments: &first,
        resume: Some(("out/a.lfd.checkpoint", &more)),
        // The log has times in it.
        result: &|out| hashes(out).into_iter().filter(|(name, _)| name != "a.lfd.log.jsonl").collect(),
        times: times(3),
        together: false,
        grows: &["a.lfd.checkpoint", "a.lfd.log.jsonl"],
    }
    .torment(1);
    // As between the dictionary and the end: its checkpoint is still there, and its pictures are not.
    let checkpoint = (0..tiny::ATTEMPTS).find_map(|_| {
        let _ = fs::remove_dir_all(world.at("out"));
        let mut child = world.command(&first).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        while !world.at("out/a.lfd.checkpoint").exists() && child.try_wait().unwrap().is_none() {
            std::thread::yield_now();
        }
        let _ = child.kill();
        child.wait().unwrap();
        fs::read(world.at("out/a.lfd.checkpoint")).ok()
    });
    let checkpoint = checkpoint.expect("every run ended before it could be stopped at a checkpoint");
    assert!(world.run(&more).status.success());
    let truth = hashes(&world.at("out/a.lfd"));
    fs::write(world.at("out/a.lfd.checkpoint"), checkpoint).unwrap();
    fs::remove_file(world.at("out/a.lfd.plot.svg")).unwrap();
    let again = world.run(&more);
    assert!(again.status.success(), "{}", said(&again));
    assert_eq!(hashes(&world.at("out/a.lfd")), truth);
    assert!(world.at("out/a.lfd.plot.svg").exists() && !world.at("out/a.lfd.checkpoint").exists());
}

#[test]
fn a_folder_of_captures_goes_on_with_those_missing() {
    let world = World::new();
    Work {
        world: &world,
        arguments: &["decode", "shots", "-c", "cam.calib", "--out", "out", "--size", "60", "--views", "3"],
        resume: None,
        result: &hashes,
        times: times(3),
        together: true,
        grows: &[],
    }
    .torment(2);
}

/// Light fields of one file have their samples beside them: two outputs a capture.
#[test]
fn a_folder_of_captures_in_single_files_goes_on() {
    let world = World::new();
    let work =
        ["decode", "shots", "-c", "cam.calib", "--out", "out", "--size", "60", "--views", "3", "--format", "npy"];
    Work {
        world: &world,
        arguments: &work,
        resume: None,
        result: &hashes,
        times: times(1),
        together: false,
        grows: &[],
    }
    .torment(5);
    // As between the two: samples whose light field is not there yet.
    assert!(world.run(&work).status.success());
    let truth = hashes(&world.at("out"));
    fs::remove_file(world.at("out/2.npy")).unwrap();
    let again = world.run(&work);
    assert!(again.status.success(), "{}", said(&again));
    assert_eq!(hashes(&world.at("out")), truth);
}

#[test]
fn what_is_replaced_stands_until_the_new_one_does() {
    let world = World::new();
    let work =
        ["infer", "field.npy", "--dictionary", "small.lfd", "--scale", "3", "--fast", "--force", "--out", "out/a"];
    let start = || world.command(&work).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let mut child = start();
    let usual = tiny::watch(&mut child, &world.at("out"), usize::MAX);
    assert!(child.wait().unwrap().success());
    let truth = hashes(&world.at("out"));
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let mut stopped = 0;
    let mut late = usual;
    for attempt in 0.. {
        if stopped >= times(3) {
            break;
        }
        assert!(attempt < times(3) * tiny::ATTEMPTS, "{stopped} stops in {attempt} runs");
        let mut child = start();
        // Late, where the one takes the place of the other; a run that is missed moves the next moment forward.
        tiny::watch(&mut child, &world.at("out"), rng.random_range(late / 2..=late));
        let _ = child.kill();
        let hit = !child.wait().unwrap().success();
        (stopped, late) = if hit { (stopped + 1, usual) } else { (stopped, late / 2) };
        let now: BTreeMap<_, _> =
            hashes(&world.at("out")).into_iter().filter(|(name, _)| !name.contains(tiny::MARK)).collect();
        assert_eq!(now, truth);
    }
    assert!(world.run(&work).status.success());
    assert_eq!(unfinished(world.folder.path()), Vec::<std::path::PathBuf>::new());
    println!("infer --force: {stopped} stops by SIGKILL");
}

#[test]
fn a_light_field_is_whole_or_absent() {
    let world = World::new();
    Work {
        world: &world,
        arguments: &["infer", "field.npy", "--dictionary", "small.lfd", "--scale", "3", "--out", "out/a"],
        resume: None,
        result: &hashes,
        times: times(3),
        together: true,
        grows: &[],
    }
    .torment(3);
}

#[test]
fn an_ablation_goes_on_where_it_stopped() {
    let world = World::new();
    Work {
        world: &world,
        arguments: &["ablate", "--out", "out", "--quick", "--seeds", "1", "--experiment", "vignetting"],
        resume: None,
        result: &|out| {
            // Everything but times: the lines of the runs without them, and the pictures.
            let mut result = hashes(out);
            result.retain(|name, _| name.starts_with("pictures"));
            for line in fs::read_to_string(out.join("runs.jsonl")).unwrap_or_default().split_inclusive('\n') {
                // The last line may be cut off.
                let Ok(mut run) = serde_json::from_str::<serde_json::Value>(line) else { continue };
                for time in ["seconds", "step_seconds"] {
                    run.as_object_mut().unwrap().remove(time).unwrap();
                }
                assert!(result.insert(run["key"].as_str().unwrap().into(), run.to_string()).is_none());
            }
            result.insert("report".into(), out.join("report.html").exists().to_string());
            result
        },
        times: times(1),
        together: false,
        // Made anew by every run that comes to its end, with the times in them.
        grows: &[".lenslet", "runs.jsonl", "report.html", "tables.json", "tables.csv", "tables.md", "orderings.json"],
    }
    .torment(4);
}
