//! Which captures to decode, and where each result goes.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use lenslet_core::lightfield::Format;

use crate::cli::Usage;
use crate::cli::written::{Written, ending};

/// Endings of files in a folder that may be captures.
const CAPTURES: [&str; 10] = ["lfp", "lfr", "raw", "png", "tif", "tiff", "jpg", "jpeg", "bmp", "pgm"];

/// One capture and where its light field goes.
#[derive(Debug, Clone, PartialEq)]
pub struct Job {
    pub capture: PathBuf,
    pub out: PathBuf,
    pub format: Format,
}

/// The jobs of a call, and whether there may be several (then each goes into a folder of results).
pub fn jobs(inputs: &[PathBuf], written: &Written) -> anyhow::Result<(Vec<Job>, bool)> {
    let several = inputs.len() > 1 || inputs.iter().any(|p| p.is_dir());
    if several {
        return Ok((each(inputs, &written.out, written.format_of_each())?, true));
    }
    let format = written.format()?;
    let job = |p: &PathBuf| Job { capture: p.clone(), out: written.out.clone(), format };
    Ok((inputs.iter().map(job).collect(), false))
}

/// Several captures, each into the folder `out` under its own name.
fn each(inputs: &[PathBuf], out: &Path, format: Format) -> anyhow::Result<Vec<Job>> {
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
        name.push(ending(format));
        let target = out.join(name);
        if let Some(other) = seen.insert(target.clone(), capture.clone()) {
            let (a, b) = (other.display(), capture.display());
            return Err(
                Usage(format!("{a} and {b} would both become {}; decode them in two calls", target.display())).into()
            );
        }
        jobs.push(Job { capture, out: target, format });
    }
    Ok(jobs)
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
    fn several_go_into_a_folder_by_stem_and_never_onto_each_other() {
        let found = each(&["a/x.lfp".into(), "y.raw".into()], Path::new("out"), Format::Npy).unwrap();
        assert_eq!(
            found.iter().map(|j| j.out.clone()).collect::<Vec<_>>(),
            [Path::new("out/x.npy"), Path::new("out/y.npy")]
        );
        assert!(each(&["a/x.lfp".into(), "b/x.lfp".into()], Path::new("out"), Format::Directory).is_err());
    }

    #[test]
    fn a_folder_gives_its_captures_in_order() {
        let dir = tempfile::tempdir().unwrap();
        assert!(each(&[dir.path().to_path_buf()], Path::new("out"), Format::Directory).is_err());
        for name in ["b.LFP", "a.raw", "a.txt", "c.calib"] {
            std::fs::write(dir.path().join(name), b"").unwrap();
        }
        let found = each(&[dir.path().to_path_buf()], Path::new("out"), Format::Directory).unwrap();
        let names: Vec<_> = found.iter().map(|j| j.capture.file_name().unwrap().to_owned()).collect();
        assert_eq!(names, ["a.raw", "b.LFP"]);
    }
}
