#![no_main]
use lenslet_core::decode::HexSamples;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    if let Ok(s) = HexSamples::load(&lenslet_fuzz::put(data, "npz")) {
        assert_eq!(s.index.len(), s.centres.len());
    }
});
