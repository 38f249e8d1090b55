#![no_main]
use lenslet_core::container::whites;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    if let Ok(list) = whites::list_calibration_images(&lenslet_fuzz::put(data, "tar")) {
        for c in list.images {
            assert!(c.mean.is_finite());
            let _ = c.load();
        }
    }
});
