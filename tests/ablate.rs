//! `lenslet ablate` as its users run it.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::fs;
use std::path::Path;
use std::process::Output;

use assert_cmd::Command;
use serde_json::Value;

fn ablate(dir: &Path, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenslet"));
    command.current_dir(dir).args(["ablate", "--out", "out", "--quick", "--json", "-q"]).args(more).output().unwrap()
}

fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn runs_resume_to_the_same_tables_and_compare() {
    let dir = tempfile::tempdir().unwrap();
    let few = ["--experiment", "subpixel", "demosaic", "--seeds", "1"];
    let first = json(&ablate(dir.path(), &few));
    let out = dir.path().join("out");
    // Three variants on two scenes, three on one.
    assert_eq!((first["made"].as_u64(), first["failed"].as_u64()), (Some(9), Some(0)), "{first}");
    for file in ["runs.jsonl", "tables.json", "tables.csv", "tables.md", "orderings.json", "report.html"] {
        assert!(out.join(file).exists(), "{file}");
    }
    let lines = fs::read_to_string(out.join("runs.jsonl")).unwrap();
    assert_eq!(lines.lines().count(), 9);
    for line in lines.lines() {
        let run: Value = serde_json::from_str(line).unwrap();
        assert!(run["scores"]["psnr"].as_f64().is_some_and(|p| p > 10.0 && p < 60.0), "{line}");
        assert!(run["version"].is_string() && run["seed"] == 1 && run["parameters"]["chain"]["views"] == 7);
    }
    let orderings = first["orderings"].as_array().unwrap();
    let holds =
        |worse: &str| orderings.iter().any(|o| o["worse"] == worse && o["subject"] == "natural" && o["holds"] == true);
    assert!(holds("whole pixels"), "{orderings:?}");

    // Killed in the middle of the last line: it is made again, and comes out the same.
    let cut = lines.trim_end().rfind('\n').unwrap();
    fs::write(out.join("runs.jsonl"), &lines[..cut + 40]).unwrap();
    fs::write(dir.path().join("old.jsonl"), &lines).unwrap();
    let again: Vec<&str> = few.iter().copied().chain(["--against", "old.jsonl"]).collect();
    let second = json(&ablate(dir.path(), &again));
    assert_eq!((second["kept"].as_u64(), second["made"].as_u64()), (Some(8), Some(1)));
    let changes = second["changes"].as_array().unwrap();
    assert!(changes.len() > 20 && changes.iter().all(|c| c["old"] == c["new"] && c["clear"] == false), "{changes:?}");
}

#[test]
fn wrong_use_is_told_in_one_line() {
    let dir = tempfile::tempdir().unwrap();
    fs::create_dir(dir.path().join("out")).unwrap();
    fs::write(dir.path().join("out/letter.txt"), "dear").unwrap();
    for (more, code, words) in [
        (vec!["--experiment", "demosaic"], 1, "--force"),
        (vec!["--experiment", "peers"], 2, "--peer"),
        (vec!["--experiment", "demosaic", "--against", "missing"], 1, "missing"),
    ] {
        let output = ablate(dir.path(), &more);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{message}");
        assert!(message.contains(words) && message.lines().count() == 1, "{message}");
    }
    assert_eq!(fs::read_dir(dir.path().join("out")).unwrap().count(), 1);
}
