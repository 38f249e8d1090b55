#![no_main]
use lenslet_core::container::Capture;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    // A raw of a few pixels, with any text beside it.
    let text = lenslet_fuzz::put(data, "txt");
    let raw = text.with_extension("raw");
    std::fs::write(&raw, [0x5a; 384]).expect("the raw");
    if let Ok(capture) = Capture::open(&raw) {
        assert_eq!(capture.mosaic.data.len(), capture.mosaic.width * capture.mosaic.height);
    }
});
