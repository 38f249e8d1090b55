//! Outputs under temporary names: unpredictable, created anew, locked while their run lives.
//!
//! The name has the machine and its boot, `.lenslet-tmp-HHHHHHHHBBBBBBBB-RRRRRRRRRRRRRRRR`. What stands under such a name
//! is removed by a later run only where it is certain that its run has ended: it is of the same machine, and nobody
//! holds its lock. Process numbers say nothing, as containers that share a folder have the same ones.

use std::fs::{self, File, OpenOptions};
use std::hash::{BuildHasher, Hasher};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use super::listing::{self, Journal, List};
use crate::digest::sha256_hex;

/// Start of every temporary name.
const MARK: &str = ".lenslet-tmp-";
/// Ending of the temporary name of a complete folder whose name another is about to take.
pub(super) const ASIDE: &str = ".old";
/// Names tried before giving up.
/// Source: chosen.
const TRIES: usize = 16;

/// Something being written under a temporary name.
#[derive(Debug)]
pub(super) struct Temporary {
    pub(super) path: PathBuf,
    /// The file, or the folder opened; locked.
    pub(super) handle: File,
    /// Of a folder.
    pub(super) journal: Option<Arc<Journal>>,
}

/// The machine and its boot, eight digits each; zeros where they are not known.
fn machine() -> &'static (String, String) {
    static MACHINE: OnceLock<(String, String)> = OnceLock::new();
    MACHINE.get_or_init(read_machine)
}

fn read_machine() -> (String, String) {
    let text = |path: &str| fs::read_to_string(path).map(|t| t.trim().to_string()).unwrap_or_default();
    let short = |text: &str| if text.is_empty() { "0".repeat(8) } else { sha256_hex(text.as_bytes())[..8].to_string() };
    let (id, boot) = (text("/etc/machine-id"), text("/proc/sys/kernel/random/boot_id"));
    let host = if id.is_empty() { id } else { id + &text("/proc/sys/kernel/hostname") };
    (short(&host), short(&boot))
}

/// A number that no one can foretell: the standard library keys each of these hashers with the system's randomness.
fn random_number() -> u64 {
    let mut hasher = std::hash::RandomState::new().build_hasher();
    hasher.write_u32(std::process::id());
    hasher.finish()
}

fn create(path: &Path, folder: bool, private: bool) -> io::Result<File> {
    #[cfg(unix)]
    use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
    if folder {
        let mut builder = fs::DirBuilder::new();
        #[cfg(unix)]
        builder.mode(if private { 0o700 } else { 0o777 });
        builder.create(path)?;
        return File::open(path);
    }
    let mut options = OpenOptions::new();
    #[cfg(unix)]
    options.mode(if private { 0o600 } else { 0o666 });
    options.read(true).write(true).create_new(true).open(path)
}

impl Temporary {
    /// Creates a file or a folder in `parent` and locks it. A private one is for its owner only.
    pub(super) fn new(parent: &Path, folder: bool, private: bool) -> io::Result<Temporary> {
        let (host, boot) = machine();
        for _ in 0..TRIES {
            let path = parent.join(format!("{MARK}{host}{boot}-{:016x}", random_number()));
            let handle = match create(&path, folder, private) {
                Ok(handle) => handle,
                // Another run took the name, or took the new folder for one that was left.
                Err(e) if matches!(e.kind(), io::ErrorKind::AlreadyExists) => continue,
                Err(e) if folder && e.kind() == io::ErrorKind::NotFound && parent.exists() => continue,
                Err(e) => return Err(e),
            };
            // Where there are no locks nothing is ever taken for left.
            let held = !matches!(handle.try_lock(), Err(fs::TryLockError::WouldBlock));
            let temporary = Temporary { path, handle, journal: None };
            if !held || !temporary.is_in_place() {
                continue;
            }
            let journal = if folder { Some(Arc::new(Journal::start(&temporary.path)?)) } else { None };
            return Ok(Temporary { journal, ..temporary });
        }
        Err(io::Error::new(io::ErrorKind::AlreadyExists, "no free temporary name was found"))
    }

    /// Whether the name still leads to what was created.
    pub(super) fn is_in_place(&self) -> bool {
        let named = fs::symlink_metadata(&self.path);
        let opened = self.handle.metadata();
        matches!((named, opened), (Ok(a), Ok(b)) if same_file(&a, &b))
    }

    /// Removes what was written.
    pub(super) fn discard(&self) {
        let _ = match &self.journal {
            Some(journal) => journal.discard(),
            None if self.is_in_place() => fs::remove_file(&self.path),
            None => Ok(()),
        };
    }
}

/// Whether two entries are the same file or folder.
#[cfg(unix)]
pub(super) fn same_file(a: &fs::Metadata, b: &fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

/// Not known on this system.
#[cfg(not(unix))]
pub(super) fn same_file(_: &fs::Metadata, _: &fs::Metadata) -> bool {
    true
}

/// Whether a name is a temporary one of a run of this machine: of this boot, or of an earlier one.
fn is_of_this_machine(name: &str) -> bool {
    let Some((ids, random)) = name.strip_prefix(MARK).and_then(|rest| rest.split_once('-')) else { return false };
    let random = random.strip_suffix(ASIDE).unwrap_or(random);
    let hexadecimal = |text: &str| text.len() == 16 && text.bytes().all(|b| b.is_ascii_hexdigit());
    if !hexadecimal(ids) || !hexadecimal(random) {
        return false;
    }
    let (host, boot) = machine();
    let zero = "0".repeat(8);
    (ids[8..] == *boot && *boot != zero) || (ids[..8] == *host && *host != zero)
}

/// Removes what runs of this machine that have ended left in a folder: files under temporary names, and of folders what
/// their journals or lists name. A complete folder whose name was about to be taken gets it back.
pub(super) fn sweep(parent: &Path) {
    let Ok(entries) = fs::read_dir(parent) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let Some(name) = name.to_str().filter(|n| is_of_this_machine(n)) else { continue };
        let path = entry.path();
        let Ok(meta) = path.symlink_metadata() else { continue };
        if !meta.is_dir() && !meta.is_file() {
            continue;
        }
        let Some(handle) = open_entry(&path) else { continue };
        if handle.try_lock().is_err() || !handle.metadata().is_ok_and(|m| same_file(&m, &meta)) {
            continue;
        }
        let _ = if meta.is_file() {
            fs::remove_file(&path)
        } else if name.ends_with(ASIDE) && restore(&path, parent).is_ok() {
            Ok(())
        } else {
            listing::remove_unfinished(&path)
        };
    }
}

fn open_entry(path: &Path) -> Option<File> {
    let mut options = OpenOptions::new();
    options.read(true);
    #[cfg(any(target_os = "linux", target_os = "macos"))]
    {
        use std::os::unix::fs::OpenOptionsExt;
        options.custom_flags((rustix::fs::OFlags::NOFOLLOW | rustix::fs::OFlags::NONBLOCK).bits() as i32);
    }
    options.open(path).ok()
}

/// Gives a folder that stepped aside its name back, where nothing stands there.
fn restore(aside: &Path, parent: &Path) -> io::Result<()> {
    let name = List::read(aside).and_then(|l| l.stepped_aside_from()).ok_or(io::ErrorKind::NotFound)?;
    super::rename::rename_new(aside, &parent.join(name))
}
