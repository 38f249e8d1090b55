//! Which captures to decode, and where each result goes.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use lenslet_core::container::{self, segments::Container};
use lenslet_core::lightfield::Format;

use crate::cli::Usage;
use crate::cli::written::{Written, ending};

/// Endings of files in a folder that may be captures.
const CAPTURES: [&str; 10] = ["lfp", "lfr", "raw", "png", "tif", "tiff", "jpg", "jpeg", "bmp", "pgm"];

/// Files that are left out, and what they are.
type LeftOut = Vec<(PathBuf, &'static str)>;

/// One capture and where its light field goes.
#[derive(Debug, Clone, PartialEq)]
pub struct Job {
    pub capture: PathBuf,
    pub out: PathBuf,
    pub format: Format,
}

/// What a call decodes.
#[derive(Debug, Clone, PartialEq)]
pub struct Jobs {
    pub jobs: Vec<Job>,
    /// Whether there may be several; then each goes into a folder of results.
    pub several: bool,
    /// Files among several that are no captures, and what they are.
    pub left_out: LeftOut,
}

/// The jobs of a call.
pub fn jobs(inputs: &[PathBuf], written: &Written) -> anyhow::Result<Jobs> {
    let several = inputs.len() > 1 || inputs.iter().any(|p| p.is_dir());
    if several {
        let (jobs, left_out) = each(inputs, &written.out, written.format_of_each())?;
        return Ok(Jobs { jobs, several, left_out });
    }
    let format = written.format()?;
    let job = |p: &PathBuf| Job { capture: p.clone(), out: written.out.clone(), format };
    Ok(Jobs { jobs: inputs.iter().map(job).collect(), several, left_out: Vec::new() })
}

/// What the files left out are, with their numbers.
pub fn reasons(left_out: &[(PathBuf, &'static str)]) -> String {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for (_, why) in left_out {
        *counts.entry(why).or_default() += 1;
    }
    counts.iter().map(|(why, n)| format!("{n} {why}")).collect::<Vec<_>>().join(", ")
}

/// What a file among captures is, where it is none: hidden, a processed file, a white image.
fn no_capture(path: &Path) -> Option<&'static str> {
    let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
    if name.starts_with('.') {
        return Some("hidden");
    }
    let stem = path.file_stem()?.to_string_lossy().to_ascii_lowercase();
    let white = stem.starts_with("white") || stem.starts_with("mod_");
    // One that cannot be opened is told as a failure.
    match Container::open(path).map(|c| container::locate_frame(&c)) {
        Err(_) if white => Some("white image"),
        Err(_) => None,
        Ok(Err(_)) if stem.ends_with("-stk") || stem.ends_with("-dm") => Some("processed"),
        Ok(Err(_)) => None,
        Ok(Ok(frame)) if frame.image.is_none() && frame.is_processed() => Some("processed"),
        Ok(Ok(frame)) if white || frame.facts.is_white == Some(true) => Some("white image"),
        Ok(Ok(frame)) if frame.facts.is_dark == Some(true) => Some("black image"),
        Ok(Ok(_)) => None,
    }
}

/// Several captures, each into the folder `out` under its own name.
fn each(inputs: &[PathBuf], out: &Path, format: Format) -> anyhow::Result<(Vec<Job>, LeftOut)> {
    let mut captures = Vec::new();
    for input in inputs {
        if input.is_dir() {
            captures.extend(folder(input)?);
        } else {
            captures.push(input.clone());
        }
    }
    let mut left_out = Vec::new();
    captures.retain(|capture| match no_capture(capture) {
        Some(why) => {
            left_out.push((capture.clone(), why));
            false
        }
        None => true,
    });
    if captures.is_empty() {
        anyhow::bail!("{}: no capture among these files ({})", inputs[0].display(), reasons(&left_out));
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
    Ok((jobs, left_out))
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
        let (found, _) = each(&["a/x.lfp".into(), "y.raw".into()], Path::new("out"), Format::Npy).unwrap();
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
        for name in ["b.LFP", "a.raw", "a.txt", "c.calib", "._b.LFP", "white-00.raw"] {
            std::fs::write(dir.path().join(name), b"").unwrap();
        }
        let (found, left_out) = each(&[dir.path().to_path_buf()], Path::new("out"), Format::Directory).unwrap();
        assert_eq!(reasons(&left_out), "1 hidden, 1 white image");
        let names: Vec<_> = found.iter().map(|j| j.capture.file_name().unwrap().to_owned()).collect();
        assert_eq!(names, ["a.raw", "b.LFP"]);
    }
}
