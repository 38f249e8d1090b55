//! `runs.jsonl`: one JSON object a line, a line a run, appended as runs end.

use std::collections::{BTreeMap, HashSet};
use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use lenslet_core::input::read_regular;
use lenslet_core::output;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::matrix::Run;
use super::settings::Settings;

/// Name of the file.
pub const FILE: &str = "runs.jsonl";
/// Largest file that is read, bytes.
const MAX_BYTES: u64 = 256 << 20;

/// What a run gave.
#[derive(Debug, Clone, Default)]
pub struct Scored {
    /// Scores by name.
    pub scores: BTreeMap<String, f64>,
    /// Seconds of the step the experiment is about (rendering, training).
    pub step_seconds: f64,
    /// Pictures written, by what they show (`crop`, `difference`, `truth`).
    pub pictures: BTreeMap<String, String>,
    /// sha256 of the files that went in, by file name.
    pub hashes: BTreeMap<String, String>,
    /// Anything else (an alignment).
    pub notes: Option<Value>,
}

/// A line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Identifies the run ([`Run::key`]).
    pub key: String,
    /// Experiment.
    pub experiment: String,
    /// Row.
    pub variant: String,
    /// Scene or file.
    pub subject: String,
    /// Seed.
    pub seed: u64,
    /// The chain of steps and sizes.
    pub parameters: Value,
    /// Scores by name; empty when the run failed.
    pub scores: BTreeMap<String, f64>,
    /// The reason where it failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failed: Option<String>,
    /// Seconds of the step in question.
    pub step_seconds: f64,
    /// Seconds of the whole run.
    pub seconds: f64,
    /// Version of the program.
    pub version: String,
    /// Files that went in.
    #[serde(default)]
    pub hashes: BTreeMap<String, String>,
    /// Pictures, relative to the folder.
    #[serde(default)]
    pub pictures: BTreeMap<String, String>,
    /// Anything else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub notes: Option<Value>,
}

impl Record {
    /// The line of a run.
    pub fn new(run: &Run, outcome: Result<Scored>, seconds: f64, settings: &Settings) -> Record {
        let (scored, failed) = match outcome {
            Ok(scored) => (scored, None),
            Err(e) => (Scored::default(), Some(format!("{e:#}").replace(['\n', '\r'], " "))),
        };
        // Scores that are no numbers have no place in JSON.
        let scores = scored.scores.into_iter().filter(|(_, x)| x.is_finite()).collect();
        Record {
            key: run.key(),
            experiment: run.experiment.name().to_owned(),
            variant: run.variant.clone(),
            subject: run.subject.name(),
            seed: run.seed,
            parameters: serde_json::json!({
                "chain": run.chain, "sensor": run.sensor, "size": settings.size(), "quick": settings.quick,
            }),
            scores,
            failed,
            step_seconds: scored.step_seconds,
            seconds,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            hashes: scored.hashes,
            pictures: scored.pictures,
            notes: scored.notes,
        }
    }
}

/// Reads all whole lines of the file; a line cut off at the end, as a killed run leaves it, does not count.
///
/// # Errors
/// A file that cannot be read, or is not such a file.
pub fn read(path: &Path) -> Result<Vec<Record>> {
    let bytes = read_regular(path, MAX_BYTES).with_context(|| path.display().to_string())?;
    parse(path, &bytes)
}

/// The runs of whole lines.
fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<Record>> {
    let mut records = Vec::new();
    for line in bytes.split_inclusive(|&b| b == b'\n') {
        if !line.ends_with(b"\n") {
            break;
        }
        let record = serde_json::from_slice(line)
            .with_context(|| format!("{}: line {} is not a run", path.display(), records.len() + 1))?;
        records.push(record);
    }
    Ok(records)
}

/// The file, open for appending.
pub struct Log {
    path: PathBuf,
    file: File,
    keys: HashSet<String>,
    lock: File,
}

impl Log {
    /// Opens the log of an ablation's folder for this run alone; makes the folder when there is none. Nothing that is
    /// in it is lost.
    ///
    /// # Errors
    /// A folder with something else in it, or with runs of other sizes than those of `settings` (unless `force`); one
    /// that another run has, or that cannot be written.
    pub fn open(out: &Path, settings: &Settings, force: bool) -> Result<Log> {
        let path = out.join(FILE);
        let exists = path.symlink_metadata().is_ok();
        if !exists && !force && out.exists() && (!out.is_dir() || fs::read_dir(out)?.next().is_some()) {
            bail!(
                "{} exists already and is not an ablation to go on with; choose another name or add --force",
                out.display()
            );
        }
        fs::create_dir_all(out).with_context(|| format!("cannot write {}", out.display()))?;
        let lock = output::lock_folder(out)?;
        let mut keys = HashSet::new();
        let mut whole = 0;
        if exists {
            if path.symlink_metadata().is_ok_and(|m| m.is_symlink()) {
                bail!("{} is a link; it is not followed", path.display());
            }
            let bytes = read_regular(&path, MAX_BYTES).with_context(|| path.display().to_string())?;
            let records = parse(&path, &bytes)?;
            // A file without a run is lenslet's own only where its folder says so.
            let begun = bytes.is_empty() || bytes.starts_with(b"{\"key\":");
            if records.is_empty() && !(begun && output::is_listed(out, FILE)) {
                bail!(
                    "{} holds no runs and is not lenslet's own; choose another folder, or remove it yourself",
                    path.display()
                );
            }
            let same = |r: &Record| {
                r.parameters["quick"] == settings.quick && r.parameters["size"] == serde_json::json!(settings.size())
            };
            if !force && !records.iter().all(same) {
                bail!(
                    "{} holds runs of other sizes; go on with the same parameters, choose another folder, or add --force to add to it",
                    out.display()
                );
            }
            keys = records.into_iter().filter(|r| r.failed.is_none()).map(|r| r.key).collect();
            whole = bytes.iter().rposition(|&b| b == b'\n').map_or(0, |at| at + 1) as u64;
        }
        if !exists {
            output::replace_listed(out, FILE, b"")?;
        }
        let file = OpenOptions::new().append(true).open(&path);
        let file = file.with_context(|| format!("cannot write {}", path.display()))?;
        // A line cut off by a killed run is removed.
        if exists {
            file.set_len(whole)?;
        }
        // After the log, which marks the folder as one to go on with.
        let pictures = out.join("pictures");
        fs::create_dir_all(&pictures).with_context(|| format!("cannot write {}", pictures.display()))?;
        Ok(Log { path, file, keys, lock })
    }

    /// The folder's lock, to be held while anything else is written into it.
    pub fn into_lock(self) -> File {
        self.lock
    }

    /// Where the lines are.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the run is there already (failed ones are run again).
    pub fn has(&self, key: &str) -> bool {
        self.keys.contains(key)
    }

    /// Adds a line.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn append(&mut self, record: &Record) -> Result<()> {
        let mut line = serde_json::to_vec(record)?;
        line.push(b'\n');
        self.file.write_all(&line)?;
        self.file.sync_data()?;
        if record.failed.is_none() {
            self.keys.insert(record.key.clone());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ablation::{chain::Chain, experiment::Experiment, matrix::Subject};
    use lenslet_data_gen::simulate::SceneName;

    fn run(seed: u64) -> Run {
        Run {
            experiment: Experiment::Noise,
            variant: "x".into(),
            chain: Chain::default(),
            subject: Subject::Scene(SceneName::Flat.into()),
            seed,
            sensor: 100,
            dictionary: None,
            calibrated_by: None,
        }
    }

    #[test]
    fn lines_come_back_and_a_torn_one_is_dropped() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("a");
        let mut log = Log::open(&out, &Settings::default(), false).unwrap();
        let scored =
            Scored { scores: [("psnr".to_owned(), 30.5), ("nan".into(), f64::NAN)].into(), ..Scored::default() };
        let good = Record::new(&run(1), Ok(scored), 1.0, &Settings::default());
        let bad = Record::new(&run(2), Err(anyhow::anyhow!("no\nluck")), 1.0, &Settings::default());
        log.append(&good).unwrap();
        log.append(&bad).unwrap();
        drop(log);
        assert_eq!(read(&out.join(FILE)).unwrap(), [good.clone(), bad.clone()]);
        assert_eq!(good.scores.len(), 1);
        assert_eq!(bad.failed.as_deref(), Some("no luck"));
        // Torn in the middle of a third line, which is dropped; the next one follows the second.
        let mut file = OpenOptions::new().append(true).open(out.join(FILE)).unwrap();
        file.write_all(b"{\"key\": \"12").unwrap();
        let mut log = Log::open(&out, &Settings::default(), false).unwrap();
        assert!(log.has(&good.key) && !log.has(&bad.key));
        log.append(&good).unwrap();
        assert_eq!(read(&out.join(FILE)).unwrap().len(), 3);
    }

    #[test]
    fn a_folder_of_something_else_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("letter.txt"), "dear").unwrap();
        assert!(Log::open(dir.path(), &Settings::default(), false).is_err());
        assert!(Log::open(dir.path(), &Settings::default(), true).is_ok());
        fs::write(dir.path().join(FILE), "no run\n").unwrap();
        assert!(Log::open(dir.path(), &Settings::default(), false).is_err());
    }
}
