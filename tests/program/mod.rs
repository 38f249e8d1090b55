//! The program as a user runs it, with its answer as JSON.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

/// What the program says, whether or not it succeeds.
pub fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lenslet")).args(["-q", "--json"]).args(arguments).output().unwrap()
}

/// The answer of a run that succeeds.
pub fn lenslet(arguments: &[&str]) -> Value {
    let output = run(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

pub fn text(p: &Path) -> &str {
    p.to_str().unwrap()
}
