//! Names given and exchanged in one step.

use std::fs;
use std::io;
use std::path::Path;

fn exists(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok()
}

/// Renames, unless something stands at `to`.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`], and what the system reports.
pub(super) fn rename_new(from: &Path, to: &Path) -> io::Result<()> {
    match without_replacing(from, to) {
        Err(e) if is_unsupported(&e) => {}
        done => return done,
    }
    if exists(to) {
        return Err(io::ErrorKind::AlreadyExists.into());
    }
    if !from.is_dir() && fs::hard_link(from, to).is_ok() {
        return fs::remove_file(from);
    }
    // A folder takes no place but that of an empty one.
    fs::rename(from, to)
}

/// Whether the file system has no such operation.
pub(super) fn is_unsupported(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported)
}

#[cfg(any(target_os = "linux", target_os = "macos"))]
fn without_replacing(from: &Path, to: &Path) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    Ok(renameat_with(CWD, from, CWD, to, RenameFlags::NOREPLACE)?)
}

/// Exchanges two paths in one step, so that both exist at every moment.
#[cfg(any(target_os = "linux", target_os = "macos"))]
pub(super) fn exchange(a: &Path, b: &Path) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    Ok(renameat_with(CWD, a, CWD, b, RenameFlags::EXCHANGE)?)
}

/// Not available on this system.
#[cfg(not(any(target_os = "linux", target_os = "macos")))]
fn without_replacing(_: &Path, _: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Not available on this system.
#[cfg(not(any(target_os = "linux", target_os = "macos")))]
pub(super) fn exchange(_: &Path, _: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_replaced_by_a_new_name() {
        let dir = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|n| dir.path().join(n));
        fs::write(&a, "a").unwrap();
        fs::write(&b, "b").unwrap();
        assert_eq!(rename_new(&a, &b).unwrap_err().kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(fs::read(&b).unwrap(), b"b");
        fs::remove_file(&b).unwrap();
        rename_new(&a, &b).unwrap();
        assert!(!a.exists() && b.exists());
    }
}
