//! Reads of untrusted files: regular files only, bounded in size.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::Path;

use super::error::Error;
use crate::input::open_regular;

/// Opens a regular file (never a pipe or device, which may have no end); returns it and its length in bytes.
pub(super) fn open(path: &Path) -> Result<(File, u64), Error> {
    open_regular(path).map_err(|e| match e.kind() {
        ErrorKind::IsADirectory | ErrorKind::InvalidInput => Error::not_recognised(path, e.to_string()),
        _ => Error::io(path)(e),
    })
}

/// Reads the whole file, `what` in messages; longer than `limit` bytes is an error.
pub(super) fn read(path: &Path, what: &str, limit: u64) -> Result<Vec<u8>, Error> {
    let (file, length) = open(path)?;
    let mut bytes = Vec::with_capacity(length.min(limit) as usize);
    file.take(limit + 1).read_to_end(&mut bytes).map_err(Error::io(path))?;
    if bytes.len() as u64 > limit {
        let value = length.max(bytes.len() as u64);
        return Err(Error::Limit { path: path.into(), what: format!("the length in bytes of {what}"), value, limit });
    }
    Ok(bytes)
}

/// The first bytes of a file, at most `n`.
pub(super) fn head(path: &Path, n: u64) -> Result<Vec<u8>, Error> {
    let (file, _) = open(path)?;
    let mut bytes = Vec::new();
    file.take(n).read_to_end(&mut bytes).map_err(Error::io(path))?;
    Ok(bytes)
}
