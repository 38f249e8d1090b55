//! Small files that claim much.

use std::io::Write as _;

use lenslet_test_support::png_chunk;

use super::bench::Bench;
use super::fields::{aloud, told};

/// Memory that a run may take at most, KiB: far below what the files claim.
const LIMIT: &str = "700";

/// A PNG of `width`×`height` pixels of `bits` and `colour` that are all the same.
fn flat_png(width: u32, height: u32, bits: u8, colour: u8) -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut head = [width.to_be_bytes(), height.to_be_bytes()].concat();
    head.extend([bits, colour, 0, 0, 0]);
    png_chunk(&mut bytes, b"IHDR", &head);
    if colour == 3 {
        png_chunk(&mut bytes, b"PLTE", &[0, 0, 0, 255, 255, 255]);
    }
    let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    let line = vec![0; 1 + (width as usize * usize::from(bits)).div_ceil(8)];
    for _ in 0..height {
        packed.write_all(&line).unwrap();
    }
    png_chunk(&mut bytes, b"IDAT", &packed.finish().unwrap());
    png_chunk(&mut bytes, b"IEND", &[]);
    bytes
}

/// A photo of a few bytes ended the process, or took more than a gigabyte.
#[test]
fn pictures_that_claim_much_are_refused_within_bounded_memory() {
    let bench = Bench::new();
    let mut claim = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut head = [96u32.to_be_bytes(), 268_435_456u32.to_be_bytes()].concat();
    head.extend([8, 2, 0, 0, 0]);
    png_chunk(&mut claim, b"IHDR", &head);
    png_chunk(&mut claim, b"IDAT", &[0x78, 0x9c, 0x03, 0, 0, 0, 0, 1]);
    png_chunk(&mut claim, b"IEND", &[]);
    bench.put("p/bad.png", &claim);
    bench.put("palette.png", flat_png(8190, 8190, 1, 3));
    bench.done("simulate --sensor 160 --size 160 --views 1 --whites 1 --out s");
    std::fs::copy(bench.at("s/truth/views/view_00_00.png"), bench.at("p/good.png")).unwrap();
    let answer = aloud(bench.path(), &format!("gen-pairs p --pairs 50 --crop 48 --shrink 1 --out o --memory {LIMIT}"));
    assert!(answer.code == Some(0) && answer.err.contains("bad.png"), "{}", answer.err);
    for line in ["gen-pairs palette.png --out x", "simulate --photo palette.png --out x", "convert palette.png --out x"]
    {
        bench.refused(&format!("{line} --memory {LIMIT}"), &["palette.png", "MiB"]);
    }
    for text in ["P5 60000 60000 255\n", "P6 4294967295 4294967295 255\n"] {
        bench.put("claim.pgm", text);
        for line in ["gen-pairs claim.pgm --out x", "convert claim.pgm --out x", "info claim.pgm"] {
            bench.refused(&format!("{line} --memory {LIMIT}"), &["claim.pgm"]);
        }
    }
}

/// `info` read all numbers of a Fortran .npy and of a .mat.
#[test]
fn info_reads_headers_alone() {
    let bench = Bench::new();
    let text = "{'descr': '<f4', 'fortran_order': True, 'shape': (7, 7, 1500, 1500, 3), }\n";
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    let length = bytes.len() as u64 + 49 * 1500 * 1500 * 12;
    bench.put("f.npy", bytes);
    // Without its blocks on the disk.
    std::fs::OpenOptions::new().write(true).open(bench.at("f.npy")).unwrap().set_len(length).unwrap();
    assert_eq!(told(bench.path(), "info f.npy --memory 100")["views"], serde_json::json!([7, 7]));
}

/// A map of the truth may claim any size.
#[test]
fn maps_of_the_truth_are_bounded() {
    let bench = Bench::new();
    for (name, bytes) in [
        ("a.pfm", &b"Pf\n1000000 1000000\n-1\n"[..]),
        ("b.npy", b"\x93NUMPY\x01\x00\x46\x00{'descr': '<f4', 'fortran_order': False, 'shape': (900000, 900000), }\n"),
        ("c.npy", b"\x93NUMPY"),
        ("d.pfm", b""),
    ] {
        bench.put(name, bytes);
        bench.refused(&format!("depth lf --truth {name} --out d --memory 300"), &[name]);
    }
}
