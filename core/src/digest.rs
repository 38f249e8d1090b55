//! Digests of bytes as text.

use sha2::{Digest, Sha256};

/// sha256 of `bytes`, 64 hexadecimal digits in lower case.
///
/// ```
/// let empty = lenslet_core::digest::sha256_hex(b"");
/// assert!(empty.starts_with("e3b0c44298fc1c14") && empty.len() == 64);
/// ```
pub fn sha256_hex(bytes: &[u8]) -> String {
    format!("{:x}", Sha256::digest(bytes))
}
