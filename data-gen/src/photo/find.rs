//! Photos in folders, by their names.

use std::path::{Path, PathBuf};

use lenslet_core::picture_file::{ENDINGS, UNREAD_ENDINGS};

use super::error::Error;

/// Folders within folders that are searched.
/// Source: chosen.
const MOST_DEPTH: usize = 16;

/// How the picture of a dictionary's atoms ends, which training writes beside it: no photo, though it may lie among them.
const ATOMS: &str = ".lfd.atoms.png";

/// Files as given, and the photos inside folders as given (sorted by name, subfolders too), pictures of a dictionary's atoms
/// left out.
///
/// # Errors
/// [`Error::Read`] for a path that does not exist, or a folder that cannot be listed.
pub fn find_photos(inputs: &[PathBuf]) -> Result<Vec<PathBuf>, Error> {
    let mut found = Vec::new();
    for input in inputs {
        let wrong = |reason| Error::Read { path: input.clone(), reason };
        if std::fs::metadata(input).map_err(wrong)?.is_dir() {
            collect_photos(input, 0, &mut found).map_err(wrong)?;
        } else {
            found.push(input.clone());
        }
    }
    Ok(found)
}

fn collect_photos(folder: &Path, depth: usize, found: &mut Vec<PathBuf>) -> std::io::Result<()> {
    let mut entries = std::fs::read_dir(folder)?.collect::<Result<Vec<_>, _>>()?;
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let path = entry.path();
        // Links are followed to files but not to folders, which might lead in a circle.
        if entry.file_type()?.is_dir() {
            if depth < MOST_DEPTH {
                collect_photos(&path, depth + 1, found)?;
            }
        } else {
            let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
            let of_atoms = entry.file_name().to_string_lossy().ends_with(ATOMS);
            if extension.is_some_and(|e| is_photo_ending(&e)) && !of_atoms && path.is_file() {
                found.push(path);
            }
        }
    }
    Ok(())
}

/// Endings that count as photos when a folder is searched. Those of formats that are not read count too, so that what
/// is left out of a folder is said.
fn is_photo_ending(ending: &str) -> bool {
    ENDINGS.contains(&ending) || UNREAD_ENDINGS.iter().any(|(unread, _)| *unread == ending)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_training_wrote_beside_its_photos_is_not_trained_on() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["b.png", "a.jpg", "own.lfd.atoms.png", "atoms.png", "own.lfd"] {
            std::fs::write(folder.path().join(name), b"").unwrap();
        }
        let found = find_photos(&[folder.path().to_path_buf()]).unwrap();
        let names: Vec<_> = found.iter().map(|p| p.file_name().unwrap().to_str().unwrap()).collect();
        assert_eq!(names, ["a.jpg", "atoms.png", "b.png"]);
        // Named by itself it is taken as given.
        let atoms = folder.path().join("own.lfd.atoms.png");
        assert_eq!(find_photos(std::slice::from_ref(&atoms)).unwrap(), [atoms]);
    }
}
