//! Packed sensor images without a container (MOD_0001.RAW): metadata from the .txt or .json beside them, else from a
//! profile.

use std::path::Path;

use super::assemble::{assemble_capture, profile_for, unpack_image};
use super::capture::Capture;
use super::error::Error;
use super::file;
use super::metadata::FrameFacts;
use super::profile::CameraProfile;
use super::sidecar::read_sidecar;
use crate::digest::sha256_hex;

/// Longest raw file read: 32768 x 8192 pixels of 16 bit.
const MAX_FILE: u64 = 512 << 20;

/// Reads a packed raw file.
///
/// # Errors
/// When its packing or size is not known, or its length is not that of its pixels.
pub(super) fn capture_from_raw(path: &Path, profile: Option<&CameraProfile>) -> Result<Capture, Error> {
    let (_, length) = file::open(path)?;
    let mut warnings = Vec::new();
    let facts = read_sidecar(path, &mut warnings);
    let guessed = profile_for(facts.as_ref().unwrap_or(&FrameFacts::default()), length);
    if facts.is_none() && profile.is_none() && guessed.is_none() {
        let known: Vec<_> =
            CameraProfile::built_in().iter().filter_map(|p| Some(format!("{} {}", p.name, p.raw_bytes()?))).collect();
        let error = Error::not_recognised(
            path,
            format!(
                "not a capture: no container, no picture, no metadata (.txt, .json) beside it, and its {length} bytes fit no known camera's raw file ({})",
                known.join(", ")
            ),
        );
        return Err(error.after(&warnings));
    }
    if facts.is_none() {
        let name = profile.or(guessed).map_or("", |p| p.name.as_str());
        warnings.push(format!("no metadata (.txt, .json) beside the raw file: facts are those of {name}"));
    }
    let bytes = file::read(path, "a raw file", MAX_FILE)?;
    let profile = profile.or(guessed);
    let facts = facts.unwrap_or_default();
    let pixels = unpack_image(path, &facts, profile, &bytes, &mut warnings).map_err(|e| e.after(&warnings))?;
    Ok(assemble_capture(pixels, facts, profile, sha256_hex(&bytes), warnings))
}
