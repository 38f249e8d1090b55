//! Runs the tests once a mutant, from the nearest to the farthest, until one fails.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use super::tree::{Mutant, target_folder};

/// Tests of `core/tests` that follow the unit tests: those that take seconds.
const OTHER_TESTS: [&str; 6] = ["captures", "decode", "lightfield", "sizes", "sparse_solvers", "whites"];
/// A run may take this many times as long as without a mutant, and [`GRACE`] more.
const TIMES: f64 = 5.0;
const GRACE: Duration = Duration::from_secs(5);
/// Address space of a test, KiB: a mutant may ask for any amount.
const MEMORY_KIB: u64 = 6 << 20;

#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    Caught,
    TimedOut,
    Survived,
}

#[derive(Clone, Serialize, Deserialize)]
pub struct Verdict {
    pub outcome: Outcome,
    /// The test that failed, or what else ended the run.
    pub by: String,
    pub seconds: f64,
}

pub type Verdicts = BTreeMap<String, Verdict>;

pub fn read_verdicts(out: &Path) -> Result<Verdicts> {
    match std::fs::read(out.join("results.json")) {
        Ok(bytes) => Ok(serde_json::from_slice(&bytes)?),
        Err(_) => Ok(Verdicts::new()),
    }
}

/// One call of a test program.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Stage {
    program: PathBuf,
    arguments: Vec<String>,
}

/// Builds the tree and tries the mutants that have no verdict yet; with `again` the survivors, too.
pub fn run(root: &Path, out: &Path, mutants: &[Mutant], again: bool) -> Result<()> {
    let programs = build(root, &out.join("tree"))?;
    let mut runner = Runner { folder: out.join("tree/core"), scratch: out.join("tmp"), usual: BTreeMap::new() };
    let mut verdicts = read_verdicts(out)?;
    for (k, mutant) in mutants.iter().enumerate() {
        let known = verdicts.get(&mutant.key());
        if known.is_some_and(|v| !again || v.outcome != Outcome::Survived) {
            continue;
        }
        let verdict = runner.try_mutant(mutant, &programs)?;
        println!(
            "{}/{} {}:{}:{} {} → {}: {:?} {} ({:.1} s)",
            k + 1,
            mutants.len(),
            mutant.file,
            mutant.line,
            mutant.column,
            mutant.original,
            mutant.replacement,
            verdict.outcome,
            verdict.by,
            verdict.seconds
        );
        verdicts.insert(mutant.key(), verdict);
        std::fs::write(out.join("results.json"), serde_json::to_string_pretty(&verdicts)?)?;
    }
    Ok(())
}

/// The test programs of the tree, by name; `lenslet_core` has the unit tests.
fn build(root: &Path, tree: &Path) -> Result<BTreeMap<String, PathBuf>> {
    let mut command = Command::new("cargo");
    command.args(["test", "--release", "-p", "lenslet-core", "--no-run", "--message-format=json", "--lib"]);
    for name in OTHER_TESTS {
        command.args(["--test", name]);
    }
    let output =
        command.env("CARGO_TARGET_DIR", target_folder(root)).current_dir(tree).stderr(Stdio::inherit()).output()?;
    ensure!(output.status.success(), "the tests do not build");
    let mut programs = BTreeMap::new();
    for line in String::from_utf8_lossy(&output.stdout).lines() {
        let value: serde_json::Value = serde_json::from_str(line)?;
        if let (Some(path), Some(name)) = (value["executable"].as_str(), value["target"]["name"].as_str()) {
            programs.insert(name.to_owned(), PathBuf::from(path));
        }
    }
    Ok(programs)
}

struct Runner {
    folder: PathBuf,
    scratch: PathBuf,
    /// Time of each stage without a mutant.
    usual: BTreeMap<Stage, Duration>,
}

impl Runner {
    fn try_mutant(&mut self, mutant: &Mutant, programs: &BTreeMap<String, PathBuf>) -> Result<Verdict> {
        let begin = Instant::now();
        for stage in stages(mutant, programs)? {
            let usual = match self.usual.get(&stage) {
                Some(time) => *time,
                None => {
                    let before = Instant::now();
                    let ended = self.run_stage(&stage, 0, Duration::from_secs(3600))?;
                    ensure!(ended.is_none(), "without a mutant: {ended:?}");
                    self.usual.insert(stage.clone(), before.elapsed());
                    println!("{:.1} s without a mutant: {}", before.elapsed().as_secs_f64(), stage.arguments.join(" "));
                    before.elapsed()
                }
            };
            let limit = usual.mul_f64(TIMES) + GRACE;
            if let Some((outcome, by)) = self.run_stage(&stage, mutant.number, limit)? {
                return Ok(Verdict { outcome, by, seconds: begin.elapsed().as_secs_f64() });
            }
        }
        let seconds = begin.elapsed().as_secs_f64();
        Ok(Verdict { outcome: Outcome::Survived, by: String::new(), seconds })
    }

    /// What ended a run before all its tests had passed.
    fn run_stage(&self, stage: &Stage, number: u32, limit: Duration) -> Result<Option<(Outcome, String)>> {
        // A killed test leaves files.
        std::fs::remove_dir_all(&self.scratch).ok();
        std::fs::create_dir_all(&self.scratch)?;
        let mut child = Command::new("sh")
            .args(["-c", &format!("ulimit -v {MEMORY_KIB}; exec \"$0\" \"$@\"")])
            .arg(&stage.program)
            .args(&stage.arguments)
            .current_dir(&self.folder)
            .env("LENSLET_MUTANT", number.to_string())
            .env("LENSLET_DATA", self.scratch.join("none"))
            .env("TMPDIR", &self.scratch)
            .env("RAYON_NUM_THREADS", "1")
            .env("PROPTEST_RNG_SEED", "2013") // as .cargo/config.toml has it
            .env("PROPTEST_MAX_SHRINK_ITERS", "0")
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .with_context(|| stage.program.display().to_string())?;
        let lines = child.stdout.take().context("no output")?;
        let (sender, failed) = mpsc::channel();
        let reader = std::thread::spawn(move || {
            for line in BufReader::new(lines).lines().map_while(Result::ok) {
                if let Some(name) = line.strip_prefix("test ").and_then(|l| l.strip_suffix(" ... FAILED")) {
                    sender.send(name.to_owned()).ok();
                }
            }
        });
        let deadline = Instant::now() + limit;
        let mut ended = None;
        let status = loop {
            if let Some(status) = child.try_wait()? {
                break Some(status);
            }
            if let Ok(name) = failed.recv_timeout(Duration::from_millis(20)) {
                ended = Some((Outcome::Caught, name));
            } else if Instant::now() > deadline {
                ended = Some((Outcome::TimedOut, stage.arguments.join(" ")));
            }
            if ended.is_some() {
                child.kill().ok();
                child.wait()?;
                break None;
            }
            // The reader ends before the child is seen to; recv_timeout then returns at once.
            std::thread::sleep(Duration::from_millis(5));
        };
        reader.join().ok();
        if let (None, Some(status)) = (&ended, status)
            && !status.success()
        {
            ended = Some((Outcome::Caught, failed.try_recv().unwrap_or_else(|_| status.to_string())));
        }
        self.forget_failures()?;
        Ok(ended)
    }

    /// Removes the cases that property tests have written down: they would be tried on the next mutant.
    fn forget_failures(&self) -> Result<()> {
        let mut folders = vec![self.folder.clone()];
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder)? {
                let path = entry?.path();
                if path.is_dir() && path.file_name().is_some_and(|n| n == "proptest-regressions") {
                    std::fs::remove_dir_all(path)?;
                } else if path.is_dir() {
                    folders.push(path);
                }
            }
        }
        Ok(())
    }
}

/// The tests of the mutant's file, of its folder, of the crate, and some of `core/tests`.
fn stages(mutant: &Mutant, programs: &BTreeMap<String, PathBuf>) -> Result<Vec<Stage>> {
    let unit = programs.get("lenslet_core").context("no unit tests")?;
    let path = mutant.file.trim_start_matches("core/src/").trim_end_matches(".rs").trim_end_matches("/mod");
    let (file, module) = (path.replace('/', "::") + "::", mutant.module.clone() + "::");
    let stage = |program: &Path, arguments: &[&str]| Stage {
        program: program.to_owned(),
        arguments: arguments.iter().copied().chain(["--test-threads=1"]).map(str::to_owned).collect(),
    };
    let mut stages = Vec::new();
    if file == module {
        stages.push(stage(unit, &[&module]));
    } else {
        stages.push(stage(unit, &[&file]));
        stages.push(stage(unit, &[&module, "--skip", &file]));
    }
    stages.push(stage(unit, &["--skip", &module]));
    stages.extend(OTHER_TESTS.iter().filter_map(|name| Some(stage(programs.get(*name)?, &[]))));
    Ok(stages)
}
