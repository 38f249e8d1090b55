//! Documents against what they speak of: cards and their dictionaries, links, files, commands and flags, and the command
//! that printed each table of measurements.

#![allow(clippy::unwrap_used, clippy::expect_used)] // a test may fail loudly

mod markdown;

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

use lenslet_core::dictionary;
use markdown::{Document, root};
use sha2::{Digest, Sha256};

/// The first word after `mark` in a text, without what surrounds it.
fn after<'a>(text: &'a str, mark: &str) -> Option<&'a str> {
    let rest = &text[text.find(mark)? + mark.len()..];
    rest.split(|c: char| c.is_whitespace() || ['`', ','].contains(&c)).find(|word| !word.is_empty())
}

#[test]
fn every_card_describes_its_file() {
    let folder = root().join("dictionaries");
    let mut seen = 0;
    for entry in std::fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "lfd") {
            continue;
        }
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let card = std::fs::read_to_string(path.with_extension("md")).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let hash: String = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
        assert_eq!(after(&card, "- size: "), Some(bytes.len().to_string().as_str()), "{name}.md");
        assert_eq!(after(&card, "sha256 "), Some(hash.as_str()), "{name}.md");
        let dictionary = dictionary::load(&path).unwrap();
        let version = u32::from_le_bytes(bytes[8..12].try_into().unwrap());
        assert_eq!(card.contains("the file is of format 1"), version == 1, "{name}.md, format {version}");
        let photos = format!("- photos: the {} ", dictionary.recipe.photos.len());
        assert!(card.contains(&photos), "{name}.md does not say \"{photos}\"");
        assert_eq!(after(&card, "(seed "), Some(dictionary.recipe.seed.to_string().as_str()), "{name}.md");
        // The recipe beside it is the one inside.
        let recipe: serde_json::Value =
            serde_json::from_slice(&std::fs::read(path.with_extension("json")).unwrap()).unwrap();
        for (key, value) in recipe.as_object().unwrap() {
            let inside =
                if key == "seed" { &dictionary.recipe.seed.into() } else { &dictionary.recipe.parameters[key] };
            let same = match (value.as_f64(), inside.as_f64()) {
                (Some(a), Some(b)) => (a - b).abs() < 1e-6 * a.abs().max(1.0),
                _ => value == inside || value.is_object(),
            };
            assert!(same, "{name}.json says {key} = {value}, the file {inside}");
            for (part, value) in value.as_object().into_iter().flatten() {
                assert_eq!(value, &inside[part], "{name}.json, {key}.{part}");
            }
        }
        seen += 1;
    }
    assert!(seen >= 5, "{seen} dictionaries");
}

#[test]
fn links_lead_somewhere() {
    let documents = Document::all(&root());
    let anchors: BTreeMap<&str, Vec<String>> = documents.iter().map(|d| (d.name.as_str(), d.anchors())).collect();
    let mut broken = Vec::new();
    let mut count = 0;
    for document in &documents {
        let folder = std::path::Path::new(&document.name).parent().unwrap();
        for (line, target) in document.links() {
            if target.contains("://") || target.starts_with("mailto:") {
                continue;
            }
            count += 1;
            let (file, anchor) = target.split_once('#').map_or((target.as_str(), None), |(f, a)| (f, Some(a)));
            let mut name = std::path::PathBuf::new();
            for part in if file.is_empty() { document.name.clone().into() } else { folder.join(file) }.components() {
                if part.as_os_str() == ".." {
                    name.pop();
                } else {
                    name.push(part);
                }
            }
            let known = anchor.is_none_or(|a| {
                anchors.get(name.to_str().unwrap()).is_some_and(|all| all.iter().any(|known| known == a))
            });
            if !root().join(&name).exists() || !known {
                broken.push(format!("{}:{line}: {target}", document.name));
            }
        }
    }
    assert!(count > 20, "{count} links");
    assert!(broken.is_empty(), "these lead nowhere:\n{}", broken.join("\n"));
}

#[test]
fn files_that_are_named_exist() {
    let tops = [
        "core/",
        "views/",
        "data-gen/",
        "train/",
        "src/",
        "tests/",
        "test-support/",
        "docs/",
        "examples/",
        "benches/",
        "fuzz/",
        "dictionaries/",
        ".ci/",
        "python/",
    ];
    let mut absent = Vec::new();
    for document in Document::all(&root()).iter().filter(|d| d.name != "CHANGELOG.md") {
        for code in document.code().iter().filter(|c| !c.fenced) {
            for word in code.text.split(|c: char| c.is_whitespace() || [',', '(', ')', ';'].contains(&c)) {
                let word = word.split(':').next().unwrap_or_default();
                // NAME and * stand for many files; a folder that the reader makes has no such top.
                let named = tops.iter().any(|top| word.starts_with(top));
                if named && !word.contains("NAME") && !word.contains(['*', '{', '…']) && !root().join(word).exists() {
                    absent.push(format!("{}:{}: {word}", document.name, code.line));
                }
            }
        }
    }
    assert!(absent.is_empty(), "these files do not exist:\n{}", absent.join("\n"));
}

/// What the program and the examples understand.
struct Known {
    /// Command → its `--help`.
    commands: BTreeMap<String, String>,
    /// Example → its source.
    examples: BTreeMap<String, String>,
}

impl Known {
    fn new() -> Known {
        let help = |arguments: &[&str]| {
            let output = Command::new(env!("CARGO_BIN_EXE_lenslet")).args(arguments).output().unwrap();
            assert!(output.status.success(), "{arguments:?}");
            String::from_utf8(output.stdout).unwrap()
        };
        let mut commands = BTreeMap::new();
        let names = |text: &str| -> Vec<String> {
            let lines = text.lines().skip_while(|l| !l.starts_with("Commands:")).skip(1);
            let lines = lines.take_while(|l| l.starts_with(' ')).filter(|l| !l.starts_with("   "));
            lines.filter_map(|l| l.split_whitespace().next()).filter(|n| *n != "help").map(str::to_owned).collect()
        };
        for name in names(&help(&["--help"])) {
            let mut text = help(&[&name, "--help"]);
            for inner in names(&text.clone()) {
                text += &help(&[&name, &inner, "--help"]);
            }
            commands.insert(name, text);
        }
        let mut examples = BTreeMap::new();
        for entry in std::fs::read_dir(root().join("examples")).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|e| e == "rs") {
                let name = path.file_stem().unwrap().to_string_lossy().into_owned();
                examples.insert(name, std::fs::read_to_string(&path).unwrap());
            }
        }
        assert!(commands.len() >= 12 && examples.len() >= 5, "{:?}", commands.keys());
        Known { commands, examples }
    }

    /// What is wrong with a line of code that runs one of our commands or examples; nothing for any other line.
    fn wrong(&self, line: &str) -> Option<String> {
        let words: Vec<&str> =
            line.split_whitespace().map(|w| w.trim_matches(['"', '\'', '…', ',', '[', ']'])).collect();
        // At the beginning, or behind another command or `time`.
        let program = words.iter().position(|w| *w == "lenslet" || w.ends_with("release/lenslet")).filter(|&k| {
            words[..k].iter().all(|w| w.contains('=') || ["/usr/bin/time", "-v", "$"].contains(w))
                || words[k - 1].ends_with(';')
                || ["&&", "|", ";"].contains(&words[k - 1])
        });
        let cargo = words.windows(3).position(|w| w[0] == "cargo" && w[1] == "run");
        let example = words.iter().position(|w| *w == "--example");
        if let (Some(_), Some(at)) = (cargo, example) {
            let name = words.get(at + 1)?;
            let Some(source) = self.examples.get(*name) else { return Some(format!("no example {name}")) };
            let after = words.iter().position(|w| *w == "--").map_or(words.len(), |k| k + 1);
            return flags(&words[after..]).find(|f| !declares(source, f)).map(|f| format!("{name} knows no {f}"));
        }
        let rest = match (program, cargo) {
            (Some(k), None) => &words[k + 1..],
            (_, Some(_)) => &words[words.iter().position(|w| *w == "--")? + 1..],
            // Inline: a command's name and at least one option, or an example's.
            _ if words.len() > 1 && self.commands.contains_key(words[0]) => &words[..],
            _ => {
                let source = self.examples.get(*words.first()?)?;
                return flags(&words[1..]).find(|f| !declares(source, f)).map(|f| format!("{} knows no {f}", words[0]));
            }
        };
        let k = rest.iter().position(|w| !w.starts_with('-'))?;
        let name = rest[k];
        // `lenslet CMD`, `lenslet::prelude`, prose.
        if name.is_empty() || !name.bytes().all(|b| b.is_ascii_lowercase() || b == b'-') {
            return None;
        }
        let Some(help) = self.commands.get(name) else { return Some(format!("no command {name}")) };
        flags(rest).find(|flag| !mentions(help, flag)).map(|flag| format!("{name} knows no {flag}"))
    }
}

/// The options among words, up to the end of the command.
fn flags<'a>(words: &'a [&'a str]) -> impl Iterator<Item = String> + 'a {
    let ends = |w: &&&str| ![";", "|", "&&", "||", ">"].contains(*w) && !w.ends_with(';');
    let options = words.iter().take_while(ends).filter(|w| w.starts_with("--") && w.len() > 2);
    options.map(|w| w.split(['=', '…']).next().unwrap_or_default().trim_end_matches(['.', ':', ')']).to_owned())
}

/// Whether a help text has an option, as a whole word.
fn mentions(help: &str, flag: &str) -> bool {
    help.match_indices(flag)
        .any(|(at, _)| help[at + flag.len()..].chars().next().is_none_or(|c| !(c.is_ascii_alphanumeric() || c == '-')))
}

/// Whether an example's source declares an option: as a field, or by its name.
fn declares(source: &str, flag: &str) -> bool {
    let field = flag.trim_start_matches('-').replace('-', "_");
    flag == "--help"
        || source.contains(&format!("{field}:"))
        || mentions(source, flag)
        || source.contains(&format!("long = \"{}\"", flag.trim_start_matches('-')))
}

#[test]
fn commands_and_flags_that_are_named_exist() {
    let known = Known::new();
    let mut wrong = Vec::new();
    let mut count = 0;
    for document in Document::all(&root()).iter().filter(|d| d.name != "CHANGELOG.md") {
        for code in document.code() {
            count += 1;
            // A block that is no script may be a drawing, in which any word follows the name.
            let drawn = |what: &String| code.fenced && !code.shell && what.starts_with("no command");
            let what = known.wrong(&code.text).filter(|what| !drawn(what));
            wrong.extend(what.map(|what| format!("{}:{}: {what}", document.name, code.line)));
        }
        for table in document.tables() {
            let command = table.comment.as_deref().unwrap_or_default();
            wrong.extend(known.wrong(command).map(|what| format!("{}:{}: {what}", document.name, table.line)));
        }
    }
    assert!(count > 300, "{count} pieces of code");
    assert!(wrong.is_empty(), "these cannot be run:\n{}", wrong.join("\n"));
    // The check itself notices what is wrong.
    for bad in [
        "lenslet decode a.lfp --no-such-flag",
        "lenslet nonsense a",
        "cargo run --release -- demo --no-such-flag",
        "cargo run --release --example hex_psnr -- --no-such-flag",
        "cargo run --release --example nonsense",
        "infer --no-such-flag",
    ] {
        assert!(known.wrong(bad).is_some(), "{bad}");
    }
}

#[test]
fn tests_that_are_named_exist() {
    let names: BTreeSet<String> = ["tests", "core/tests"]
        .iter()
        .flat_map(|folder| std::fs::read_dir(root().join(folder)).unwrap())
        .map(|entry| entry.unwrap().path().file_stem().unwrap().to_string_lossy().into_owned())
        .collect();
    let mut absent = Vec::new();
    for document in Document::all(&root()).iter().filter(|d| d.name != "CHANGELOG.md") {
        for code in document.code().iter().filter(|c| c.text.contains("cargo test")) {
            let words: Vec<&str> = code.text.split_whitespace().collect();
            let wanted = words.windows(2).filter(|w| w[0] == "--test").map(|w| w[1]);
            absent.extend(wanted.filter(|n| !names.contains(*n)).map(|n| format!("{}: {n}", document.name)));
        }
    }
    assert!(absent.is_empty(), "{absent:?}");
}

/// A table of measurements stands under `<!-- measured: COMMAND, commit HASH -->` (CONTRIBUTING says what belongs there).
#[test]
fn tables_of_measurements_name_their_command() {
    let mut silent = Vec::new();
    let mut count = 0;
    for document in Document::all(&root()) {
        // Tables of the code, not of measurements.
        if ["docs/constants.md", "docs/file-formats.md", "docs/glossary.md"].contains(&document.name.as_str()) {
            continue;
        }
        // A page that a command wrote as a whole names it in its first lines.
        let whole = document.text.lines().take(8).any(|l| l.starts_with("- lenslet ") && l.contains(": lenslet "));
        for table in document.tables() {
            let said = table.comment.as_deref().is_some_and(|c| c.contains("commit ") && c.len() > 20);
            if table.has_measurements() {
                count += 1;
                if !said && !whole {
                    silent.push(format!("{}:{}", document.name, table.line));
                }
            }
        }
    }
    assert!(count > 10, "{count} tables of measurements");
    assert!(silent.is_empty(), "no command stands above these tables of measurements:\n{}", silent.join("\n"));
}

/// A test that cannot run says so through `lenslet-test-support`; none returns in silence.
#[test]
fn no_test_returns_in_silence() {
    let loud = ["data(", "Browser::start()", "Disk::new", "example(", "skip("];
    let mut silent = Vec::new();
    for folder in ["tests", "core/tests"] {
        for entry in std::fs::read_dir(root().join(folder)).unwrap() {
            let path = entry.unwrap().path();
            let Ok(text) = std::fs::read_to_string(&path) else { continue };
            for (n, line) in text.lines().enumerate() {
                let leaves =
                    line.contains("else { return }") || line.trim() == "return;" || line.contains("=> return,");
                if leaves && !loud.iter().any(|word| line.contains(word)) && !line.contains("contains(") {
                    silent.push(format!("{}:{}: {}", path.display(), n + 1, line.trim()));
                }
            }
        }
    }
    assert!(silent.is_empty(), "{}", silent.join("\n"));
}
