//! Which captures to decode, and where each result goes.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use crate::cli::Usage;

/// Endings of files in a folder that may be captures.
const CAPTURES: [&str; 9] = ["lfp", "lfr", "raw", "png", "tif", "tiff", "jpg", "jpeg", "pgm"];

/// One capture and where its light field goes.
#[derive(Debug, Clone, PartialEq)]
pub struct Job {
    pub capture: PathBuf,
    pub out: PathBuf,
}

/// The jobs of a call, and whether there may be several (then each goes into a folder of results).
pub fn jobs(inputs: &[PathBuf], out: &Path, ending: &str) -> anyhow::Result<(Vec<Job>, bool)> {
    let several = inputs.len() > 1 || inputs.iter().any(|p| p.is_dir());
    if !several {
        let jobs = inputs.iter().map(|p| Job { capture: p.clone(), out: out.to_path_buf() }).collect();
        return Ok((jobs, false));
    }
    let mut captures = Vec::new();
    for input in inputs {
        if input.is_dir() {
            captures.extend(folder(input)?);
        } else {
            captures.push(input.clone());
        }
    }
    let mut seen: HashMap<PathBuf, PathBuf> = HashMap::new();
    let mut jobs = Vec::new();
    for capture in captures {
        let Some(stem) = capture.file_stem() else {
            return Err(Usage(format!("{} has no file name", capture.display())).into());
        };
        let mut name = stem.to_os_string();
        name.push(ending);
        let target = out.join(name);
        if let Some(other) = seen.insert(target.clone(), capture.clone()) {
            let (a, b) = (other.display(), capture.display());
            return Err(
                Usage(format!("{a} and {b} would both become {}; decode them in two calls", target.display())).into()
            );
        }
        jobs.push(Job { capture, out: target });
    }
    Ok((jobs, true))
}

/// Files of a folder that may be captures, by name.
fn folder(path: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let failed = |e: std::io::Error| anyhow::anyhow!("{}: {e}", path.display());
    let mut found = Vec::new();
    for entry in std::fs::read_dir(path).map_err(failed)? {
        let file = entry.map_err(failed)?.path();
        let ending = file.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        if file.is_file() && ending.is_some_and(|e| CAPTURES.contains(&e.as_str())) {
            found.push(file);
        }
    }
    found.sort();
    if found.is_empty() {
        anyhow::bail!("{}: no capture in this folder (looked for .{})", path.display(), CAPTURES.join(", ."));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_file_goes_where_it_is_told() {
        let (found, several) = jobs(&["a/x.lfp".into()], Path::new("lf"), "").unwrap();
        assert_eq!((found[0].out.as_path(), several), (Path::new("lf"), false));
    }

    #[test]
    fn several_go_into_a_folder_by_stem_and_never_onto_each_other() {
        let (found, several) = jobs(&["a/x.lfp".into(), "y.raw".into()], Path::new("out"), ".npy").unwrap();
        assert!(several);
        assert_eq!(
            found.iter().map(|j| j.out.clone()).collect::<Vec<_>>(),
            [Path::new("out/x.npy"), Path::new("out/y.npy")]
        );
        assert!(jobs(&["a/x.lfp".into(), "b/x.lfp".into()], Path::new("out"), "").is_err());
    }

    #[test]
    fn a_folder_gives_its_captures_in_order() {
        let dir = tempfile::tempdir().unwrap();
        assert!(jobs(&[dir.path().to_path_buf()], Path::new("out"), "").is_err());
        for name in ["b.LFP", "a.raw", "a.txt", "c.calib"] {
            std::fs::write(dir.path().join(name), b"").unwrap();
        }
        let (found, several) = jobs(&[dir.path().to_path_buf()], Path::new("out"), "").unwrap();
        let names: Vec<_> = found.iter().map(|j| j.capture.file_name().unwrap().to_owned()).collect();
        assert!(several);
        assert_eq!(names, ["a.raw", "b.LFP"]);
    }
}
