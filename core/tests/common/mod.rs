//! Seeded damage for files: the same seed gives the same damage on every machine.

#![allow(dead_code)] // every test file uses a part

pub mod files;

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

/// Numbers that break arithmetic.
const BAD: [u64; 10] = [0, 1, 0x7f, 0xff, 0x7fff, 0xffff, 0x7fff_ffff, 0xffff_ffff, 0x7fff_ffff_ffff_ffff, u64::MAX];
/// Words that break parsers.
const WORDS: [&str; 14] = [
    "NaN",
    "-1",
    "1e999",
    "9223372036854775808",
    "null",
    "[[[[[[[[",
    "{\"a\":",
    "\"",
    "\\u0000",
    "0.0",
    "..",
    "\0",
    "4294967296",
    "inf",
];

/// `bytes` with one to six kinds of damage, mostly near the start, where headers are.
pub fn damaged(bytes: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for _ in 0..rng.random_range(1..=6) {
        if out.is_empty() {
            break;
        }
        let reach = if rng.random_bool(0.6) { out.len().min(1024) } else { out.len() };
        let at = rng.random_range(0..reach);
        match rng.random_range(0..9) {
            0 => out[at] ^= 1 << rng.random_range(0..8),
            1 => out[at] = rng.random(),
            2 => {
                let bad = BAD[rng.random_range(0..BAD.len())];
                let width = [1, 2, 4, 8][rng.random_range(0..4)];
                let number =
                    if rng.random() { bad.to_le_bytes() } else { bad.rotate_right(8 * width as u32).to_be_bytes() };
                for (o, n) in out[at..].iter_mut().zip(&number[..width]) {
                    *o = *n;
                }
            }
            3 => {
                let n = rng.random_range(1..=64.min(out.len() - at));
                out.drain(at..at + n);
            }
            4 => {
                let n = rng.random_range(1..=64.min(out.len() - at));
                let piece = out[at..at + n].to_vec();
                let to = rng.random_range(0..=out.len());
                out.splice(to..to, piece);
            }
            5 => {
                let word = WORDS[rng.random_range(0..WORDS.len())].bytes();
                let end = (at + rng.random_range(0..8)).min(out.len());
                out.splice(at..end, word);
            }
            // A digit, wherever there is one.
            6 | 7 => {
                let digit = out[at..].iter().position(u8::is_ascii_digit).map(|k| at + k);
                if let Some(k) = digit {
                    let many = rng.random_bool(0.2);
                    let with: Vec<u8> = if many {
                        b"9".repeat(rng.random_range(1..25))
                    } else {
                        vec![b'0' + rng.random_range(0..10u8)]
                    };
                    out.splice(k..=k, with);
                }
            }
            _ => out.truncate(at),
        }
    }
    out
}

/// Feeds `read` the file cut off at every length, then `count` damaged versions of it.
pub fn torment(bytes: &[u8], seed: u64, count: usize, mut read: impl FnMut(&[u8])) {
    let step = (bytes.len() / 20_000).max(1);
    for n in (0..bytes.len()).step_by(step) {
        read(&bytes[..n]);
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    for _ in 0..count {
        read(&damaged(bytes, &mut rng));
    }
}
