#![no_main]
use lenslet_core::container::{json, metadata};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    if let Ok(value) = json::parse(data) {
        let (frame, _) = metadata::read_frame(&value, Some(&value));
        assert!(frame.levels.is_none_or(|l| l.black[0] < l.white[0]));
    }
});
