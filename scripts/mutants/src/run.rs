//! Runs the tests that reach a mutant, from the quickest to the slowest, until one fails.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use super::tree::{Mutant, target_folder};

/// Tests of `core/tests` that are tried beside the unit tests: those that take seconds.
const OTHER_TESTS: [&str; 5] = ["captures", "decode", "lightfield", "sparse_solvers", "whites"];
/// A run may take this many times as long as without a mutant, and [`GRACE`] more.
const TIMES: f64 = 5.0;
const GRACE: Duration = Duration::from_secs(5);
/// Tests below this many seconds run together.
const QUICK: f64 = 0.3;
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

/// A test, and what it does without a mutant.
#[derive(Clone, Serialize, Deserialize)]
struct Test {
    program: PathBuf,
    name: String,
    seconds: f64,
    /// The mutants that it asks for.
    reached: Vec<u32>,
}

/// Builds the tree and tries the mutants that have no verdict yet; with `again` the survivors, too. Without
/// `others` the unit tests alone; in any case those that take no more than `longest` seconds.
pub fn run(out: &Path, mutants: &[Mutant], again: bool, others: bool, longest: f64) -> Result<()> {
    let programs = build(out, others)?;
    let runner = Runner { folder: out.join("tree/core"), scratch: out.join("tmp") };
    let mut tests = runner.measure(&programs, &out.join("tests.json"), longest)?;
    tests.retain(|t| t.seconds <= longest);
    let mut verdicts = read_verdicts(out)?;
    for (k, mutant) in mutants.iter().enumerate() {
        let known = verdicts.get(&mutant.key());
        if known.is_some_and(|v| !again || v.outcome != Outcome::Survived) {
            continue;
        }
        let verdict = runner.try_mutant(mutant, &tests)?;
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
fn build(out: &Path, others: bool) -> Result<BTreeMap<String, PathBuf>> {
    let mut command = Command::new("cargo");
    command.args(["test", "--release", "-p", "lenslet-core", "--no-run", "--message-format=json", "--lib"]);
    for name in OTHER_TESTS.iter().filter(|_| others) {
        command.args(["--test", name]);
    }
    let output = command
        .env("CARGO_TARGET_DIR", target_folder(out))
        .current_dir(out.join("tree"))
        .stderr(Stdio::inherit())
        .output()?;
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
}

impl Runner {
    /// Runs each test by itself; what was measured of the same programs before is read from `file`. Those that took more
    /// than `longest` seconds the last time are left out.
    fn measure(&self, programs: &BTreeMap<String, PathBuf>, file: &Path, longest: f64) -> Result<Vec<Test>> {
        let time = |path: &Path| std::fs::metadata(path).and_then(|m| m.modified()).ok();
        let mut tests: Vec<Test> = match std::fs::read(file) {
            Ok(bytes) => serde_json::from_slice(&bytes)?,
            Err(_) => Vec::new(),
        };
        let long: BTreeSet<String> = tests.iter().filter(|t| t.seconds > longest).map(|t| t.name.clone()).collect();
        tests.retain(|t| programs.values().any(|p| *p == t.program && time(p) < time(file)));
        let known: BTreeSet<(PathBuf, String)> = tests.iter().map(|t| (t.program.clone(), t.name.clone())).collect();
        for program in programs.values() {
            let listed = Command::new(program).arg("--list").current_dir(&self.folder).output()?;
            for name in String::from_utf8_lossy(&listed.stdout).lines().filter_map(|l| l.strip_suffix(": test")) {
                if known.contains(&(program.clone(), name.to_owned())) {
                    continue;
                }
                if long.contains(name) {
                    println!("left out, for it took more than {longest} s: {name}");
                    continue;
                }
                let mut test =
                    Test { program: program.clone(), name: name.to_owned(), seconds: 0.0, reached: Vec::new() };
                let begin = Instant::now();
                if let Some((_, by)) = self.run_tests(&[&test], None, Duration::from_secs(600))? {
                    println!("left out, for it fails without a mutant: {name} ({by})");
                    continue;
                }
                test.seconds = begin.elapsed().as_secs_f64();
                let reached = std::fs::read_to_string(self.scratch.join("reached")).unwrap_or_default();
                test.reached = reached.lines().filter_map(|l| l.parse().ok()).collect();
                tests.push(test);
            }
        }
        let seconds: f64 = tests.iter().map(|t| t.seconds).sum();
        println!("{} tests, {seconds:.0} s one by one", tests.len());
        std::fs::write(file, serde_json::to_string(&tests)?)?;
        Ok(tests)
    }

    /// Runs the tests that reach a mutant, the quick ones together and first.
    fn try_mutant(&self, mutant: &Mutant, tests: &[Test]) -> Result<Verdict> {
        let begin = Instant::now();
        let mut near: Vec<&Test> = tests.iter().filter(|t| t.reached.contains(&mutant.number)).collect();
        let reached = !near.is_empty();
        near.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
        let (quick, slow): (Vec<&Test>, Vec<&Test>) = near.into_iter().partition(|t| t.seconds < QUICK);
        let mut groups: BTreeMap<&Path, Vec<&Test>> = BTreeMap::new();
        quick.into_iter().for_each(|t| groups.entry(&t.program).or_default().push(t));
        for group in groups.into_values().chain(slow.into_iter().map(|t| vec![t])) {
            let usual = group.iter().map(|t| t.seconds).sum::<f64>();
            let limit = Duration::from_secs_f64(usual * TIMES) + GRACE;
            if let Some((outcome, by)) = self.run_tests(&group, Some(mutant.number), limit)? {
                return Ok(Verdict { outcome, by, seconds: begin.elapsed().as_secs_f64() });
            }
        }
        let by = if reached { "" } else { "no test reaches it" }.to_owned();
        Ok(Verdict { outcome: Outcome::Survived, by, seconds: begin.elapsed().as_secs_f64() })
    }

    /// Runs tests of one program; what ended the run before all had passed.
    fn run_tests(&self, tests: &[&Test], number: Option<u32>, limit: Duration) -> Result<Option<(Outcome, String)>> {
        let program = &tests.first().context("no tests")?.program;
        // A killed test leaves files.
        std::fs::remove_dir_all(&self.scratch).ok();
        std::fs::create_dir_all(&self.scratch)?;
        let mut child = Command::new("sh")
            .args(["-c", &format!("ulimit -v {MEMORY_KIB}; exec \"$0\" \"$@\"")])
            .arg(program)
            .args(["--test-threads=1", "--exact"])
            .args(tests.iter().map(|t| &t.name))
            .current_dir(&self.folder)
            .envs(number.map(|n| ("LENSLET_MUTANT", n.to_string())))
            .env("LENSLET_REACHED", self.scratch.join("reached"))
            .env("LENSLET_DATA", self.scratch.join("none"))
            .env("TMPDIR", &self.scratch)
            .env("RAYON_NUM_THREADS", "1")
            .env("PROPTEST_RNG_SEED", "2013") // as .cargo/config.toml has it
            .env("PROPTEST_MAX_SHRINK_ITERS", "0")
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .with_context(|| program.display().to_string())?;
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
                ended = Some((Outcome::TimedOut, tests.last().map(|t| t.name.clone()).unwrap_or_default()));
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
