//! The copy of the checkout in which the mutants stand.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use super::candidates::{Candidate, find_candidates};
use super::sample::{Random, allot, choose, thin_literals};
use super::weave::{Woven, weave};

/// One mutant of the build.
#[derive(Clone, Serialize, Deserialize)]
pub struct Mutant {
    pub number: u32,
    /// Folder below `core/src`.
    pub module: String,
    /// From the root of the checkout.
    pub file: String,
    pub line: usize,
    pub column: usize,
    pub kind: String,
    /// The line of the source in which it begins.
    pub source: String,
    pub original: String,
    pub replacement: String,
}

impl Mutant {
    /// What stays the same while the line does, wherever that moves.
    pub fn key(&self) -> String {
        [self.file.as_str(), &self.source, &self.original, &self.replacement].join("\t")
    }
}

/// What is put at the end of `core/src/lib.rs`.
const SWITCH: &str = r#"
/// Whether the mutant of this number is on: the one that LENSLET_MUTANT names. Without it no mutant is, and the numbers
/// of those that were asked for are written to the file LENSLET_REACHED, if there is one.
#[inline(always)]
pub(crate) fn mutant_is_on(number: u32) -> bool {
    use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
    static ON: AtomicU32 = AtomicU32::new(u32::MAX);
    static SEEN: [AtomicU32; 65536] = [const { AtomicU32::new(0) }; 65536];
    #[cold]
    fn read(number: u32) -> bool {
        use std::io::Write;
        if let Some(on) = std::env::var("LENSLET_MUTANT").ok().and_then(|n| n.parse().ok()) {
            ON.store(on, Relaxed);
            return number == on;
        }
        let Some(path) = std::env::var_os("LENSLET_REACHED") else {
            ON.store(0, Relaxed);
            return false;
        };
        if SEEN[number as usize & 65535].swap(1, Relaxed) == 0 {
            let mut file = std::fs::OpenOptions::new().create(true).append(true).open(path).unwrap();
            file.write_all(format!("{number}\n").as_bytes()).unwrap();
        }
        false
    }
    let on = ON.load(Relaxed);
    if on == u32::MAX { read(number) } else { number == on }
}
"#;
/// Put at its beginning: mutants make conditions constant, variables unused, and arithmetic that never ends well.
const LINTS: &str =
    "#![allow(warnings, arithmetic_overflow, unconditional_panic, overflowing_literals, unconditional_recursion)]\n";

/// A file and the mutants chosen in it.
struct Source {
    name: String,
    text: String,
    chosen: Vec<(u32, Candidate)>,
}

/// Copies the checkout to `out/tree`, chooses mutants, weaves them in, and leaves out those that do not compile.
pub fn generate(root: &Path, out: &Path, modules: &[String], per_module: usize, seed: u64) -> Result<Vec<Mutant>> {
    let tree = out.join("tree");
    copy_checkout(root, &tree)?;
    let mut sources = Vec::new();
    let mut number = 0;
    for module in modules {
        let mut files = Vec::new();
        list_sources(&root.join("core/src").join(module), &mut files)?;
        ensure!(!files.is_empty(), "core/src/{module} has no files");
        let mut random = Random(seed);
        let mut parts = Vec::new();
        for file in files {
            let text = std::fs::read_to_string(&file)?;
            let found = find_candidates(&text).with_context(|| file.display().to_string())?;
            parts.push((file, text, thin_literals(found, &mut random)));
        }
        let counts: Vec<usize> = parts.iter().map(|(_, _, found)| found.len()).collect();
        println!("{module}: {} candidates in {} files", counts.iter().sum::<usize>(), counts.len());
        for ((file, text, found), n) in parts.into_iter().zip(allot(&counts, per_module)) {
            let chosen = choose(found, n, &mut random);
            let chosen = chosen.into_iter().map(|c| (next(&mut number), c)).collect();
            let name = file.strip_prefix(root)?.display().to_string();
            sources.push(Source { name, text, chosen });
        }
    }
    let library = tree.join("core/src/lib.rs");
    let text = std::fs::read_to_string(&library)?;
    std::fs::write(&library, format!("{LINTS}{text}{SWITCH}"))?;
    leave_out_what_does_not_compile(&tree, &target_folder(out), &mut sources)?;
    let mutants: Vec<Mutant> = sources.iter().flat_map(|s| s.chosen.iter().map(|(n, c)| describe(s, *n, c))).collect();
    std::fs::write(out.join("mutants.json"), serde_json::to_string_pretty(&mutants)?)?;
    Ok(mutants)
}

fn next(number: &mut u32) -> u32 {
    *number += 1;
    *number
}

fn describe(source: &Source, number: u32, candidate: &Candidate) -> Mutant {
    let short = |text: &str| {
        let words: Vec<&str> = text.split_whitespace().collect();
        let text = words.join(" ");
        if text.chars().count() > 90 { text.chars().take(87).chain("...".chars()).collect() } else { text }
    };
    Mutant {
        number,
        module: source.name.split('/').nth(2).unwrap_or_default().to_owned(),
        file: source.name.clone(),
        line: candidate.line,
        column: candidate.column,
        kind: candidate.kind.to_owned(),
        source: source.text.lines().nth(candidate.line - 1).unwrap_or_default().trim().to_owned(),
        original: short(&source.text[candidate.range.clone()]),
        replacement: short(&candidate.replacement),
    }
}

/// The files that git knows or would take, so neither build output nor anything else that it ignores.
fn copy_checkout(root: &Path, tree: &Path) -> Result<()> {
    let listed = Command::new("git")
        .args(["ls-files", "-z", "--cached", "--others", "--exclude-standard"])
        .current_dir(root)
        .output()
        .context("git")?;
    ensure!(listed.status.success(), "git ls-files: {}", String::from_utf8_lossy(&listed.stderr));
    let names = String::from_utf8(listed.stdout)?;
    let mut kept = BTreeSet::new();
    for name in names.split('\0').filter(|n| !n.is_empty()) {
        let (from, to) = (root.join(name), tree.join(name));
        if !from.is_file() {
            continue;
        }
        kept.insert(to.clone());
        let bytes = std::fs::read(&from)?;
        // A file that is as it was keeps its time, so cargo keeps what it built.
        if std::fs::read(&to).is_ok_and(|old| old == bytes) {
            continue;
        }
        std::fs::create_dir_all(to.parent().unwrap_or(tree))?;
        std::fs::write(&to, bytes)?;
    }
    remove_others(tree, &kept)
}

/// Where cargo builds the tree. Not the checkout's folder: cargo gives both the same names.
pub fn target_folder(out: &Path) -> PathBuf {
    out.join("target")
}

/// Removes what the checkout does not have: files that were deleted, or that tests have left.
fn remove_others(folder: &Path, kept: &BTreeSet<PathBuf>) -> Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            remove_others(&path, kept)?;
        } else if !kept.contains(&path) {
            std::fs::remove_file(&path)?;
        }
    }
    Ok(())
}

/// The files of a folder without those of tests, in order.
fn list_sources(folder: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut entries = entries.map(|e| Ok(e?.path())).collect::<Result<Vec<PathBuf>>>()?;
    entries.sort();
    for path in entries {
        if path.file_stem().is_some_and(|name| name == "tests") {
            continue;
        }
        if path.is_dir() {
            list_sources(&path, files)?;
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    Ok(())
}

/// Builds the tree, takes out the mutants that errors point at, and again until there is no error.
fn leave_out_what_does_not_compile(tree: &Path, target: &Path, sources: &mut [Source]) -> Result<()> {
    for round in 1..=12 {
        let mut woven: BTreeMap<String, Vec<Woven>> = BTreeMap::new();
        for source in sources.iter() {
            let chosen: Vec<(u32, &Candidate)> = source.chosen.iter().map(|(n, c)| (*n, c)).collect();
            let (text, places) = weave(&source.text, &chosen);
            std::fs::write(tree.join(&source.name), text)?;
            woven.insert(source.name.clone(), places);
        }
        let errors = build_unit_tests(tree, target)?;
        if errors.is_empty() {
            return Ok(());
        }
        let mut out = BTreeSet::new();
        for error in &errors {
            let places = woven.get(&error.file).map(Vec::as_slice).unwrap_or_default();
            let inside = |range: &std::ops::Range<usize>| range.start <= error.begin && error.end <= range.end;
            // Its own text, or the smallest place around; an error elsewhere is told by its other spans.
            if let Some(own) = places.iter().find(|w| inside(&w.arm)) {
                out.insert(own.number);
            } else if let Some(around) = places.iter().filter(|w| inside(&w.place)).min_by_key(|w| w.place.len()) {
                let place = around.place.clone();
                out.extend(places.iter().filter(|w| w.place == place).map(|w| w.number));
            }
        }
        println!("round {round}: {} errors, {} mutants left out", errors.len(), out.len());
        ensure!(!out.is_empty(), "none of these errors is in a mutant: {:#?}", errors.first());
        for source in sources.iter_mut() {
            source.chosen.retain(|(number, _)| !out.contains(number));
        }
    }
    anyhow::bail!("the mutants still do not compile")
}

/// Where an error of the compiler points.
#[derive(Debug)]
struct Pointed {
    file: String,
    begin: usize,
    end: usize,
    #[allow(dead_code)] // for the message
    message: String,
}

fn build_unit_tests(tree: &Path, target: &Path) -> Result<Vec<Pointed>> {
    // Not `cargo check`, for the dependencies have been built.
    let output = Command::new("cargo")
        .args(["test", "--release", "-p", "lenslet-core", "--lib", "--no-run", "--message-format=json"])
        .env("CARGO_TARGET_DIR", target)
        .current_dir(tree)
        .stderr(Stdio::inherit())
        .output()
        .context("cargo")?;
    let mut errors = Vec::new();
    for line in String::from_utf8_lossy(&output.stdout).lines() {
        let value: serde_json::Value = serde_json::from_str(line)?;
        let message = &value["message"];
        if value["reason"] != "compiler-message" || message["level"] != "error" {
            continue;
        }
        for span in message["spans"].as_array().into_iter().flatten().filter(|s| s["is_primary"] == true) {
            errors.push(Pointed {
                file: span["file_name"].as_str().unwrap_or_default().to_owned(),
                begin: span["byte_start"].as_u64().unwrap_or_default() as usize,
                end: span["byte_end"].as_u64().unwrap_or_default() as usize,
                message: message["message"].as_str().unwrap_or_default().to_owned(),
            });
        }
    }
    ensure!(output.status.success() || !errors.is_empty(), "cargo failed");
    Ok(if output.status.success() { Vec::new() } else { errors })
}
