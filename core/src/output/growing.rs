//! Folders that grow from run to run, as an ablation's: one run at a time, and only what lenslet wrote is replaced.

use std::fs::{self, File};
use std::io::Write;
use std::path::Path;

use super::error::{Error, io_at};
use super::listing::{LIST, List, Stamp};
use super::temporary::{Temporary, sweep};

/// Locks a folder for this run until the file that is returned is closed.
///
/// # Errors
/// [`Error::Busy`] while another run has it; what the system reports when it cannot be opened.
pub fn lock_folder(folder: &Path) -> Result<File, Error> {
    let handle = File::open(folder).map_err(io_at(folder))?;
    match handle.try_lock() {
        Err(fs::TryLockError::WouldBlock) => Err(Error::Busy(folder.to_path_buf())),
        // Some network file systems have no locks.
        _ => {
            sweep(folder);
            Ok(handle)
        }
    }
}

/// Whether the list of a folder names a file, whatever the file holds by now.
#[must_use]
pub fn is_listed(folder: &Path, name: &str) -> bool {
    List::read(folder).is_some_and(|list| list.names(name))
}

/// Whether [`replace_listed`] may write there, before the work for it.
///
/// # Errors
/// [`Error::Kept`].
pub fn check_listed(folder: &Path, name: &str) -> Result<(), Error> {
    check_in(&List::read(folder).unwrap_or_else(List::empty), folder, name)
}

fn check_in(list: &List, folder: &Path, name: &str) -> Result<(), Error> {
    if list.owns(folder, name) {
        return Ok(());
    }
    let why = "lenslet did not write it, or it was changed since".into();
    Err(Error::Kept { path: folder.join(name), why })
}

/// Writes the file `name` (parts separated by `/`) of a folder that this run has locked, and notes it in the folder's
/// list. What stands there is replaced when it is on the list as it is.
///
/// # Errors
/// [`Error::Kept`] when something else stands there; what the system reports.
///
/// ```
/// use lenslet_core::output::replace_listed;
///
/// let folder = tempfile::tempdir()?;
/// replace_listed(folder.path(), "table.csv", b"1,2")?;
/// replace_listed(folder.path(), "table.csv", b"1,3")?;
/// std::fs::write(folder.path().join("table.csv"), "mine")?;
/// assert!(replace_listed(folder.path(), "table.csv", b"1,4").is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn replace_listed(folder: &Path, name: &str, bytes: &[u8]) -> Result<(), Error> {
    let target = folder.join(name);
    let found = List::read(folder);
    let is_foreign = found.is_none() && folder.join(LIST).symlink_metadata().is_ok();
    let mut list = found.unwrap_or_else(List::empty);
    check_in(&list, folder, name)?;
    // Noted first: a run that is killed between the two leaves a file that is one of those expected.
    list.expect(name, Stamp::of(bytes));
    if is_foreign {
        return Err(Error::Kept { path: folder.join(LIST), why: "lenslet did not write it".into() });
    }
    put(folder, LIST, &list.to_bytes().map_err(io_at(&target))?)?;
    if let Some(parent) = target.parent() {
        fs::create_dir_all(parent).map_err(io_at(parent))?;
    }
    put(folder, name, bytes)
}

/// Writes a file whole, over what stands there.
fn put(folder: &Path, name: &str, bytes: &[u8]) -> Result<(), Error> {
    let target = folder.join(name);
    let mut temporary = Temporary::new(folder, false, false).map_err(io_at(&target))?;
    let done = temporary.handle.write_all(bytes).and_then(|()| fs::rename(&temporary.path, &target));
    done.map_err(|source| {
        temporary.discard();
        Error::Io { path: target, source }
    })
}
