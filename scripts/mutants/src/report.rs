//! What became of the mutants, as Markdown.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context, Result};

use super::run::{Outcome, Verdicts};
use super::tree::Mutant;

/// Survivors that no test can catch, each with the reason: file, line, original, replacement, reason, tabs between.
const EQUIVALENT: &str = "scripts/mutants/equivalent.tsv";

#[derive(Default)]
struct Row {
    mutants: usize,
    failed: usize,
    timed_out: usize,
    survived: usize,
    equivalent: usize,
}

impl Row {
    fn print(&self, name: &str) {
        let caught = self.failed + self.timed_out;
        let share = |of: usize| 100.0 * caught as f64 / of.max(1) as f64;
        let Row { mutants, failed, timed_out, survived, equivalent } = self;
        println!(
            "| {name} | {mutants} | {failed} | {timed_out} | {survived} | {equivalent} | {:.1} % | {:.1} % |",
            share(*mutants),
            share(mutants - equivalent)
        );
    }
}

/// Prints the table, and the survivors that are not known to be equivalent.
pub fn print_report(root: &Path, mutants: &[Mutant], verdicts: &Verdicts) -> Result<()> {
    let known = std::fs::read_to_string(root.join(EQUIVALENT)).context(EQUIVALENT)?;
    let known: BTreeSet<String> =
        known.lines().filter_map(|l| l.rsplit_once('\t')).map(|(key, _)| key.to_owned()).collect();
    let mut rows: BTreeMap<&str, Row> = BTreeMap::new();
    let mut all = Row::default();
    let (mut open, mut untried) = (Vec::new(), 0);
    for mutant in mutants {
        let Some(verdict) = verdicts.get(&mutant.key()) else {
            untried += 1;
            continue;
        };
        for row in [rows.entry(&mutant.module).or_default(), &mut all] {
            row.mutants += 1;
            match verdict.outcome {
                Outcome::Caught => row.failed += 1,
                Outcome::TimedOut => row.timed_out += 1,
                Outcome::Survived => {
                    row.survived += 1;
                    row.equivalent += usize::from(known.contains(&mutant.key()));
                }
            }
        }
        if verdict.outcome == Outcome::Survived && !known.contains(&mutant.key()) {
            open.push(mutant);
        }
    }
    println!(
        "| module | mutants | a test failed | timed out | survived | of these equivalent | caught | caught of the others |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for (name, row) in &rows {
        row.print(name);
    }
    all.print("all");
    println!();
    if untried > 0 {
        println!("{untried} mutants have not been tried.\n");
    }
    for m in open {
        println!(
            "- {}:{}:{} [{}] `{}`: `{}` → `{}`",
            m.file, m.line, m.column, m.number, m.source, m.original, m.replacement
        );
    }
    Ok(())
}
