//! What a test may lack on some machines (real data, a browser, rights), and the list of tests that were skipped for it.
//!
//! A test that cannot run calls [`skip`], or asks for what it needs by [`data`] or [`chromium`], which call it. The
//! skip is written to stderr, which the test harness does not hide, and to `skipped/tests.tsv` in the target folder;
//! `.ci/run` empties that file before the tests and lists it after them. With `LENSLET_NO_SKIP=1` a skip is a failure.

mod made_files;

use std::ffi::OsString;
use std::fs::OpenOptions;
use std::io::Write;
use std::panic::Location;
use std::path::{Path, PathBuf};

pub use made_files::{lfp_segment, png_chunk};

/// Whether a skipped test should have been run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Skip {
    /// The machine lacks something that nobody promised: the run goes on.
    Excused,
    /// What the test needs was promised and is not whole: `.ci/run` fails.
    Owed,
}

impl Skip {
    /// The word in the list of skipped tests.
    pub fn word(self) -> &'static str {
        match self {
            Skip::Excused => "excused",
            Skip::Owed => "owed",
        }
    }
}

/// The root of the checkout.
fn checkout() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap_or(Path::new(".")).to_path_buf()
}

/// The folder of real data: what `LENSLET_DATA` names, else `../shared/data` beside the checkout. It may be absent.
fn data_folder(named: Option<OsString>, checkout: &Path) -> PathBuf {
    named.map_or_else(|| checkout.join("../shared/data"), PathBuf::from)
}

/// The list of skipped tests, below `CARGO_TARGET_DIR` or the checkout's `target`.
fn list(target: Option<OsString>, checkout: &Path) -> PathBuf {
    checkout.join(target.map_or_else(|| PathBuf::from("target"), PathBuf::from)).join("skipped/tests.tsv")
}

/// Whether a lacking piece was promised: the folder stands, or was named, and the piece is not in it.
fn blame(folder: &Path, named: bool) -> Skip {
    if named || folder.is_dir() { Skip::Owed } else { Skip::Excused }
}

/// A file or folder of the real data; without it the calling test is skipped.
///
/// Where the folder stands, or `LENSLET_DATA` names it, a piece that it lacks is [`Skip::Owed`].
///
/// # Panics
/// Where `LENSLET_NO_SKIP=1` and it is absent.
#[track_caller]
pub fn data(what: &str) -> Option<PathBuf> {
    let named = std::env::var_os("LENSLET_DATA");
    let folder = data_folder(named.clone(), &checkout());
    let path = folder.join(what);
    if path.exists() {
        return Some(path);
    }
    skip(blame(&folder, named.is_some()), &format!("{} is absent", path.display()));
    None
}

/// A program by name on `PATH`.
fn on_path(name: &str, path: Option<OsString>) -> Option<PathBuf> {
    std::env::split_paths(&path?).map(|folder| folder.join(name)).find(|file| file.is_file())
}

/// Chromium: the program that `CHROMIUM` names, else the first one on `PATH`; without it the calling test is skipped.
///
/// # Panics
/// Where `LENSLET_NO_SKIP=1` and there is none.
#[track_caller]
pub fn chromium() -> Option<PathBuf> {
    let named = std::env::var_os("CHROMIUM").map(PathBuf::from);
    if let Some(program) = &named {
        if program.is_file() {
            return named;
        }
        skip(Skip::Owed, &format!("CHROMIUM names {}, which is absent", program.display()));
        return None;
    }
    let names = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];
    let found = names.iter().find_map(|name| on_path(name, std::env::var_os("PATH")));
    if found.is_none() {
        skip(Skip::Excused, "no Chromium on PATH, and CHROMIUM names none");
    }
    found
}

/// Says that the calling test, or what follows in it, is skipped, and why.
///
/// # Panics
/// Where `LENSLET_NO_SKIP=1`, and where the list cannot be written.
#[track_caller]
pub fn skip(kind: Skip, why: &str) {
    let at = Location::caller();
    let thread = std::thread::current();
    let test = format!("{} ({}:{})", thread.name().unwrap_or("a test"), at.file(), at.line());
    assert!(std::env::var_os("LENSLET_NO_SKIP").is_none_or(|v| v != "1"), "{test} must not be skipped: {why}");
    let line = format!("{}\t{test}\t{}\n", kind.word(), why.replace(['\n', '\t'], " "));
    // Past the harness, which hides what passing tests print.
    let _ = std::io::stderr().write_all(format!("skipped: {line}").as_bytes());
    let path = list(std::env::var_os("CARGO_TARGET_DIR"), &checkout());
    let written = path.parent().map_or(Ok(()), std::fs::create_dir_all).and_then(|()| {
        // One write of one line: tests of other processes append to the same file.
        OpenOptions::new().create(true).append(true).open(&path)?.write_all(line.as_bytes())
    });
    assert!(written.is_ok(), "{}: {written:?}", path.display());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_rule_finds_the_data() {
        let root = Path::new("/a/b");
        assert_eq!(data_folder(None, root), Path::new("/a/b/../shared/data"));
        assert_eq!(data_folder(Some("/d".into()), root), Path::new("/d"));
    }

    #[test]
    fn the_list_lies_in_the_target_folder() {
        let root = Path::new("/a/b");
        assert_eq!(list(None, root), Path::new("/a/b/target/skipped/tests.tsv"));
        assert_eq!(list(Some("out".into()), root), Path::new("/a/b/out/skipped/tests.tsv"));
        assert_eq!(list(Some("/t".into()), root), Path::new("/t/skipped/tests.tsv"));
    }

    #[test]
    fn what_was_promised_is_owed() {
        assert_eq!(blame(Path::new("/nowhere/at/all"), false), Skip::Excused);
        assert_eq!(blame(Path::new("/nowhere/at/all"), true), Skip::Owed);
        assert_eq!(blame(&checkout(), false), Skip::Owed);
    }

    #[test]
    fn programs_are_found_on_the_path() {
        assert_eq!(on_path("Cargo.toml", Some(checkout().into_os_string())), Some(checkout().join("Cargo.toml")));
        assert_eq!(on_path("no-such-program", std::env::var_os("PATH")), None);
        assert_eq!(on_path("sh", None), None);
    }
}
