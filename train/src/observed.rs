//! Progress of learning, counted in pairs.

use lenslet_core::progress::Observer;

use crate::error::Error;

/// Counts `n` pairs as done.
///
/// # Errors
/// Interruption.
pub fn advance(observer: &dyn Observer, n: usize) -> Result<(), Error> {
    observer.advance(n as u64);
    Ok(observer.check()?)
}
