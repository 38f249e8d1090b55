//! Readers that take a path get their bytes through a file in memory.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Writes `bytes` to this process's own file and gives its path; `extension` without the dot.
pub fn put(bytes: &[u8], extension: &str) -> PathBuf {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let shm = Path::new("/dev/shm");
        let made = if shm.is_dir() { tempfile::tempdir_in(shm) } else { tempfile::tempdir() };
        made.expect("a temporary folder")
    });
    let path = folder.path().join("input").with_extension(extension);
    std::fs::write(&path, bytes).expect("writing the input");
    path
}
