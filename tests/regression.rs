//! Faults that showed once, one file a kind: each makes its input, runs the program and asserts the right value.
//!
//! A new fault goes into the file of its kind, or into a new file that is named here.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

#[path = "regression/absent_views.rs"]
mod absent_views;
#[path = "regression/batches.rs"]
mod batches;
#[path = "regression/bench.rs"]
mod bench;
#[path = "regression/captures.rs"]
mod captures;
#[path = "regression/containers.rs"]
mod containers;
#[path = "regression/disparity.rs"]
mod disparity;
#[path = "regression/exports.rs"]
mod exports;
#[path = "regression/extremes.rs"]
mod extremes;
#[path = "regression/fields.rs"]
mod fields;
#[path = "regression/folders.rs"]
mod folders;
#[path = "regression/kept_files.rs"]
mod kept_files;
#[path = "regression/light.rs"]
mod light;
#[path = "regression/other_kinds.rs"]
mod other_kinds;
#[path = "regression/small_files.rs"]
mod small_files;
#[path = "regression/streams.rs"]
mod streams;
#[path = "regression/values.rs"]
mod values;
#[path = "regression/whites.rs"]
mod whites;
#[path = "regression/writers.rs"]
mod writers;
