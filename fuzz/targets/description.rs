#![no_main]
use lenslet_core::lightfield::{self, ReadOptions};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    // `lightfield.json` of a folder without views.
    let file = lenslet_fuzz::put(data, "json");
    let Some(folder) = file.parent().map(|p| p.join("field")) else { return };
    std::fs::create_dir_all(&folder).expect("a folder");
    std::fs::rename(&file, folder.join("lightfield.json")).expect("its description");
    let _ = lightfield::open(&folder, &ReadOptions { max_bytes: 64 << 20, ..ReadOptions::default() });
});
