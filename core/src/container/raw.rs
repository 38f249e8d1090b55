//! Packed sensor images without a container (MOD_0001.RAW): metadata from the .txt or .json beside, else from a profile.

use std::path::Path;

use super::capture::{assemble, profile_for, sha256_of};
use super::metadata::{self, Frame};
use super::profile::{self, Profile};
use super::{Capture, Error, file, json, lfp};

/// Longest raw file read: 32768 x 8192 pixels of 16 bit.
const MAX_FILE: u64 = 512 << 20;

/// Reads a raw file.
pub(super) fn capture(path: &Path, profile: Option<&Profile>) -> Result<Capture, Error> {
    let (_, length) = file::open(path)?;
    let mut warnings = Vec::new();
    let facts = sidecar(path, &mut warnings);
    let guessed = profile_for(facts.as_ref().unwrap_or(&Frame::default()), length);
    if facts.is_none() && profile.is_none() && guessed.is_none() {
        let known: Vec<_> =
            profile::profiles().iter().filter_map(|p| Some(format!("{} {}", p.name, p.raw_bytes()?))).collect();
        return Err(Error::not_recognised(
            path,
            format!(
                "not a capture: no container, no picture, no metadata (.txt, .json) beside it, and its {length} bytes fit no known camera's raw file ({})",
                known.join(", ")
            ),
        ));
    }
    if facts.is_none() {
        let name = profile.or(guessed.as_ref()).map_or("", |p| p.name.as_str());
        warnings.push(format!("no metadata (.txt, .json) beside the raw file: facts are those of {name}"));
    }
    let bytes = file::read(path, "a raw file", MAX_FILE)?;
    from_bytes(path, &bytes, facts.unwrap_or_default(), profile.or(guessed.as_ref()), warnings)
}

/// A capture from packed bytes and their facts.
pub(super) fn from_bytes(
    path: &Path,
    bytes: &[u8],
    facts: Frame,
    profile: Option<&Profile>,
    mut warnings: Vec<String>,
) -> Result<Capture, Error> {
    let pixels = lfp::pixels(path, &facts, profile, bytes, &mut warnings)?;
    Ok(assemble(pixels, facts, profile, sha256_of(bytes), warnings))
}

/// Metadata in the .txt or .json that shares the file's name (in either case).
pub(super) fn sidecar(path: &Path, warnings: &mut Vec<String>) -> Option<Frame> {
    for extension in ["txt", "TXT", "json", "JSON"] {
        let beside = path.with_extension(extension);
        if beside == path || !beside.is_file() {
            continue;
        }
        match read_metadata(&beside) {
            Ok((frame, more)) if frame.size.is_some() || frame.levels.is_some() => {
                warnings.extend(more);
                return Some(frame);
            }
            Ok(_) => {}
            Err(e) => warnings.push(format!("ignored: {e}")),
        }
    }
    None
}

fn read_metadata(path: &Path) -> Result<(Frame, Vec<String>), Error> {
    let bytes = file::read(path, "metadata", json::MAX_TEXT as u64)?;
    let value = json::parse(&bytes).map_err(|e| Error::malformed(path, e))?;
    Ok(metadata::frame(&value, None))
}
