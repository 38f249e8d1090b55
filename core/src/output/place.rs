//! Whether an output may stand where it is asked for: what is there already, and what it holds.

use std::fs;
use std::path::Path;

use super::error::Error;
use super::listing::{List, device_of};
use super::marks;
use super::temporary::same_file;

/// What is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// One file.
    File,
    /// A folder of files.
    Directory,
}

/// What lenslet wrote, and stands at a target.
#[derive(Debug)]
pub(super) enum Own {
    File,
    Directory(List),
    /// A folder without anything in it, whoever made it.
    Empty,
}

/// What stands at a target (something does), where an output of this kind may replace it; else why not. `quick` compares
/// lengths only.
pub(super) fn own(target: &Path, kind: Kind, quick: bool) -> Result<Own, String> {
    let unread = |e: std::io::Error| format!("it cannot be looked into ({e})");
    let meta = fs::symlink_metadata(target).map_err(unread)?;
    if meta.is_symlink() {
        return Err("it is a link, and lenslet makes none".into());
    }
    match kind {
        Kind::File if meta.is_dir() => return Err("it is a folder, where a file is to be written".into()),
        Kind::Directory if meta.is_file() => return Err("it is a file, where a folder is to be written".into()),
        _ if !meta.is_file() && !meta.is_dir() => return Err("it is not a regular file".into()),
        _ => {}
    }
    if is_mounted(target, &meta) {
        return Err("a disk is mounted there".into());
    }
    if kind == Kind::File {
        return if marks::is_own_file(target) { Ok(Own::File) } else { Err("lenslet did not write it".into()) };
    }
    if fs::read_dir(target).map_err(unread)?.next().is_none() {
        return Ok(Own::Empty);
    }
    let list = List::read(target).ok_or("lenslet did not write it")?;
    match list.contradiction(target, quick).map_err(unread)? {
        None => Ok(Own::Directory(list)),
        Some(why) => Err(why),
    }
}

/// Whether a file system is mounted at a path or below it.
fn is_mounted(target: &Path, meta: &fs::Metadata) -> bool {
    let parent = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if fs::metadata(parent).is_ok_and(|p| device_of(&p) != device_of(meta)) {
        return true;
    }
    // A mount of the same file system is on the list only.
    let (Ok(place), Ok(list)) = (target.canonicalize(), fs::read_to_string("/proc/self/mountinfo")) else {
        return false;
    };
    list.lines().filter_map(|line| line.split(' ').nth(4)).any(|point| Path::new(&unescape(point)).starts_with(&place))
}

/// A path of mountinfo, where blanks and the like are three octal digits.
fn unescape(text: &str) -> String {
    let mut out = text.to_string();
    for (code, character) in [("\\040", " "), ("\\011", "\t"), ("\\012", "\n"), ("\\134", "\\")] {
        out = out.replace(code, character);
    }
    out
}

/// Why nothing is written: what stands at the target, with the advice that fits.
pub(super) fn refusal(target: &Path, kind: Kind) -> Error {
    match own(target, kind, true) {
        Ok(_) => Error::Exists(target.to_path_buf()),
        Err(why) => Error::Kept { path: target.to_path_buf(), why },
    }
}

/// Refuses a target before the work rather than after it: one at which something stands, unless it is lenslet's own and
/// `force` is set; and always one that is or holds one of the inputs, by path, through links, or as the same file under
/// another name.
///
/// # Errors
/// [`Error::Exists`], [`Error::Kept`].
///
/// ```
/// use lenslet_core::output::{Error, Kind, check_target};
///
/// let folder = tempfile::tempdir()?;
/// let notes = folder.path().join("notes");
/// assert!(check_target(&notes, Kind::File, false, &[]).is_ok());
/// std::fs::write(&notes, "mine")?;
/// assert!(matches!(check_target(&notes, Kind::File, true, &[]), Err(Error::Kept { .. })));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn check_target(target: &Path, kind: Kind, force: bool, inputs: &[&Path]) -> Result<(), Error> {
    if fs::symlink_metadata(target).is_err() {
        return Ok(());
    }
    if let Some(why) = inputs.iter().find_map(|input| holds(target, input)) {
        return Err(Error::Kept { path: target.to_path_buf(), why });
    }
    if !force {
        return Err(refusal(target, kind));
    }
    own(target, kind, false).map(|_| ()).map_err(|why| Error::Kept { path: target.to_path_buf(), why })
}

/// That a target is an input or holds it, as a message has it.
fn holds(target: &Path, input: &Path) -> Option<String> {
    let (there, place) = (fs::metadata(target).ok()?, input.canonicalize().ok()?);
    let at = |path: &Path| {
        fs::metadata(path).is_ok_and(|m| same_entry(&m, &there)) || target.canonicalize().is_ok_and(|t| t == path)
    };
    place.ancestors().find(|a| at(a)).map(|a| {
        if a == place { "it is an input".to_string() } else { format!("it holds the input {}", input.display()) }
    })
}

#[cfg(unix)]
fn same_entry(a: &fs::Metadata, b: &fs::Metadata) -> bool {
    same_file(a, b)
}

/// Paths alone are compared on this system.
#[cfg(not(unix))]
fn same_entry(_: &fs::Metadata, _: &fs::Metadata) -> bool {
    let _ = same_file;
    false
}
