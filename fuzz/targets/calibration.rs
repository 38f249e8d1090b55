#![no_main]
use lenslet_core::calibration;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    if let Ok(c) = calibration::load(&lenslet_fuzz::put(data, "calib")) {
        assert!(c.lattice.pitch() > 0.0);
    }
});
