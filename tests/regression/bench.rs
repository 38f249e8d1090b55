//! What the cases share: a folder with a simulated capture, its calibration and a light field, and the program's answers.

#![allow(dead_code)] // every kind of fault uses a part

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// What one run answered.
pub struct Answer {
    /// Exit code; `None` when a signal ended it.
    pub code: Option<i32>,
    /// What it wrote to stdout.
    pub out: String,
    /// What it wrote to stderr.
    pub err: String,
}

impl From<Output> for Answer {
    fn from(output: Output) -> Answer {
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        Answer { code: output.status.code(), out: text(&output.stdout), err: text(&output.stderr) }
    }
}

/// A folder of its own for one case; removed when dropped.
pub struct Bench {
    folder: tempfile::TempDir,
}

/// Made once for all cases: `s1/`, `s2/` (simulations of 160 x 160 pixels), `cam.calib`, `lf/` (3 x 3 views, 40 pixels).
fn stock() -> &'static Path {
    static STOCK: OnceLock<tempfile::TempDir> = OnceLock::new();
    STOCK
        .get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let run = |line: &str| {
                let answer: Answer = command(folder.path(), line).output().unwrap().into();
                assert_eq!(answer.code, Some(0), "{line}: {}", answer.err);
            };
            for k in [1, 2] {
                run(&format!("simulate --sensor 160 --size 80 --views 1 --whites 1 --seed {k} --out s{k}"));
            }
            run("calibrate s1/white-00.lfp --out cam.calib");
            run("decode s1/capture.lfp -c cam.calib --size 40 --views 3 --method barycentric --out lf");
            folder
        })
        .path()
}

/// `lenslet -q LINE` in a folder, not yet started; words are separated by blanks.
pub fn command(folder: &Path, line: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenslet"));
    command.arg("-q").args(line.split_whitespace()).current_dir(folder).env("RUST_BACKTRACE", "0");
    command
}

fn copy_tree(from: &Path, to: &Path) {
    if from.is_dir() {
        fs::create_dir_all(to).unwrap();
        for entry in fs::read_dir(from).unwrap() {
            let entry = entry.unwrap();
            copy_tree(&entry.path(), &to.join(entry.file_name()));
        }
    } else {
        fs::copy(from, to).unwrap();
    }
}

impl Bench {
    /// A folder that holds what [`stock`] has.
    pub fn new() -> Bench {
        let bench = Bench { folder: tempfile::tempdir().unwrap() };
        copy_tree(stock(), bench.folder.path());
        bench
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// A path in the folder.
    pub fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs `lenslet -q LINE`.
    pub fn run(&self, line: &str) -> Answer {
        command(self.path(), line).output().unwrap().into()
    }

    /// Runs it; it must end with exit code 0.
    pub fn done(&self, line: &str) -> Answer {
        let answer = self.run(line);
        assert_eq!(answer.code, Some(0), "{line}: {}", answer.err);
        answer
    }

    /// Runs it; it must end with exit code 1 and say why in one line that holds every one of `words`.
    pub fn refused(&self, line: &str, words: &[&str]) -> Answer {
        let answer = self.run(line);
        assert_eq!(answer.code, Some(1), "{line}: {}", answer.err);
        assert_eq!(answer.err.trim_end().lines().count(), 1, "{line}: {}", answer.err);
        for word in words {
            assert!(answer.err.contains(word), "{line} should say {word:?}: {}", answer.err);
        }
        answer
    }

    /// Writes a file, making the folders it lies in.
    pub fn put(&self, name: &str, bytes: impl AsRef<[u8]>) {
        let path = self.at(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }

    /// The bytes of a file.
    pub fn bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.at(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    /// Names in the folder that unfinished outputs have, at any depth.
    pub fn unfinished(&self) -> Vec<PathBuf> {
        fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
            for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
                if entry.file_name().as_encoded_bytes().starts_with(b".lenslet-") {
                    found.push(entry.path());
                }
                if entry.path().is_dir() {
                    walk(&entry.path(), found);
                }
            }
        }
        let mut found = Vec::new();
        walk(self.path(), &mut found);
        found
    }
}
