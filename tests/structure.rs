//! The shape of the code, read from its `use` lines: no file uses a higher room, and no files use each other in a circle.
//!
//! A room is a folder or file right below a crate's `src`. Test modules, comments and strings are left out; `mod x;` and
//! `pub use` (a façade) are not uses. A name that a module re-exports counts as a use of the file that defines it.

#![allow(clippy::unwrap_used, clippy::expect_used)] // a test may fail loudly

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Crates and the rooms of each, lowest first: a file may use its own room and those listed before it.
const CRATES: [(&str, &str, &[&str]); 6] = [
    (
        "lenslet_core",
        "core/src",
        &[
            "error",
            "progress",
            "digest",
            "input",
            "output",
            "linalg",
            "random",
            "colour",
            "geometry",
            "noise",
            "image",
            "stroke_font",
            "pfm",
            "picture_file",
            "interpolation",
            "container",
            "sampling",
            "calibration",
            "decode",
            "sparse",
            "dictionary",
            "lightfield",
            "metrics",
        ],
    ),
    (
        "lenslet_views",
        "views/src",
        &[
            "buckets",
            "disparity",
            "error",
            "target",
            "interpolate",
            "inverse",
            "multiview",
            "reconstruct",
            "method",
            "renderer",
            "assess",
        ],
    ),
    ("lenslet_data_gen", "data-gen/src", &["random", "photo", "pairs", "simulate"]),
    ("lenslet_train", "train/src", &[]),
    ("lenslet", "src", &["image_io", "page", "apps", "prelude"]),
    ("program", "src/bin/lenslet", &["report", "ablation", "cli"]),
];

/// Which crates a crate may use.
const BELOW: [(&str, &[&str]); 4] = [
    ("lenslet_core", &[]),
    ("lenslet_views", &["lenslet_core"]),
    ("lenslet_data_gen", &["lenslet_core"]),
    ("lenslet_train", &["lenslet_core", "lenslet_views", "lenslet_data_gen"]),
];

/// What a library crate must not know.
const PROGRAM_ONLY: [&str; 6] = ["anyhow", "clap", "ctrlc", "indicatif", "gif", "base64"];

/// The files of a crate by module path (`""` is the root, `a::b` the file `a/b.rs` or `a/b/mod.rs`).
struct Crate {
    name: String,
    modules: BTreeMap<String, Module>,
}

#[derive(Default)]
struct Module {
    /// Paths used, as written, braces expanded.
    uses: Vec<String>,
    /// Names re-exported from elsewhere: name → path; globs under `*`.
    exports: Vec<(String, String)>,
}

impl Crate {
    fn read(name: &str, root: &Path) -> Crate {
        let mut modules = BTreeMap::new();
        walk(root, &mut |path| {
            let relative = path.strip_prefix(root).unwrap().with_extension("");
            let mut parts: Vec<&str> = relative.iter().map(|p| p.to_str().unwrap()).collect();
            if matches!(parts.last(), Some(&("mod" | "lib" | "main"))) {
                parts.pop();
            }
            // Programs are crates of their own.
            if parts.first() != Some(&"bin") {
                modules.insert(parts.join("::"), Module::parse(&std::fs::read_to_string(path).unwrap()));
            }
        });
        Crate { name: name.to_owned(), modules }
    }

    /// The module whose file defines what `path`, written in module `from`, names; none outside the crate.
    fn resolve(&self, from: &str, path: &str) -> Option<String> {
        self.resolve_within(from, path, 0)
    }

    fn resolve_within(&self, from: &str, path: &str, depth: usize) -> Option<String> {
        let mut parts: Vec<&str> = path.split("::").collect();
        let mut at: Vec<&str> = if from.is_empty() { Vec::new() } else { from.split("::").collect() };
        match parts[0] {
            "crate" => at.clear(),
            "self" => {}
            "super" => {
                at.pop()?;
            }
            first if first == self.name => at.clear(),
            first if self.modules.contains_key(&join(from, first)) => at.push(first),
            _ => return None,
        }
        parts.remove(0);
        while !parts.is_empty() {
            if parts[0] == "super" {
                at.pop()?;
            } else if self.modules.contains_key(&join(&at.join("::"), parts[0])) {
                at.push(parts[0]);
            } else {
                break;
            }
            parts.remove(0);
        }
        let module = at.join("::");
        let found = self.modules.get(&module)?;
        if let Some(name) = parts.first().filter(|_| depth < 8) {
            let named = found.exports.iter().filter(|(export, _)| export == name);
            for (_, target) in named {
                let rest: Vec<&str> = std::iter::once(target.as_str()).chain(parts[1..].iter().copied()).collect();
                if let Some(file) = self.resolve_within(&module, &rest.join("::"), depth + 1) {
                    return Some(file);
                }
            }
        }
        Some(module)
    }

    /// Which file uses which, itself left out.
    fn arrows(&self) -> BTreeMap<String, BTreeSet<String>> {
        let mut arrows: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        for (from, module) in &self.modules {
            let used = module.uses.iter().filter_map(|path| self.resolve(from, path)).filter(|to| to != from);
            arrows.entry(from.clone()).or_default().extend(used);
        }
        arrows
    }
}

impl Module {
    fn parse(source: &str) -> Module {
        let code = without_tests(&without_comments_and_strings(source));
        let mut module = Module::default();
        let (mut at, mut others) = (0, String::new());
        while let Some(found) = next_use(&code[at..]) {
            let (start, end) = (at + found.0, at + found.1);
            others.push_str(&code[at..start]);
            let text = &code[start..end];
            let public = text.trim_start().starts_with("pub");
            let body = text[text.find("use ").unwrap() + 4..].trim_end_matches(';').trim();
            for path in expanded(body) {
                let (path, name) = match path.split_once(" as ") {
                    Some((path, name)) => (path.trim().to_owned(), name.trim().to_owned()),
                    None => (path.clone(), path.rsplit("::").next().unwrap().to_owned()),
                };
                if public {
                    module.exports.push((name, path));
                } else {
                    module.uses.push(path);
                }
            }
            at = end;
        }
        others.push_str(&code[at..]);
        module.uses.extend(inline_paths(&others));
        module
    }
}

fn join(module: &str, name: &str) -> String {
    if module.is_empty() { name.to_owned() } else { format!("{module}::{name}") }
}

fn walk(folder: &Path, each: &mut dyn FnMut(&Path)) {
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            walk(&path, each);
        } else if path.extension().is_some_and(|e| e == "rs") {
            each(&path);
        }
    }
}

fn without_comments_and_strings(source: &str) -> String {
    let mut out = String::with_capacity(source.len());
    let bytes: Vec<char> = source.chars().collect();
    let mut k = 0;
    while k < bytes.len() {
        match (bytes[k], bytes.get(k + 1)) {
            ('/', Some('/')) => {
                while k < bytes.len() && bytes[k] != '\n' {
                    k += 1;
                }
            }
            ('/', Some('*')) => {
                while k + 1 < bytes.len() && !(bytes[k] == '*' && bytes[k + 1] == '/') {
                    k += 1;
                }
                k += 2;
            }
            ('r', Some('"' | '#')) if !out.ends_with(|c: char| c.is_alphanumeric() || c == '_') => {
                // A raw string ends at its quote and as many # as it began with; `r#name` is none.
                let hashes = bytes[k + 1..].iter().take_while(|c| **c == '#').count();
                if bytes.get(k + 1 + hashes) != Some(&'"') {
                    out.push('r');
                    k += 1;
                    continue;
                }
                k += 2 + hashes;
                let ends = |k: usize| bytes[k] == '"' && (1..=hashes).all(|h| bytes.get(k + h) == Some(&'#'));
                while k < bytes.len() && !ends(k) {
                    k += 1;
                }
                k += 1 + hashes;
            }
            ('"', _) => {
                k += 1;
                while k < bytes.len() && bytes[k] != '"' {
                    k += if bytes[k] == '\\' { 2 } else { 1 };
                }
                k += 1;
            }
            // Characters, not lifetimes.
            ('\'', Some('\\')) => {
                k += 3;
                while k < bytes.len() && bytes[k] != '\'' {
                    k += 1;
                }
                k += 1;
            }
            ('\'', Some(_)) if bytes.get(k + 2) == Some(&'\'') => k += 3,
            (c, _) => {
                out.push(c);
                k += 1;
            }
        }
    }
    out
}

/// Cuts every item that follows `#[cfg(test)]`.
fn without_tests(code: &str) -> String {
    let mut out = String::new();
    let mut rest = code;
    while let Some(at) = rest.find("#[cfg(test)]") {
        out.push_str(&rest[..at]);
        let after = &rest[at..];
        let open = after.find('{').unwrap_or(after.len());
        let semicolon = after.find(';').unwrap_or(after.len());
        if semicolon < open {
            rest = &after[semicolon + 1..];
            continue;
        }
        let mut depth = 0usize;
        let mut end = after.len();
        for (k, c) in after.char_indices() {
            match c {
                '{' => depth += 1,
                '}' => {
                    depth -= 1;
                    if depth == 0 {
                        end = k + 1;
                        break;
                    }
                }
                _ => {}
            }
        }
        rest = &after[end.min(after.len())..];
    }
    out.push_str(rest);
    out
}

/// Start and end of the next `use …;`, visibility included.
fn next_use(code: &str) -> Option<(usize, usize)> {
    let mut from = 0;
    loop {
        let at = from + code[from..].find("use ")?;
        let line = code[..at].rfind('\n').map_or(0, |k| k + 1);
        let before = code[line..at].trim();
        if before.is_empty() || before == "pub" || before.starts_with("pub(") && before.ends_with(')') {
            let end = at + code[at..].find(';')? + 1;
            return Some((line, end));
        }
        from = at + 4;
    }
}

/// `a::{b, c::{d, self}}` → `a::b`, `a::c::d`, `a::c`.
fn expanded(body: &str) -> Vec<String> {
    let body: String = body.split_whitespace().collect::<Vec<_>>().join(" ");
    let Some(open) = body.find('{') else { return vec![body.trim().to_owned()] };
    let prefix = body[..open].trim_end_matches("::").trim().to_owned();
    let inner = &body[open + 1..body.rfind('}').unwrap()];
    let (mut parts, mut depth, mut start) = (Vec::new(), 0i32, 0);
    for (k, c) in inner.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(&inner[start..k]);
                start = k + 1;
            }
            _ => {}
        }
    }
    parts.push(&inner[start..]);
    let mut out = Vec::new();
    for part in parts.iter().map(|p| p.trim()).filter(|p| !p.is_empty()) {
        for path in expanded(part) {
            out.push(match path.as_str() {
                "self" => prefix.clone(),
                _ if prefix.is_empty() => path,
                _ => format!("{prefix}::{path}"),
            });
        }
    }
    out
}

/// Paths written out in code: `crate::a::b(…)`, `super::c::D`, `child::f(…)`.
fn inline_paths(code: &str) -> Vec<String> {
    let mut out = Vec::new();
    let mut word = String::new();
    for c in code.chars().chain([' ']) {
        if c.is_alphanumeric() || c == '_' || c == ':' {
            word.push(c);
            continue;
        }
        let path = std::mem::take(&mut word);
        let path = path.trim_end_matches(':');
        if path.contains("::") && path.starts_with(|c: char| c.is_lowercase()) {
            out.push(path.to_owned());
        }
    }
    out
}

/// A circle of files, if there is one.
fn circle(arrows: &BTreeMap<String, BTreeSet<String>>) -> Option<Vec<String>> {
    fn visit<'a>(
        at: &'a str,
        arrows: &'a BTreeMap<String, BTreeSet<String>>,
        path: &mut Vec<&'a str>,
        done: &mut BTreeSet<&'a str>,
    ) -> Option<Vec<String>> {
        if let Some(start) = path.iter().position(|p| *p == at) {
            return Some(path[start..].iter().chain([&at]).map(|s| (*s).to_owned()).collect());
        }
        if !done.insert(at) {
            return None;
        }
        path.push(at);
        for to in arrows.get(at).into_iter().flatten() {
            if let Some(found) = visit(to, arrows, path, done) {
                return Some(found);
            }
        }
        path.pop();
        None
    }
    let mut done = BTreeSet::new();
    arrows.keys().find_map(|at| visit(at, arrows, &mut Vec::new(), &mut done))
}

/// Every use of a room that stands later in the order, as `file uses file`.
fn upward(found: &Crate, order: &[&str]) -> Vec<String> {
    let room = |module: &str| module.split("::").next().unwrap().to_owned();
    let rank = |module: &str| order.iter().position(|r| *r == room(module));
    let mut out = Vec::new();
    for (from, uses) in found.arrows() {
        for to in uses {
            if let (Some(a), Some(b)) = (rank(&from), rank(&to))
                && b > a
            {
                out.push(format!("{from} uses {to}"));
            }
        }
    }
    out
}

fn workspace() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn no_room_uses_a_higher_one() {
    let mut wrong = Vec::new();
    for (name, root, order) in CRATES {
        let found = Crate::read(name, &workspace().join(root));
        wrong.extend(upward(&found, order).into_iter().map(|u| format!("{root}: {u}")));
        for module in found.modules.keys().filter(|m| !m.is_empty() && !order.is_empty()) {
            let room = module.split("::").next().unwrap();
            if !order.contains(&room) {
                wrong.push(format!("{root}: the room {room} has no place in the order"));
            }
        }
    }
    wrong.dedup();
    assert!(wrong.is_empty(), "{} arrows upwards:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn no_files_use_each_other_in_a_circle() {
    let mut wrong = Vec::new();
    for (name, root, _) in CRATES {
        let mut arrows = Crate::read(name, &workspace().join(root)).arrows();
        // Each circle is cut at its last arrow to find the next one.
        while let Some(found) = circle(&arrows) {
            wrong.push(format!("{root}: {}", found.join(" uses ")));
            arrows.get_mut(&found[found.len() - 2]).unwrap().remove(&found[found.len() - 1]);
        }
    }
    assert!(wrong.is_empty(), "{} circles:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn no_crate_uses_a_higher_one_or_what_only_the_program_needs() {
    for (name, below) in BELOW {
        let root = CRATES.into_iter().find(|c| c.0 == name).unwrap().1;
        let manifest = std::fs::read_to_string(workspace().join(root).join("../Cargo.toml")).unwrap();
        let dependencies = manifest.split("[dev-dependencies]").next().unwrap();
        let declared = |package: &str| dependencies.lines().any(|l| l.split(['.', ' ', '=']).next() == Some(package));
        for (other, _) in BELOW {
            let package = other.replace('_', "-");
            assert!(!declared(&package) || below.contains(&other), "{name} depends on {package}");
        }
        for package in PROGRAM_ONLY {
            assert!(!declared(package), "{name} depends on {package}");
        }
    }
}

/// Names below `[…dependencies]` headings whose heading starts with `kind`.
fn declared_dependencies(manifest: &str, kind: &str) -> Vec<String> {
    let mut inside = false;
    let mut names = Vec::new();
    for line in manifest.lines().map(str::trim) {
        if let Some(heading) = line.strip_prefix('[') {
            let heading = heading.trim_end_matches(']');
            inside = heading == kind || heading.starts_with("target.") && heading.ends_with(&format!(".{kind}"));
        } else if inside && line.starts_with(|c: char| c.is_ascii_alphabetic()) {
            names.push(line.split(['.', ' ', '=']).next().unwrap().to_owned());
        }
    }
    names
}

/// The dependencies that no line of the code names.
fn unused(names: &[String], code: &str) -> Vec<String> {
    let named = |name: &str| {
        let ident = name.replace('-', "_");
        code.match_indices(&ident).any(|(k, _)| {
            let whole = !code[..k].ends_with(|c: char| c.is_alphanumeric() || c == '_');
            let after = code[k + ident.len()..].trim_start();
            whole
                && (after.starts_with("::")
                    || after.starts_with(';')
                    || after.starts_with(" as ")
                    || after.starts_with('{'))
        })
    };
    names.iter().filter(|name| !named(name)).cloned().collect()
}

#[test]
fn every_dependency_is_used() {
    for (folder, more) in [
        ("core", &["tests"][..]),
        ("views", &[]),
        ("data-gen", &[]),
        ("train", &[]),
        (".", &["tests", "examples", "benches"]),
    ] {
        let root = workspace().join(folder);
        let manifest = std::fs::read_to_string(root.join("Cargo.toml")).unwrap();
        let code_of = |folders: &[&str]| {
            let mut text = String::new();
            for folder in folders.iter().map(|f| root.join(f)).filter(|f| f.is_dir()) {
                let code = |path: &Path| without_comments_and_strings(&std::fs::read_to_string(path).unwrap());
                walk(&folder, &mut |path| text.push_str(&without_tests(&code(path))));
            }
            text
        };
        let library = code_of(&["src"]);
        let wrong = unused(&declared_dependencies(&manifest, "dependencies"), &library);
        // A dependency that only tests or doctests need is a dev-dependency.
        assert!(wrong.is_empty(), "{folder}/Cargo.toml: nothing uses {}", wrong.join(", "));
        let mut all = String::new();
        for folder in ["src"].iter().chain(more).map(|f| root.join(f)).filter(|f| f.is_dir()) {
            walk(&folder, &mut |path| all.push_str(&std::fs::read_to_string(path).unwrap()));
        }
        let wrong = unused(&declared_dependencies(&manifest, "dev-dependencies"), &all);
        assert!(wrong.is_empty(), "{folder}/Cargo.toml: no test uses {}", wrong.join(", "));
    }
}

#[test]
fn unused_dependencies_are_found() {
    let manifest = "[dependencies]\na-b.workspace = true\nc = \"1\"\n[target.'cfg(unix)'.dependencies]\nd = { version = \"1\" }\n[dev-dependencies]\ne = \"1\"\n";
    assert_eq!(declared_dependencies(manifest, "dependencies"), ["a-b", "c", "d"]);
    assert_eq!(declared_dependencies(manifest, "dev-dependencies"), ["e"]);
    let names = declared_dependencies(manifest, "dependencies");
    assert_eq!(unused(&names, "use a_b::X; fn f() { d::g() } // abc::h, c_d::e"), ["c"]);
}

#[test]
fn circles_and_upward_arrows_are_found() {
    let module = |source: &str| Module::parse(source);
    let planted = |b: &str| Crate {
        name: "planted".into(),
        modules: BTreeMap::from([
            (String::new(), module("mod a; mod b;")),
            ("a".into(), module("mod one;\npub use one::Thing;\nfn f() { crate::b::g() }")),
            ("a::one".into(), module("pub struct Thing; // use crate::b;")),
            ("b".into(), module(b)),
        ]),
    };
    // Through a façade, renamed, nested, written out, inside a test, in a comment.
    let innocent = planted("use std::fmt;\nuse crate::a::{Thing as T};\n#[cfg(test)]\nmod tests { use crate::a; }");
    assert_eq!(innocent.arrows()["b"], BTreeSet::from(["a::one".to_owned()]));
    assert_eq!(circle(&innocent.arrows()), None);
    assert_eq!(upward(&innocent, &["a", "b"]), ["a uses b"]);
    assert!(upward(&innocent, &["b", "a"]).contains(&"b uses a::one".to_owned()));
    for guilty in
        ["use super::a::f;", "use crate::{a::{self}};", "fn g() { crate::a::f() }", "fn g() { super::a::f(\"}\") }"]
    {
        let found = circle(&planted(guilty).arrows());
        assert_eq!(found.as_deref().map(|c| c.len()), Some(3), "{guilty}: {found:?}");
    }
    assert_eq!(expanded("a::{b, c::{d, self}}"), ["a::b", "a::c::d", "a::c"]);
    let strings = "f('{', '\\'', \"}\", r#\"{\"#); fn g<'a>(r: &'a u8) {} /* { */ // {";
    assert_eq!(without_comments_and_strings(strings).trim(), "f(, , , ); fn g<'a>(r: &'a u8) {}");
}
