//! `docs/constants.md` lists every tuning constant of the code: its value, what it is, and where it comes from.
//!
//! A tuning constant is one whose documentation ends in a line `Source: …`. The table is made from the code;
//! `LENSLET_WRITE_DOCS=1 cargo test --release --test constants` writes it anew.

#![allow(clippy::unwrap_used, clippy::expect_used)] // a test may fail loudly

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

const FOLDERS: [&str; 5] = ["core/src", "views/src", "data-gen/src", "train/src", "src"];

struct Constant {
    file: String,
    name: String,
    value: String,
    meaning: String,
    source: String,
}

/// The constants of one file that say where they come from.
fn constants(file: &str, text: &str) -> Vec<Constant> {
    let mut found = Vec::new();
    let mut doc: Vec<&str> = Vec::new();
    let mut lines = text.lines().map(str::trim);
    while let Some(line) = lines.next() {
        if let Some(text) = line.strip_prefix("///") {
            doc.push(text.trim());
            continue;
        }
        if line.starts_with("#[") {
            continue;
        }
        let declared = ["const ", "pub const ", "pub(super) const ", "pub(crate) const "];
        if let Some(rest) = declared.iter().find_map(|d| line.strip_prefix(d)) {
            let code = |line: &str| line.split("//").next().unwrap_or_default().trim().to_owned();
            let mut whole = code(rest);
            while !whole.ends_with(';') {
                let Some(next) = lines.next() else { break };
                whole.push(' ');
                whole.push_str(&code(next));
            }
            let source = doc.iter().position(|l| l.starts_with("Source:"));
            if let (Some(at), Some((head, value))) = (source, whole.split_once(" = ")) {
                let tidy = |lines: &[&str]| lines.join(" ").trim().replace('|', "\\|");
                found.push(Constant {
                    file: file.to_owned(),
                    name: head.split(':').next().unwrap().trim().to_owned(),
                    value: value.trim_end_matches(';').split_whitespace().collect::<Vec<_>>().join(" "),
                    meaning: tidy(&doc[..at]),
                    source: tidy(&doc[at..]).trim_start_matches("Source:").trim().to_owned(),
                });
            }
        }
        doc.clear();
    }
    found
}

fn files(folder: &Path, out: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            files(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

fn table(root: &Path) -> String {
    let mut text = String::from(
        "# Tuning constants\n\nEvery constant of the code that was chosen or measured, with its source. Made from the code by\n\
         `LENSLET_WRITE_DOCS=1 cargo test --release --test constants`; the test fails where this page is out of date.\n",
    );
    for folder in FOLDERS {
        let mut paths = Vec::new();
        files(&root.join(folder), &mut paths);
        for path in paths {
            let file = path.strip_prefix(root).unwrap().to_str().unwrap().replace('\\', "/");
            let found = constants(&file, &std::fs::read_to_string(&path).unwrap());
            let Some(first) = found.first() else { continue };
            let _ =
                write!(text, "\n## {}\n\n| constant | value | what it is | source |\n|---|---|---|---|\n", first.file);
            for c in &found {
                let _ = writeln!(text, "| `{}` | `{}` | {} | {} |", c.name, c.value, c.meaning, c.source);
            }
        }
    }
    text
}

#[test]
fn the_table_of_constants_is_that_of_the_code() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (page, made) = (root.join("docs/constants.md"), table(root));
    if std::env::var_os("LENSLET_WRITE_DOCS").is_some() {
        std::fs::write(&page, &made).unwrap();
    }
    let written = std::fs::read_to_string(&page).unwrap_or_default();
    let differs = written.lines().zip(made.lines()).find(|(a, b)| a != b);
    assert!(
        written == made,
        "docs/constants.md is out of date: LENSLET_WRITE_DOCS=1 cargo test --release --test constants; first difference {differs:?}"
    );
}

#[test]
fn constants_are_read_with_their_sources() {
    let text = "/// Pixels | wide.\n///\n/// Source: measured.\nconst WIDE: [f32; 2] =\n    [1.0, 2.0]; // old; one\n/// No source.\nconst OTHER: u8 = 1;\n";
    let found = constants("a.rs", text);
    assert_eq!(found.len(), 1);
    assert_eq!((found[0].name.as_str(), found[0].value.as_str()), ("WIDE", "[1.0, 2.0]"));
    assert_eq!((found[0].meaning.as_str(), found[0].source.as_str()), ("Pixels \\| wide.", "measured."));
}
