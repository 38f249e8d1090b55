#![no_main]
use lenslet_core::dictionary;
use libfuzzer_sys::fuzz_target;
use sha2::{Digest, Sha256};

fuzz_target!(|data: &[u8]| {
    let read = |bytes: &[u8]| {
        if let Ok(d) = dictionary::from_bytes(bytes, "input") {
            dictionary::validate(&d).expect("what is read is valid");
            let kinds = dictionary::read_kinds(bytes, "input").expect("a header is easier to read");
            assert_eq!(kinds.len(), d.models.len());
        }
    };
    read(data);
    // The same as the header of a file of tensors.
    let tensors = [&(data.len() as u64).to_le_bytes()[..], data].concat();
    read(&tensors);
    // The same with its checksum made to fit, or nothing would ever get past it.
    if data.len() > 32 {
        let mut sealed = data.to_vec();
        let body = data.len() - 32;
        let seal = Sha256::digest(&sealed[..body]);
        sealed[body..].copy_from_slice(&seal);
        read(&sealed);
    }
});
