//! An output on its way: begun under a temporary name, put in place when it is complete.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use super::error::{Error, io_at};
use super::listing::{Journal, List};
use super::marks;
use super::place::{self, Kind, Own};
use super::rename::{exchange, is_unsupported, rename_new};
use super::temporary::{ASIDE, Temporary, sweep};

/// Files of at most so many bytes are flushed to the disk before they get their name.
/// Source: chosen; a second on a slow disk.
const SYNCED: u64 = 64 << 20;
/// How often the name is tried for while other runs put theirs there.
/// Source: chosen.
const TRIES: usize = 16;

/// Folders that this process is writing: what is created inside is part of them.
static ACTIVE: Mutex<Vec<Arc<Journal>>> = Mutex::new(Vec::new());

fn active() -> std::sync::MutexGuard<'static, Vec<Arc<Journal>>> {
    ACTIVE.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn journal_of(path: &Path) -> Option<Arc<Journal>> {
    active().iter().find(|j| path.starts_with(j.root()) && path != j.root()).cloned()
}

/// A file or directory being written; dropped without [`Pending::commit`], it leaves nothing behind.
///
/// ```
/// use lenslet_core::output::{Error, Pending};
///
/// let folder = tempfile::tempdir()?;
/// let target = folder.path().join("page.html");
/// let pending = Pending::file(&target, false)?;
/// pending.write(b"<!DOCTYPE html>\n<title>whole</title>\n")?;
/// assert!(!target.exists());
/// pending.commit()?;
/// assert!(std::fs::read_to_string(&target)?.contains("whole"));
/// assert!(matches!(Pending::file(&target, false), Err(Error::Exists(_))));
/// assert!(Pending::file(&target, true).is_ok()); // it is lenslet's own
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Pending {
    target: PathBuf,
    kind: Kind,
    place: Place,
    force: bool,
    done: bool,
}

/// Where it is written.
#[derive(Debug)]
enum Place {
    Temporary(Temporary),
    /// Under its own name, as part of a folder that is pending itself.
    Inside(Option<File>),
}

impl Pending {
    fn new(target: &Path, force: bool, kind: Kind) -> Result<Self, Error> {
        target.file_name().ok_or_else(|| Error::NoName(target.to_path_buf()))?;
        let begun = |place| Pending { target: target.to_path_buf(), kind, place, force, done: false };
        if let Some(journal) = journal_of(target) {
            let file = match kind {
                Kind::File => Some(create_part(target).map_err(io_at(target))?),
                Kind::Directory => {
                    journal.add(target, true).and_then(|()| fs::create_dir_all(target)).map_err(io_at(target))?;
                    None
                }
            };
            return Ok(begun(Place::Inside(file)));
        }
        let parent = match target.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        sweep(parent);
        let old = fs::symlink_metadata(target).ok();
        if old.is_some() {
            place::check_target(target, kind, force, &[])?;
        }
        fs::create_dir_all(parent).map_err(io_at(parent))?;
        let folder = kind == Kind::Directory;
        let temporary = Temporary::new(parent, folder, old.is_some()).map_err(io_at(target))?;
        active().extend(temporary.journal.clone());
        Ok(begun(Place::Temporary(temporary)))
    }

    /// Begins a file.
    ///
    /// # Errors
    /// When something stands at the target (unless it is lenslet's own and `force` is set), or its folder cannot be
    /// written.
    pub fn file(target: &Path, force: bool) -> Result<Self, Error> {
        Self::new(target, force, Kind::File)
    }

    /// Begins a directory.
    ///
    /// # Errors
    /// As [`Pending::file`].
    pub fn directory(target: &Path, force: bool) -> Result<Self, Error> {
        Self::new(target, force, Kind::Directory)
    }

    /// Where it is now; files inside a directory are made by [`create_part`] and [`write_part`].
    pub fn path(&self) -> &Path {
        match &self.place {
            Place::Temporary(temporary) => &temporary.path,
            Place::Inside(_) => &self.target,
        }
    }

    /// The open file, for one more writer.
    ///
    /// # Errors
    /// When this is a directory, or the system has no more handles.
    pub fn handle(&self) -> Result<File, Error> {
        let file = match (&self.place, self.kind) {
            (Place::Temporary(temporary), Kind::File) => temporary.handle.try_clone(),
            (Place::Inside(Some(file)), _) => file.try_clone(),
            _ => Err(io::ErrorKind::IsADirectory.into()),
        };
        file.map_err(io_at(&self.target))
    }

    /// Writes the whole file, with the mark by which lenslet recognises it in formats that are marked by a comment.
    ///
    /// # Errors
    /// What the system reports.
    pub fn write(&self, bytes: &[u8]) -> Result<(), Error> {
        let mut file = self.handle()?;
        let written = match &self.place {
            Place::Temporary(_) => file.write_all(&marks::seal(bytes)),
            // The list of the folder has it.
            Place::Inside(_) => file.write_all(bytes),
        };
        written.map_err(io_at(&self.target))
    }

    /// Puts the complete output under its final name.
    ///
    /// # Errors
    /// When something else stands at the target by now, when what was written is no longer whole, or the system fails.
    pub fn commit(mut self) -> Result<(), Error> {
        if let Place::Temporary(temporary) = &self.place {
            complete(temporary).map_err(io_at(&self.target))?;
            self.put_in_place(temporary)?;
        }
        self.done = true;
        Ok(())
    }

    fn put_in_place(&self, temporary: &Temporary) -> Result<(), Error> {
        let (from, target) = (&temporary.path, &self.target);
        for _ in 0..TRIES {
            match rename_new(from, target) {
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
                done => return done.map_err(io_at(target)),
            }
            if !self.force {
                return Err(place::refusal(target, self.kind));
            }
            let kept = |why| Error::Kept { path: target.clone(), why };
            match place::own(target, self.kind, false) {
                Ok(_) => {}
                // Another run has just moved it away.
                Err(_) if fs::symlink_metadata(target).is_err() => continue,
                Err(why) => return Err(kept(why)),
            }
            if let Ok(old) = fs::symlink_metadata(target) {
                fs::set_permissions(from, old.permissions()).map_err(io_at(target))?;
            }
            match exchange(from, target) {
                Ok(()) => {}
                Err(e) if e.kind() == io::ErrorKind::NotFound => continue,
                Err(e) if is_unsupported(&e) => match self.kind {
                    Kind::File => return fs::rename(from, target).map_err(io_at(target)),
                    Kind::Directory => step_aside(from, target).map_err(io_at(target))?,
                },
                Err(e) => return Err(io_at(target)(e)),
            }
            // What was replaced is looked at once more, now that nobody writes there.
            return match place::own(from, self.kind, false) {
                Ok(Own::File) => fs::remove_file(from).map_err(io_at(from)),
                Ok(Own::Empty) => fs::remove_dir(from).map_err(io_at(from)),
                Ok(Own::Directory(list)) => list.remove(from).map_err(io_at(from)),
                Err(why) => {
                    exchange(from, target).map_err(io_at(target))?;
                    Err(kept(why))
                }
            };
        }
        Err(Error::Busy(target.clone()))
    }
}

/// Closes what was written: whole, in its place, on the disk.
fn complete(temporary: &Temporary) -> io::Result<()> {
    if !temporary.is_in_place() {
        return Err(io::Error::other("the unfinished output was moved or removed by another program"));
    }
    match &temporary.journal {
        Some(journal) => journal.close(),
        None if temporary.handle.metadata()?.len() <= SYNCED => temporary.handle.sync_all(),
        None => Ok(()),
    }
}

/// Exchanges two folders in two steps, for file systems that cannot do it in one. If a run is killed between them, the
/// next one gives the old folder its name back.
fn step_aside(new: &Path, target: &Path) -> io::Result<()> {
    let mut aside = new.to_path_buf().into_os_string();
    aside.push(ASIDE);
    let aside = PathBuf::from(aside);
    if let (Some(mut list), Some(name)) = (List::read(target), target.file_name().and_then(|n| n.to_str())) {
        list.step_aside_from(name);
        let path = target.join(super::LIST);
        fs::write(&path, list.to_bytes()?)?;
    }
    rename_new(target, &aside)?;
    if let Err(e) = rename_new(new, target) {
        rename_new(&aside, target)?;
        return Err(e);
    }
    rename_new(&aside, new)
}

impl Drop for Pending {
    fn drop(&mut self) {
        match &self.place {
            Place::Temporary(temporary) => {
                if let Some(journal) = &temporary.journal {
                    active().retain(|j| !Arc::ptr_eq(j, journal));
                }
                if !self.done {
                    temporary.discard();
                }
            }
            Place::Inside(Some(_)) if !self.done => {
                let _ = fs::remove_file(&self.target);
            }
            Place::Inside(_) => {}
        }
    }
}

/// Creates a file that is part of a pending directory, and the folders it lies in. Nothing that stands there is opened.
///
/// # Errors
/// What the system reports, [`io::ErrorKind::AlreadyExists`] among it.
pub fn create_part(path: &Path) -> io::Result<File> {
    if let Some(journal) = journal_of(path) {
        journal.add(path, false)?;
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent)?;
        }
    }
    OpenOptions::new().read(true).write(true).create_new(true).open(path)
}

/// [`create_part`], with these bytes.
///
/// # Errors
/// As [`create_part`].
pub fn write_part(path: &Path, bytes: &[u8]) -> io::Result<()> {
    create_part(path)?.write_all(bytes)
}

/// Writes at a place of a file, wherever other writers of it are.
///
/// # Errors
/// What the system reports.
pub fn write_at(file: &File, bytes: &[u8], offset: u64) -> io::Result<()> {
    #[cfg(unix)]
    return std::os::unix::fs::FileExt::write_all_at(file, bytes, offset);
    #[cfg(not(unix))]
    {
        use std::io::{Seek, SeekFrom};
        let mut file = file;
        file.seek(SeekFrom::Start(offset))?;
        file.write_all(bytes)
    }
}

/// Writes a whole file at once, under its final name only when complete; see [`Pending::write`].
///
/// # Errors
/// As [`Pending::file`] and [`Pending::commit`].
pub fn write_file(target: &Path, force: bool, bytes: &[u8]) -> Result<(), Error> {
    let pending = Pending::file(target, force)?;
    pending.write(bytes)?;
    pending.commit()
}

#[cfg(test)]
mod tests;
