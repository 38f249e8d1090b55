//! A small world for tests that run the program many times: three captures, their calibration, photos, a light field.

#![allow(dead_code)] // every test file uses a part

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output};

use sha2::{Digest, Sha256};

/// Runs that a test starts at most to meet one in the middle of its work, which one or two do. A test that meets none
/// says so.
pub const ATTEMPTS: usize = 20;

/// The marker of unfinished outputs' names.
pub const MARK: &str = ".lenslet-tmp-";

/// A folder with `shots/` (three captures), `cam.calib`, `white.lfp`, `photos/`, `field.npy`, `small.lfd`, `train.json`.
pub struct World {
    /// Removed when dropped.
    pub folder: tempfile::TempDir,
}

impl World {
    /// Makes everything; half a second.
    pub fn new() -> World {
        let world = World { folder: tempfile::tempdir().unwrap() };
        let reference = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference");
        for (from, to) in [("golden-1.calib", "cam.calib"), ("golden-1.lfd", "small.lfd")] {
            fs::copy(reference.join(from), world.at(to)).unwrap();
        }
        fs::create_dir(world.at("shots")).unwrap();
        fs::create_dir(world.at("photos")).unwrap();
        for seed in ["1", "2", "3"] {
            let sim = world.at("sim");
            let done = world.run(&[
                "simulate", "--sensor", "160", "--size", "160", "--views", "1", "--whites", "1", "--seed", seed,
                "--out", "sim", "--force",
            ]);
            assert!(done.status.success(), "{}", said(&done));
            fs::rename(sim.join("capture.lfp"), world.at(&format!("shots/{seed}.lfp"))).unwrap();
            fs::rename(sim.join("white-00.lfp"), world.at("white.lfp")).unwrap();
            fs::rename(sim.join("truth/views/view_00_00.png"), world.at(&format!("photos/{seed}.png"))).unwrap();
        }
        fs::remove_dir_all(world.at("sim")).unwrap();
        let field = ndarray::Array5::from_shape_fn((2, 2, 50, 60, 3), |(v, u, t, s, c)| {
            0.5 + 0.3 * ((s + u) as f32 * 0.9).sin() * ((t + v) as f32 * 0.7).cos() + 0.05 * c as f32
        });
        ndarray_npy::write_npy(world.at("field.npy"), &field).unwrap();
        fs::write(
            world.at("train.json"),
            r#"{"atoms":24,"features":12,"patch":5,"window":5,"epochs":3,"refine":3,"pairs":3000,"batch":256,"crop":96,
                "crops":2,"shrink":1.0,"anchors":12,"neighbours":200,"held_out":3}"#,
        )
        .unwrap();
        world
    }

    /// A path in the folder.
    pub fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// `lenslet -q ARGUMENTS` in the folder, not yet started.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenslet"));
        command.arg("-q").args(arguments).current_dir(self.folder.path());
        command
    }

    /// Runs it.
    pub fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }
}

/// Sends a signal by name; whether the process was there to get it.
pub fn signal(child: &Child, name: &str) -> bool {
    let sent = Command::new("kill").arg(format!("-{name}")).arg(child.id().to_string()).output();
    sent.unwrap().status.success()
}

/// Waits until a process that was told to stop stands still; false when it ended before.
pub fn stands_still(child: &Child) -> bool {
    loop {
        let text = fs::read_to_string(format!("/proc/{}/stat", child.id())).unwrap_or_default();
        match text.rsplit_once(") ").and_then(|(_, rest)| rest.chars().next()) {
            Some('T') => return true,
            Some('Z' | 'X') | None => return false,
            Some(_) => std::thread::yield_now(),
        }
    }
}

/// How the files below a folder look from outside: names and lengths. Another look is another event.
pub fn look(folder: &Path) -> Vec<(PathBuf, u64)> {
    let mut out = Vec::new();
    let Ok(entries) = fs::read_dir(folder) else { return out };
    for entry in entries.flatten() {
        let path = entry.path();
        if path.is_dir() {
            out.extend(look(&path));
        } else {
            out.push((path, entry.metadata().map_or(0, |m| m.len())));
        }
    }
    out.sort();
    out
}

/// Watches a folder while a process runs: comes back after `events` changes of what is in it, or when the process has
/// ended; the number of changes seen.
pub fn watch(child: &mut Child, folder: &Path, events: usize) -> usize {
    let (mut seen, mut last) = (0, look(folder));
    while seen < events && child.try_wait().unwrap().is_none() {
        let now = look(folder);
        if now != last {
            (seen, last) = (seen + 1, now);
        } else {
            std::thread::sleep(std::time::Duration::from_micros(200));
        }
    }
    seen
}

/// What it wrote to stderr.
pub fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Every file below a path (or the file itself) with the hash of its bytes, by path relative to it.
pub fn hashes(path: &Path) -> BTreeMap<String, String> {
    fn walk(root: &Path, path: &Path, out: &mut BTreeMap<String, String>) {
        if path.is_dir() {
            for entry in fs::read_dir(path).unwrap() {
                walk(root, &entry.unwrap().path(), out);
            }
        } else if let Ok(bytes) = fs::read(path) {
            let name = path.strip_prefix(root).unwrap().display().to_string();
            let hash = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
            out.insert(name, hash);
        }
    }
    let mut out = BTreeMap::new();
    walk(path, path, &mut out);
    out
}

/// What a folder holds that has an unfinished output's name, at any depth.
pub fn unfinished(folder: &Path) -> Vec<PathBuf> {
    let mut out = Vec::new();
    let Ok(entries) = fs::read_dir(folder) else { return out };
    for entry in entries.flatten() {
        let path = entry.path();
        if entry.file_name().to_string_lossy().contains(MARK) {
            out.push(path);
        } else if path.is_dir() {
            out.extend(unfinished(&path));
        }
    }
    out
}
