#![no_main]
use lenslet_core::container::open_capture;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    if let Ok(capture) = open_capture(&lenslet_fuzz::put(data, "img"), Some("lytro-f01")) {
        assert_eq!(capture.mosaic.data.len(), capture.mosaic.width * capture.mosaic.height);
    }
});
