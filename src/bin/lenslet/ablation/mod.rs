//! The paper's experiments (section 5) as a run matrix: every run one JSON line with its parameters and scores, tables
//! and a page made from the lines.
//!
//! [`plan`] lists the runs, [`run`] makes those that are missing and appends to `runs.jsonl`, [`write_tables`] and
//! [`page::write_page`] turn lines into tables and the report, [`orderings`] asserts the orderings that must hold,
//! [`compare`] compares two runs. A run that was interrupted goes on where it stopped.

mod chain;
pub mod compare;
mod crops;
mod dictionaries;
mod downsampled;
mod experiment;
pub mod matrix;
mod measured_capture;
mod method;
pub mod orderings;
pub mod page;
mod paper;
mod peers;
mod photos;
mod plot;
mod real_capture;
pub mod record;
mod render;
mod run_one;
mod scores;
mod settings;
mod simulated_capture;
mod simulated_scene;
#[cfg(test)]
mod spoiled;
pub mod table;
mod used_dictionaries;

use std::fs::File;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result};
pub use experiment::Experiment;
use lenslet_core::output;
use lenslet_core::progress::Observer;
use matrix::Run;
pub use matrix::plan;
pub use record::Record;
pub use settings::{CalibratedBy, Settings};
pub use used_dictionaries::UsedDictionaries;

/// What is written at the end, besides the log and the pictures.
const WRITTEN: [&str; 6] = ["tables.json", "tables.csv", "tables.md", "orderings.json", "report.html", "against.json"];

/// What a call did.
#[derive(Debug, Clone, Copy, Default)]
pub struct Done {
    /// Runs already in the file.
    pub kept: usize,
    /// Runs made now.
    pub made: usize,
    /// Of these, runs that could not be scored (their reason is in the record).
    pub failed: usize,
}

/// Runs everything of the plan that is not yet in `out/runs.jsonl`, in order.
///
/// # Errors
/// A folder that is not an ablation's or holds runs of other parameters (unless `force`), another run that writes into
/// it, files that cannot be written, interruption (the finished runs stay). The file that is returned is the folder's
/// lock.
pub fn run(out: &Path, settings: &Settings, force: bool, observer: &dyn Observer) -> Result<(Done, File)> {
    let runs = plan(settings)?;
    let mut log = record::Log::open(out, settings, force)?;
    for name in WRITTEN {
        output::check_listed(out, name)?;
    }
    let mut done = Done::default();
    let mut caches = run_one::Caches::new(settings);
    let mut missing: Vec<&Run> = runs.iter().filter(|r| !log.has(&r.key())).collect();
    // Capture by capture, so that each is simulated, calibrated and rendered once.
    missing.sort_by_key(|r| (r.subject.name(), (1000.0 * r.chain.noise) as u64, r.seed));
    done.kept = runs.len() - missing.len();
    for (k, run) in missing.iter().enumerate() {
        observer.check()?;
        observer.note(&format!("{}/{} {}", k + 1, missing.len(), run.title()));
        let begun = Instant::now();
        let outcome = run_one::run_one(run, settings, &mut caches, out, observer);
        observer.check()?;
        let record = Record::new(run, outcome, begun.elapsed().as_secs_f64(), settings);
        done.made += 1;
        done.failed += usize::from(record.failed.is_some());
        log.append(&record).with_context(|| format!("cannot add to {}", log.path().display()))?;
    }
    Ok((done, log.into_lock()))
}

/// Writes `tables.json`, `tables.csv`, `tables.md` of the plan's records.
///
/// # Errors
/// Files that cannot be written.
pub fn write_tables(out: &Path, tables: &[table::Table]) -> Result<()> {
    let json = serde_json::to_vec_pretty(tables)?;
    output::replace_listed(out, "tables.json", &json)?;
    output::replace_listed(out, "tables.csv", table::tables_to_csv(tables).as_bytes())?;
    output::replace_listed(out, "tables.md", table::tables_to_markdown(tables).as_bytes())?;
    Ok(())
}

/// The records of the plan that are in `out/runs.jsonl`, in the plan's order.
///
/// # Errors
/// As [`plan`], or a file that cannot be read.
pub fn records(out: &Path, settings: &Settings) -> Result<Vec<Record>> {
    let all = record::read(&out.join(record::FILE))?;
    let mut by_key: std::collections::HashMap<&str, &Record> = std::collections::HashMap::new();
    for record in &all {
        by_key.insert(&record.key, record);
    }
    Ok(plan(settings)?.iter().filter_map(|r| by_key.get(r.key().as_str()).map(|&r| r.clone())).collect())
}
