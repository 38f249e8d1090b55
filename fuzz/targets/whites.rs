#![no_main]
use lenslet_core::container::whites;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    if let Ok(list) = whites::list(&lenslet_fuzz::put(data, "tar")) {
        for c in list.candidates {
            assert!(c.mean.is_finite());
            let _ = c.load();
        }
    }
});
