#![no_main]
use lenslet_core::lightfield::{self, ReadOptions};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    // The first byte picks how the rest is read: .npy, .mat and pictures tell themselves, lenslet pictures need a size.
    let Some((&first, rest)) = data.split_first() else { return };
    let views = (first & 1 == 1).then_some([usize::from(first >> 1 & 7), usize::from(first >> 4 & 7)]);
    let options = ReadOptions { views, max_bytes: 64 << 20, ..ReadOptions::default() };
    let _ = lightfield::load(&lenslet_fuzz::put(rest, "lf"), &options);
});
