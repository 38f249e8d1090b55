#![no_main]
use lenslet_core::container::segments::Container;
use lenslet_core::container::{Capture, locate_frame};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let path = lenslet_fuzz::put(data, "lfp");
    if let Ok(capture) = Capture::open(&path) {
        assert_eq!(capture.mosaic.data.len(), capture.mosaic.width * capture.mosaic.height);
    }
    if let Ok(container) = Container::from_bytes(&path, data.to_vec()) {
        for s in &container.segments {
            assert_eq!(container.payload(s).expect("in memory").len() as u64, s.length);
        }
        let _ = locate_frame(&container);
    }
});
