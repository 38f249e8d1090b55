#![no_main]
use lenslet_core::container::CameraProfile;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    if let Ok(text) = std::str::from_utf8(data)
        && let Ok(profile) = CameraProfile::from_toml(text)
    {
        assert!(profile.raw_bytes().is_some());
    }
});
