//! Outputs that are whole or absent: everything is written under a temporary name and renamed when complete.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Part of every temporary name; what a killed run left behind is found by it.
const MARK: &str = ".lenslet-tmp-";
/// Ending of the temporary name of an output that is being replaced.
const ASIDE: &str = ".old";

/// A file or directory being written; dropped without [`Pending::commit`], it leaves nothing behind.
///
/// ```
/// use lenslet_core::output::{Error, Pending};
///
/// let folder = tempfile::tempdir()?;
/// let target = folder.path().join("result.txt");
/// let pending = Pending::file(&target, false)?;
/// std::fs::write(pending.path(), "whole")?;
/// assert!(!target.exists());
/// pending.commit()?;
/// assert_eq!(std::fs::read_to_string(&target)?, "whole");
/// assert!(matches!(Pending::file(&target, false), Err(Error::Exists(_))));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Pending {
    target: PathBuf,
    temporary: PathBuf,
    force: bool,
    done: bool,
}

/// Why an output cannot be put in place.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The target exists already.
    #[error("{} exists already; choose another name or add --force to replace it", .0.display())]
    Exists(PathBuf),
    /// The target has no file name.
    #[error("{} cannot be written: it has no file name", .0.display())]
    NoName(PathBuf),
    /// The system reported an error.
    #[error("cannot write {}: {source}", path.display())]
    Io {
        /// Which path.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

fn io_at(path: &Path) -> impl FnOnce(io::Error) -> Error + '_ {
    move |source| Error::Io { path: path.to_path_buf(), source }
}

fn remove(path: &Path) -> io::Result<()> {
    match fs::symlink_metadata(path) {
        Ok(m) if m.is_dir() => fs::remove_dir_all(path),
        Ok(_) => fs::remove_file(path),
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(e) => Err(e),
    }
}

impl Pending {
    fn new(target: &Path, force: bool) -> Result<Self, Error> {
        let name = target.file_name().ok_or_else(|| Error::NoName(target.to_path_buf()))?;
        let parent = match target.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        let mut prefix = std::ffi::OsString::from(".");
        prefix.push(name);
        prefix.push(MARK);
        sweep_leftovers(parent, &prefix, target);
        if !force && exists(target) {
            return Err(Error::Exists(target.to_path_buf()));
        }
        fs::create_dir_all(parent).map_err(io_at(parent))?;
        let mut temporary = prefix;
        temporary.push(std::process::id().to_string());
        let temporary = parent.join(temporary);
        Ok(Pending { target: target.to_path_buf(), temporary, force, done: false })
    }

    /// Prepares a file; the caller creates it at [`Pending::path`].
    ///
    /// # Errors
    /// When the target exists (and `force` is not set) or its folder cannot be made.
    pub fn file(target: &Path, force: bool) -> Result<Self, Error> {
        Self::new(target, force)
    }

    /// Prepares a directory and creates it under its temporary name.
    ///
    /// # Errors
    /// As [`Pending::file`].
    pub fn directory(target: &Path, force: bool) -> Result<Self, Error> {
        let pending = Self::new(target, force)?;
        fs::create_dir(&pending.temporary).map_err(io_at(&pending.temporary))?;
        Ok(pending)
    }

    /// Where to write now.
    pub fn path(&self) -> &Path {
        &self.temporary
    }

    /// Puts the complete output under its final name.
    ///
    /// # Errors
    /// When something was put at the target meanwhile, or the rename fails.
    pub fn commit(mut self) -> Result<(), Error> {
        let stands = exists(&self.target);
        if stands && !self.force {
            return Err(Error::Exists(self.target.clone()));
        }
        // A rename replaces a file at once, but never a directory.
        if !stands || !(is_directory(&self.target) || is_directory(&self.temporary)) {
            fs::rename(&self.temporary, &self.target).map_err(io_at(&self.target))?;
        } else if exchange_paths(&self.temporary, &self.target).is_err() {
            step_aside(&self.temporary, &self.target).map_err(io_at(&self.target))?;
        }
        self.done = true;
        // The output that was replaced, if there was one.
        remove(&self.temporary).map_err(io_at(&self.temporary))
    }
}

impl Drop for Pending {
    fn drop(&mut self) {
        if !self.done {
            let _ = remove(&self.temporary);
        }
    }
}

fn exists(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok()
}

fn is_directory(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|m| m.is_dir())
}

/// Exchanges two paths in one step, so that both exist at every moment.
#[cfg(any(target_os = "linux", target_os = "macos"))]
fn exchange_paths(a: &Path, b: &Path) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    Ok(renameat_with(CWD, a, CWD, b, RenameFlags::EXCHANGE)?)
}

/// Not available on this system.
#[cfg(not(any(target_os = "linux", target_os = "macos")))]
fn exchange_paths(_: &Path, _: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// As [`exchange_paths`], in two steps, for file systems without it. If a run is killed between them,
/// [`sweep_leftovers`] puts the old output back.
fn step_aside(temporary: &Path, target: &Path) -> io::Result<()> {
    let aside = aside_of(temporary);
    fs::rename(target, &aside)?;
    if let Err(e) = fs::rename(temporary, target) {
        fs::rename(&aside, target)?;
        return Err(e);
    }
    fs::rename(&aside, temporary)
}

fn aside_of(temporary: &Path) -> PathBuf {
    let mut aside = temporary.to_path_buf().into_os_string();
    aside.push(ASIDE);
    aside.into()
}

/// Removes what processes that have ended left beside the same target. An old output whose replacement was interrupted
/// by a kill gets its name back.
fn sweep_leftovers(parent: &Path, prefix: &std::ffi::OsStr, target: &Path) {
    let Ok(entries) = fs::read_dir(parent) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let bytes = name.as_encoded_bytes();
        let Some(rest) = bytes.strip_prefix(prefix.as_encoded_bytes()) else { continue };
        let digits: String = rest.iter().map_while(|b| b.is_ascii_digit().then_some(*b as char)).collect();
        // A file with this process's id is from an earlier process with the same id, as after every restart of a
        // container.
        let dead = digits.parse().is_ok_and(|pid: u32| pid == std::process::id() || !is_alive(pid));
        if !dead {
            continue;
        }
        let restored = rest.ends_with(ASIDE.as_bytes()) && !exists(target) && fs::rename(entry.path(), target).is_ok();
        if !restored {
            let _ = remove(&entry.path());
        }
    }
}

/// Whether a process with this id runs; always true on systems without /proc.
fn is_alive(pid: u32) -> bool {
    !Path::new("/proc/self").exists() || Path::new(&format!("/proc/{pid}")).exists()
}

/// Writes a whole file at once, under its final name only when complete.
///
/// # Errors
/// As [`Pending::file`] and [`Pending::commit`].
pub fn write_file(target: &Path, force: bool, bytes: &[u8]) -> Result<(), Error> {
    let pending = Pending::file(target, force)?;
    fs::write(pending.path(), bytes).map_err(io_at(target))?;
    pending.commit()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dropped_output_leaves_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("out");
        {
            let pending = Pending::directory(&target, false).unwrap();
            fs::write(pending.path().join("x"), b"1").unwrap();
        }
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    }

    #[test]
    fn existing_output_is_refused_or_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("out");
        write_file(&target, false, b"1").unwrap();
        assert!(matches!(write_file(&target, false, b"2"), Err(Error::Exists(_))));
        write_file(&target, true, b"2").unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"2");
        let pending = Pending::directory(&target, true).unwrap();
        pending.commit().unwrap();
        assert!(target.is_dir());
        let pending = Pending::directory(&target, true).unwrap();
        fs::write(pending.path().join("x"), b"1").unwrap();
        pending.commit().unwrap();
        assert!(target.join("x").exists());
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn leftovers_of_ended_runs_are_removed() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join(".out.lenslet-tmp-4294967294"), b"x").unwrap();
        fs::write(dir.path().join(format!(".out.lenslet-tmp-{}", std::process::id())), b"x").unwrap();
        write_file(&dir.path().join("out"), false, b"1").unwrap();
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    /// A directory with one file of these bytes.
    fn planted(path: &Path, bytes: &[u8]) {
        fs::create_dir(path).unwrap();
        fs::write(path.join("x"), bytes).unwrap();
    }

    #[test]
    fn an_old_output_moved_aside_by_a_killed_run_is_restored() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("out");
        let temporary = dir.path().join(".out.lenslet-tmp-4294967294");
        for force in [false, true] {
            // As between the two steps: the old output aside, the new one not yet there.
            let _ = remove(&target);
            planted(&temporary, b"new");
            planted(&aside_of(&temporary), b"old");
            match Pending::directory(&target, force) {
                Err(Error::Exists(_)) if !force => {}
                Ok(pending) if force => drop(pending),
                other => panic!("{other:?}"),
            }
            assert_eq!(fs::read(target.join("x")).unwrap(), b"old");
            assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
        }
        // With both there, the new one is complete.
        planted(&aside_of(&temporary), b"older");
        drop(Pending::directory(&target, true).unwrap());
        assert_eq!(fs::read(target.join("x")).unwrap(), b"old");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn stepping_aside_replaces_or_leaves_all_as_it_was() {
        let dir = tempfile::tempdir().unwrap();
        let [new, old] = ["new", "old"].map(|name| dir.path().join(name));
        planted(&new, b"new");
        planted(&old, b"old");
        step_aside(&new, &old).unwrap();
        assert_eq!(fs::read(old.join("x")).unwrap(), b"new");
        assert_eq!(fs::read(new.join("x")).unwrap(), b"old");
        assert!(step_aside(&dir.path().join("absent"), &old).is_err());
        assert_eq!(fs::read(old.join("x")).unwrap(), b"new");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_directory_exists_at_every_moment_of_its_replacement() {
        let dir = tempfile::tempdir().unwrap();
        let [target, other] = ["out", "other"].map(|name| dir.path().join(name));
        planted(&target, b"0");
        planted(&other, b"0");
        if let Err(e) = exchange_paths(&target, &other) {
            println!("skipped: this file system cannot exchange two names ({e})");
            return;
        }
        let done = std::sync::atomic::AtomicBool::new(false);
        std::thread::scope(|scope| {
            let watch = scope.spawn(|| {
                let mut looks = 0u32;
                while !done.load(std::sync::atomic::Ordering::Relaxed) {
                    assert!(exists(&target), "absent at look {looks}");
                    looks += 1;
                }
                looks
            });
            for n in 0..300u16 {
                let pending = Pending::directory(&target, true).unwrap();
                fs::write(pending.path().join("x"), n.to_le_bytes()).unwrap();
                pending.commit().unwrap();
            }
            done.store(true, std::sync::atomic::Ordering::Relaxed);
            assert!(watch.join().unwrap() > 0);
        });
        assert_eq!(fs::read(target.join("x")).unwrap(), 299u16.to_le_bytes());
    }
}
