//! Damaged and malicious files for the readers outside of the core: photos, maps of the truth, parameters of training, camera
//! profiles, descriptions of arrays. Each reader gives an error or a value, within bounded memory and time.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it skips

use std::io::Cursor;
use std::time::Instant;

use lenslet_core::lightfield::{self, ColourSpace, Format, Meta, ReadOptions};
use lenslet_core::{container::CameraProfile, pfm};
use lenslet_data_gen::photo::load_luminance;
use lenslet_train::Parameters;
use ndarray::Array3;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

/// Damaged copies of each file.
const COUNT: usize = 3000;
/// Words and numbers that break readers.
const WORDS: [&[u8]; 12] = [
    b"NaN",
    b"-1",
    b"1e999",
    b"null",
    b"[[[[[[",
    b"\"",
    b"\xff\xff\xff\xff",
    b"\x7f\xff\xff\xff",
    b"\0\0\0\0",
    b"4294967296",
    b"inf",
    b"9999999999",
];

/// `bytes` cut off at some hundred lengths, then damaged `count` times.
fn torment(name: &str, bytes: &[u8], seed: u64, count: usize, mut read: impl FnMut(&[u8]) -> bool) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut executions, mut taken, mut longest) = (0, 0, 0.0f64);
    let mut one = |bytes: &[u8]| {
        let began = Instant::now();
        taken += usize::from(read(bytes));
        longest = longest.max(began.elapsed().as_secs_f64());
        executions += 1;
    };
    for n in (0..bytes.len()).step_by((bytes.len() / 300).max(1)) {
        one(&bytes[..n]);
    }
    for _ in 0..count {
        let mut out = bytes.to_vec();
        for _ in 0..rng.random_range(1..=4) {
            let reach = if rng.random_bool(0.7) { out.len().min(256) } else { out.len() };
            let at = rng.random_range(0..reach.max(1)).min(out.len().saturating_sub(1));
            match rng.random_range(0..4) {
                0 => out[at] ^= 1 << rng.random_range(0..8),
                1 => out[at] = rng.random(),
                2 => {
                    let word = WORDS[rng.random_range(0..WORDS.len())];
                    let end = (at + rng.random_range(0..word.len() + 1)).min(out.len());
                    out.splice(at..end, word.iter().copied());
                }
                _ => {
                    if let Some(digit) = out[at..].iter().position(u8::is_ascii_digit) {
                        let with = b"9".repeat(rng.random_range(1..20));
                        out.splice(at + digit..=at + digit, with);
                    }
                }
            }
        }
        one(&out);
    }
    println!("{name}: {executions} executions, {taken} read, longest {longest:.3} s, {} MiB at most so far", peak());
    assert!(taken < executions, "{name}: no damage was noticed");
}

/// The most memory this process has had, MiB; 0 where the system does not say.
fn peak() -> usize {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.and_then(|l| l.split_whitespace().next()?.parse::<usize>().ok()).map_or(0, |kib| kib / 1024)
}

#[test]
fn every_reader_answers_within_a_gigabyte() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let photo = image::RgbImage::from_fn(90, 70, |x, y| image::Rgb([(2 * x) as u8, (3 * y) as u8, (x * y) as u8]));
    let formats = [
        ("photo.png", image::ImageFormat::Png),
        ("photo.jpg", image::ImageFormat::Jpeg),
        ("photo.tif", image::ImageFormat::Tiff),
        ("photo.bmp", image::ImageFormat::Bmp),
        ("photo.ppm", image::ImageFormat::Pnm),
    ];
    for (k, (name, format)) in formats.into_iter().enumerate() {
        let mut bytes = Cursor::new(Vec::new());
        photo.write_to(&mut bytes, format).unwrap();
        torment(name, &bytes.into_inner(), k as u64, COUNT, |bytes| {
            std::fs::write(at(name), bytes).unwrap();
            match load_luminance(&at(name), 16, ColourSpace::Srgb) {
                Ok(photo) => {
                    assert!(photo.luminance.iter().all(|x| (0.0..=1.0).contains(x)));
                    true
                }
                Err(e) => {
                    assert!(e.to_string().contains(name), "{e}");
                    false
                }
            }
        });
    }
    let map = ndarray::Array2::from_shape_fn((6, 9), |(t, s)| t as f32 - s as f32);
    torment("truth.pfm", &pfm::to_bytes(map.view()), 10, COUNT, |bytes| pfm::from_bytes(bytes).is_ok());
    let text = serde_json::to_vec(&Parameters::default()).unwrap();
    torment("parameters", &text, 11, COUNT, |bytes| serde_json::from_slice::<Parameters>(bytes).is_ok());
    torment("profile", include_bytes!("../core/profiles/lytro-f01.toml"), 12, COUNT, |bytes| {
        std::str::from_utf8(bytes).is_ok_and(|text| CameraProfile::from_toml(text).is_ok())
    });
    // An array with its description: damage to either never gives another colour space without a note.
    let meta = Meta::new([2, 2], [5, 6], 3, ColourSpace::Linear);
    for (k, (name, format)) in
        [("a.npy", Format::Npy), ("a.mat", Format::Mat), ("a.png", Format::Eslf)].into_iter().enumerate()
    {
        let mut sink = lightfield::create(&at(name), meta.clone(), format, false).unwrap();
        for place in 0..4 {
            sink.write(place / 2, place % 2, &Array3::from_elem((5, 6, 3), 0.1 + 0.2 * place as f32)).unwrap();
        }
        sink.finish().unwrap();
        let file = if format == Format::Npy { at("a.npy.json") } else { at(name) };
        let whole = std::fs::read(&file).unwrap();
        torment(name, &whole, 20 + k as u64, COUNT, |bytes| {
            std::fs::write(&file, bytes).unwrap();
            let options = ReadOptions { max_bytes: 64 << 20, ..ReadOptions::default() };
            let Ok(source) = lightfield::open(&at(name), &options) else { return false };
            let Ok(field) = lightfield::read_all(&*source, &at(name), options.max_bytes) else { return false };
            assert!(field.data.iter().all(|x| x.is_finite()));
            // Without its description it is taken for sRGB, and that is said.
            assert!(field.meta.colour == ColourSpace::Linear || !source.notes().is_empty() || format == Format::Eslf);
            source.notes().is_empty()
        });
    }
    assert!(peak() < 1024, "{} MiB", peak());
}
