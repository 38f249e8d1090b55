//! Faults that showed once, one file a kind: each makes its input, runs the program and asserts the right value.
//!
//! A new fault goes into the file of its kind, or into a new file that is named here.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

#[path = "regression/bench.rs"]
mod bench;
#[path = "regression/exports.rs"]
mod exports;
#[path = "regression/kept_files.rs"]
mod kept_files;
#[path = "regression/streams.rs"]
mod streams;
#[path = "regression/writers.rs"]
mod writers;
