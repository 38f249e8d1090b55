//! Outputs that are whole or absent: everything is written under a temporary name and renamed when complete.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Marks temporary names; what a killed run left behind is found by it.
const MARK: &str = ".lenslet-tmp-";

/// A file or directory being written; dropped without [`Pending::commit`], it leaves nothing behind.
#[derive(Debug)]
pub struct Pending {
    target: PathBuf,
    temporary: PathBuf,
    force: bool,
    done: bool,
}

/// What goes wrong with outputs.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Something stands at the target already.
    #[error("{} exists already; choose another name or add --force to replace it", .0.display())]
    Exists(PathBuf),
    /// The target has no file name.
    #[error("{} cannot be written: it has no file name", .0.display())]
    NoName(PathBuf),
    /// The system refused.
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
        if !force && fs::symlink_metadata(target).is_ok() {
            return Err(Error::Exists(target.to_path_buf()));
        }
        let parent = match target.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        fs::create_dir_all(parent).map_err(io_at(parent))?;
        let mut prefix = std::ffi::OsString::from(".");
        prefix.push(name);
        prefix.push(MARK);
        sweep(parent, &prefix);
        let mut temporary = prefix;
        temporary.push(std::process::id().to_string());
        let temporary = parent.join(temporary);
        remove(&temporary).map_err(io_at(&temporary))?;
        Ok(Pending { target: target.to_path_buf(), temporary, force, done: false })
    }

    /// Prepares a file; it is the caller who creates [`Pending::path`].
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
    /// When something appeared at the target meanwhile, or the rename fails.
    pub fn commit(mut self) -> Result<(), Error> {
        let exists = fs::symlink_metadata(&self.target).is_ok();
        if exists && !self.force {
            return Err(Error::Exists(self.target.clone()));
        }
        let directory = |p: &Path| fs::symlink_metadata(p).is_ok_and(|m| m.is_dir());
        // A rename replaces a file at once, but never a directory: that one steps aside first.
        if exists && (directory(&self.target) || directory(&self.temporary)) {
            let mut aside = self.temporary.clone().into_os_string();
            aside.push(".old");
            let aside = PathBuf::from(aside);
            fs::rename(&self.target, &aside).map_err(io_at(&self.target))?;
            fs::rename(&self.temporary, &self.target).map_err(io_at(&self.target))?;
            self.done = true;
            remove(&aside).map_err(io_at(&aside))?;
        } else {
            fs::rename(&self.temporary, &self.target).map_err(io_at(&self.target))?;
            self.done = true;
        }
        Ok(())
    }
}

impl Drop for Pending {
    fn drop(&mut self) {
        if !self.done {
            let _ = remove(&self.temporary);
        }
    }
}

/// Removes what earlier runs, now dead, left for the same target.
fn sweep(parent: &Path, prefix: &std::ffi::OsStr) {
    let Ok(entries) = fs::read_dir(parent) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let bytes = name.as_encoded_bytes();
        let Some(rest) = bytes.strip_prefix(prefix.as_encoded_bytes()) else { continue };
        let digits: String = rest.iter().map_while(|b| b.is_ascii_digit().then_some(*b as char)).collect();
        if digits.parse().is_ok_and(|pid: u32| !alive(pid)) {
            let _ = remove(&entry.path());
        }
    }
}

/// Whether a process with this id runs. Without a /proc to ask, everything counts as alive and is left alone.
fn alive(pid: u32) -> bool {
    !Path::new("/proc/self").exists() || Path::new(&format!("/proc/{pid}")).exists()
}

/// Writes a whole file at once.
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
    fn leftovers_of_dead_runs_are_swept() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join(".out.lenslet-tmp-4294967294"), b"x").unwrap();
        write_file(&dir.path().join("out"), false, b"1").unwrap();
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }
}
