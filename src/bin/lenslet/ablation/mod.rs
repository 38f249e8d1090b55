//! The paper's experiments (section 5) as a run matrix: every run one JSON line with its parameters and scores, tables and a
//! page made from the lines.
//!
//! [`plan`] says what would be run, [`run`] runs what is missing and appends to `runs.jsonl`, [`write_tables`] and
//! [`page::write`] turn lines into tables and the report, [`check`] asserts the orderings that must hold, [`against`]
//! compares two runs. A run that was interrupted goes on where it stopped.

pub mod against;
mod chain;
pub mod check;
mod dictionaries;
pub mod matrix;
pub mod page;
mod peers;
mod picture;
mod plot;
mod real;
pub mod record;
mod render;
mod scores;
pub mod table;
mod world;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use lenslet_core::output;
use lenslet_core::progress::Observer;
pub use matrix::{Experiment, Run, Subject, plan};
pub use record::Record;

/// What to run, and on what.
#[derive(Debug, Clone, Default)]
pub struct Settings {
    /// Which experiments; empty: all.
    pub experiments: Vec<Experiment>,
    /// Small sensor, fewer variants: minutes instead of an hour.
    pub quick: bool,
    /// Seeds of the simulated cameras and scenes, at least one; their spread is reported. 0 stands for 3 (quick: 2).
    pub seeds: u64,
    /// White images of a real camera (or one pattern composed of its captures).
    pub whites: Vec<PathBuf>,
    /// Captures of that camera, scored by hidden lenslets.
    pub captures: Vec<PathBuf>,
    /// Photos to train the dictionaries on; simulated pictures when empty.
    pub photos: Vec<PathBuf>,
    /// Light fields decoded by other tools, with the tools' names.
    pub peers: Vec<(String, PathBuf)>,
    /// The truth of the capture they decoded: a light field.
    pub truth: Option<PathBuf>,
}

/// What is drawn: how large the simulated camera is, and which scenes it sees.
impl Settings {
    /// Side of the simulated sensor, pixels.
    pub fn sensor(&self) -> usize {
        if self.quick { 1144 } else { 1640 }
    }

    /// Longer side of the views: in proportion to 1080 for an F01's 3280.
    pub fn size(&self) -> usize {
        (self.sensor() * 1080 + 1640) / 3280
    }

    /// The seeds, from 1.
    pub fn seeds(&self) -> std::ops::RangeInclusive<u64> {
        let n = match self.seeds {
            0 if self.quick => 2,
            0 => 3,
            n => n,
        };
        1..=n
    }
}

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
/// A folder that is not an ablation's (unless `force`), files that cannot be written, interruption (the finished runs stay).
pub fn run(out: &Path, settings: &Settings, force: bool, observer: &dyn Observer) -> Result<Done> {
    let runs = plan(settings)?;
    let mut log = record::Log::open(out, force)?;
    let mut done = Done::default();
    let mut stock = chain::Stock::new(settings);
    let mut missing: Vec<&Run> = runs.iter().filter(|r| !log.has(&r.key())).collect();
    // Capture by capture, so that each is simulated, calibrated and rendered once.
    missing.sort_by_key(|r| (r.subject.name(), (1000.0 * r.chain.noise) as u64, r.seed));
    done.kept = runs.len() - missing.len();
    for (k, run) in missing.iter().enumerate() {
        if observer.cancelled() {
            bail!(Interrupted);
        }
        observer.note(&format!("{}/{} {}", k + 1, missing.len(), run.title()));
        let begun = Instant::now();
        let outcome = execute(run, settings, &mut stock, out, observer);
        if observer.cancelled() {
            bail!(Interrupted);
        }
        let record = Record::new(run, outcome, begun.elapsed().as_secs_f64(), settings);
        done.made += 1;
        done.failed += usize::from(record.failed.is_some());
        log.append(&record).with_context(|| format!("cannot add to {}", log.path().display()))?;
    }
    Ok(done)
}

/// The caller asked to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("interrupted")]
pub struct Interrupted;

fn execute(
    run: &Run,
    settings: &Settings,
    stock: &mut chain::Stock,
    out: &Path,
    observer: &dyn Observer,
) -> Result<record::Scored> {
    match &run.subject {
        Subject::Scene(kind) => chain::simulated(run, *kind, settings, stock, out, observer),
        Subject::Capture(path) => chain::captured(run, path, settings, stock, out, observer),
        Subject::Peer(name, path) => peers::score(name, path, settings, out, run),
    }
}

/// Writes `tables.json`, `tables.csv`, `tables.md` of the plan's records.
///
/// # Errors
/// Files that cannot be written.
pub fn write_tables(out: &Path, tables: &[table::Table]) -> Result<()> {
    let json = serde_json::to_vec_pretty(tables)?;
    output::write_file(&out.join("tables.json"), true, &json)?;
    output::write_file(&out.join("tables.csv"), true, table::csv(tables).as_bytes())?;
    output::write_file(&out.join("tables.md"), true, table::markdown(tables).as_bytes())?;
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
