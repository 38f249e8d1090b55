//! Mutation testing of `lenslet-core`: what its tests would not notice.
//!
//! A mutant is the crate with one operator, condition, literal or statement changed; a test should fail. A build for
//! each would take days, so all mutants stand in one build, each behind `if crate::mutant_is_on(NUMBER)`, and the
//! environment variable `LENSLET_MUTANT` switches one on (mutant schemata: Untch, Offutt and Harrold, 1993).
//!
//! ```sh
//! cargo build --release --manifest-path scripts/mutants/Cargo.toml
//! mutants=scripts/mutants/target/release/lenslet-mutants
//! $mutants generate --seed 1 --per-module 160 calibration sampling sparse dictionary
//! $mutants run        # hours; it goes on where it was stopped
//! $mutants report     # the table and the survivors
//! $mutants run --again  # the survivors, after tests were added and `generate` was called again
//! ```
//!
//! All from the root of the checkout. `target/mutants` has the changed copy of it (`tree`), its build, the mutants (`mutants.json`)
//! and what became of them (`results.json`). `run FOLDER …` tries those of the folders only;
//! `run --unit-tests` leaves `core/tests` out, which are longer in building than in running; `run --longest 4` leaves out
//! what takes more than four seconds, so a survivor costs less.
//!
//! First every unit test and the quick ones of `core/tests` run by themselves, to know how long each takes and which
//! mutants it reaches (`tests.json`); a mutant then meets the tests that reach it, the quickest first, on one thread and
//! without the data that no licence lets us commit. A failed test, a crash, more than 6 GiB and five times the usual time
//! count as caught. What is never mutated: `candidates.rs` says it.

mod candidates;
mod report;
mod run;
mod sample;
mod tree;
mod weave;

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use tree::Mutant;

const USAGE: &str = "generate [--seed N] [--per-module N] FOLDER…, run [--again] [--unit-tests] [--longest SECONDS] [FOLDER…] or report";

fn main() -> Result<()> {
    let mut words = std::env::args().skip(1);
    let command = words.next().context(USAGE)?;
    let (mut seed, mut per_module, mut modules) = (1, 160, Vec::new());
    let (mut again, mut others, mut longest) = (false, true, f64::INFINITY);
    while let Some(word) = words.next() {
        match word.as_str() {
            "--seed" => seed = words.next().context("--seed N")?.parse()?,
            "--per-module" => per_module = words.next().context("--per-module N")?.parse()?,
            "--again" => again = true,
            "--unit-tests" => others = false,
            "--longest" => longest = words.next().context("--longest SECONDS")?.parse()?,
            _ if word.starts_with('-') => bail!("no option {word}: {USAGE}"),
            _ => modules.push(word),
        }
    }
    let root = std::env::current_dir()?;
    ensure!(root.join("core/src/lib.rs").is_file(), "run this from the root of the checkout");
    let out = root.join("target/mutants");
    match command.as_str() {
        "generate" => {
            ensure!(!modules.is_empty(), "{USAGE}");
            std::fs::create_dir_all(out.join("tree"))?;
            let mutants = tree::generate(&root, &out, &modules, per_module, seed)?;
            println!("{} mutants", mutants.len());
            Ok(())
        }
        "run" => {
            let mut mutants = read_mutants(&out)?;
            mutants.retain(|m| modules.is_empty() || modules.contains(&m.module));
            run::run(&out, &mutants, again, others, longest)
        }
        "report" => report::print_report(&root, &read_mutants(&out)?, &run::read_verdicts(&out)?),
        _ => bail!("no command {command}: {USAGE}"),
    }
}

fn read_mutants(out: &Path) -> Result<Vec<Mutant>> {
    let path = out.join("mutants.json");
    let bytes = std::fs::read(&path).with_context(|| format!("{}: generate first", path.display()))?;
    Ok(serde_json::from_slice(&bytes)?)
}
