//! Metadata beside a raw file or a picture: a .txt or .json of the same name.

use std::path::Path;

use super::error::Error;
use super::metadata::{self, FrameFacts};
use super::{file, json};

/// The facts of the first .txt or .json beside `path` that states an image size or levels. The ending may be in
/// capitals. A file that cannot be read adds a warning.
pub(super) fn read_sidecar(path: &Path, warnings: &mut Vec<String>) -> Option<FrameFacts> {
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

fn read_metadata(path: &Path) -> Result<(FrameFacts, Vec<String>), Error> {
    let bytes = file::read(path, "metadata", json::MAX_DAMAGED as u64)?;
    let (value, mended) = json::parse_damaged(&bytes).map_err(|e| Error::malformed(path, e))?;
    let (facts, mut warnings) = metadata::read_frame(&value, None);
    warnings.extend(mended.map(|what| format!("{}: {what}", path.display())));
    Ok((facts, warnings))
}
