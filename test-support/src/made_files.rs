//! Parts of files that tests make byte by byte.

/// Adds a chunk of a PNG.
pub fn png_chunk(out: &mut Vec<u8>, kind: &[u8; 4], data: &[u8]) {
    out.extend((data.len() as u32).to_be_bytes());
    let mut crc = flate2::Crc::new();
    crc.update(kind);
    crc.update(data);
    out.extend(kind);
    out.extend(data);
    out.extend(crc.sum().to_be_bytes());
}

/// Adds a segment of an LFP container: its letter, the reference by which it is named, its bytes.
pub fn lfp_segment(out: &mut Vec<u8>, letter: u8, reference: &str, payload: &[u8]) {
    out.extend([0x89, b'L', b'F', letter, b'\r', b'\n', 0x1a, b'\n', 0, 0, 0, 0]);
    out.extend((payload.len() as u32).to_be_bytes());
    out.extend(reference.bytes());
    out.extend([0; 35]);
    out.extend(payload);
    out.resize(out.len().next_multiple_of(16), 0);
}
