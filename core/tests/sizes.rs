//! Numbers that files declare: each in turn is made absurd, up to 2⁶³ and beyond, NaN and infinite; texts are nested
//! deeply or made huge; large files are cut off at 200 random lengths. Every reader answers with an error or a sound
//! value, within bounded memory.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)] // a test may fail loudly, and say what it did

mod common;

use std::fs;

use common::files::{
    Slot, alone, bits, calibration_of, check, container_of, dictionary_header, line, parts_of, pixels,
    small_calibration, small_dictionary, small_samples, tar, told, without_checksum,
};
use lenslet_core::container::{CameraProfile, Capture, json, metadata, open_capture, whites};
use lenslet_core::decode::HexSamples;
use lenslet_core::lightfield::{self, ColourSpace, Format, Meta, ReadOptions};
use lenslet_core::{calibration, dictionary};
use ndarray::Array3;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use sha2::Digest;

/// Cuts of a large file.
const CUTS: usize = 200;

/// Pixels a side of a large capture; LENSLET_BIG=3000 makes them as large as real ones
/// (at 3280, a raw of a known camera, its text may be missing).
fn big() -> usize {
    std::env::var("LENSLET_BIG").ok().and_then(|n| n.parse().ok()).unwrap_or(400)
}

/// What of a file was read, a number a part: equal parts have equal numbers. Nothing where it was refused.
type Read = Box<dyn Fn(&[u8]) -> Option<Vec<u64>>>;

/// Files that a checksum guards: what is read of a damaged one is what was written.
const SEALED: [&str; 5] = ["mosaic .png", "calibration", "lenslet picture", "samples", "dictionary"];

/// A file and what reads it.
struct Reader {
    name: &'static str,
    bytes: Vec<u8>,
    /// A value that does not keep its promises, or an error without words, panics.
    read: Read,
}

impl Reader {
    /// Reads the file as it was written.
    fn whole(&self) -> Vec<u64> {
        (self.read)(&self.bytes).unwrap_or_else(|| panic!("{} is not sound to begin with", self.name))
    }
}

fn reader<E: std::fmt::Display>(
    name: &'static str,
    bytes: Vec<u8>,
    read: impl Fn(&[u8]) -> Result<Vec<u64>, E> + 'static,
) -> Reader {
    let read = move |bytes: &[u8]| read(bytes).map_err(line).ok();
    Reader { name, bytes, read: Box::new(read) }
}

/// Pixels, then those of the white image.
fn parts_of_capture(c: &Capture) -> Vec<u64> {
    check(c);
    std::iter::once(pixels(c)).chain(c.white.iter().map(|w| pixels(w))).collect()
}

fn captured(slot: &Slot, bytes: &[u8]) -> Result<Vec<u64>, lenslet_core::container::Error> {
    open_capture(slot.put(bytes), None).map(|c| parts_of_capture(&c))
}

fn fields(name: &'static str, file: &str, format: Format, side: usize) -> Reader {
    let slot = Slot::new(file);
    let meta = Meta::new([3, 3], [side, side], 3, ColourSpace::Srgb);
    let mut sink = lightfield::create(&slot.path, meta, format, false).unwrap();
    let view = Array3::from_shape_fn((side, side, 3), |(t, s, c)| ((t * 8 + s + c) % 60) as f32 / 60.0);
    (0..9).for_each(|k| sink.write(k / 3, k % 3, &view).unwrap());
    sink.finish().unwrap();
    let options =
        ReadOptions { views: (format == Format::Eslf).then_some([3, 3]), max_bytes: 256 << 20, ..Default::default() };
    let target = if format == Format::Directory { slot.path.join("lightfield.json") } else { slot.path.clone() };
    reader(name, fs::read(&target).unwrap(), move |bytes| {
        let whole = &slot; // or its folder would not be kept
        fs::write(&target, bytes).unwrap();
        lightfield::load(&whole.path, &options).map(|l| {
            let m = &l.meta;
            assert_eq!(l.data.len(), m.views[0] * m.views[1] * m.size[0] * m.size[1] * m.channels);
            assert!(l.data.iter().all(|v| v.is_finite()));
            vec![told(&l.data.dim()), bits(&l.data)]
        })
    })
}

/// A reader for each kind of file, with a sound file whose captures have `side` pixels a side.
fn readers(side: usize) -> Vec<Reader> {
    let [text, image, _] = parts_of(side);
    let slot = || Slot::new("a");
    let mut all = Vec::new();
    let s = Slot::new("a.lfp");
    all.push(reader("container", container_of(side, true), move |b| captured(&s, b)));
    all.push(reader("metadata", text.clone(), |b| {
        json::parse(b).map(|value| vec![told(&metadata::read_frame(&value, None))])
    }));
    let profile_text = include_bytes!("../profiles/lytro-f01.toml");
    all.push(reader("profile", profile_text.to_vec(), |b| {
        let text = std::str::from_utf8(b).map_err(|e| e.to_string())?;
        let profile = CameraProfile::from_toml(text).map_err(|e| e.to_string())?;
        assert!(profile.raw_bytes().is_some());
        Ok::<_, String>(vec![told(&profile)])
    }));
    for (name, of_text) in [("raw", false), ("text beside a raw", true)] {
        let s = Slot::new("a.raw");
        let beside = s.dir.path().join("a.txt");
        fs::write(&s.path, &image).unwrap();
        fs::write(&beside, &text).unwrap();
        all.push(reader(name, if of_text { text.clone() } else { image.clone() }, move |b| {
            let whole = &s; // or its folder would not be kept
            fs::write(if of_text { &beside } else { &whole.path }, b).unwrap();
            open_capture(&whole.path, None).map(|c| parts_of_capture(&c))
        }));
    }
    for (name, file) in [("mosaic .png", "a.png"), ("mosaic .tif", "a.tif"), ("mosaic .pgm", "a.pgm")] {
        let s = Slot::new(file);
        let n = side as u32;
        image::ImageBuffer::<image::Luma<u16>, _>::from_fn(n, n, |x, y| image::Luma([(x * 100 + y) as u16]))
            .save(&s.path)
            .unwrap();
        all.push(reader(name, fs::read(&s.path).unwrap(), move |b| captured(&s, b)));
    }
    let manifest =
        br#"{"calibrationFiles":[{"name":"MOD_0002.GCT","hash":"sha1-0123456789012345678901234567890123456789"}]}"#;
    let archive = tar(&[("MOD_0002.RAW", &image), ("MOD_0002.TXT", &text), ("cal_file_manifest.json", manifest)]);
    let s = Slot::new("caldata.tar");
    all.push(reader("archive of white images", archive, move |b| {
        whites::list_calibration_images(s.put(b)).map(|list| {
            let loaded = list.images.iter().filter_map(|c| c.load().map_err(line).ok());
            loaded.flat_map(|white| parts_of_capture(&white)).collect()
        })
    }));
    let s = slot();
    calibration::save(&s.path, &calibration_of(side.max(64), side.max(48)), false).unwrap();
    all.push(reader("calibration", fs::read(&s.path).unwrap(), move |b| {
        calibration::load(s.put(b)).map(|c| {
            assert!(c.lattice.pitch().is_finite() && c.lattice.pitch() > 0.0);
            assert!(c.lenslets.iter().all(|l| l.x.is_finite() && l.y.is_finite() && l.trust.is_finite()));
            vec![told(&c.lattice), told(&c.lenslets), told(&c.quality), told(&c.vignetting)]
        })
    }));
    all.push(fields("light field directory", "dir", Format::Directory, 8));
    all.push(fields("light field .npy", "a.npy", Format::Npy, side / 2));
    all.push(fields("light field .mat", "a.mat", Format::Mat, side / 2));
    all.push(fields("lenslet picture", "a.png", Format::Eslf, side / 4));
    let s = slot();
    small_samples((side * side / 100) as i32).save(&s.path, false).unwrap();
    all.push(reader("samples", fs::read(&s.path).unwrap(), move |b| {
        HexSamples::load(s.put(b)).map(|s| {
            assert_eq!((s.values.dim().0, s.values.dim().1), (s.views * s.views, s.centres.len()));
            assert!(s.view_step > 0.0 && s.centres.iter().flatten().all(|c| c.is_finite()));
            vec![told(&(s.views, s.sensor, s.view_step, &s.centres, &s.index, &s.weights)), bits(&s.values)]
        })
    }));
    let file = if side < 100 {
        dictionary::to_bytes(&small_dictionary()).unwrap()
    } else {
        include_bytes!("../../dictionaries/default.lfd").to_vec()
    };
    let read = |b: &[u8]| {
        dictionary::from_bytes(b, "a").map(|d| {
            dictionary::validate(&d).unwrap();
            d.models.iter().map(|m| &m.patch_model).map(|p| bits(p.low.iter().chain(&p.high).chain(&p.ridge))).collect()
        })
    };
    let tensors = dictionary::Format::Safetensors.to_bytes(&dictionary::from_bytes(&file, "a").unwrap()).unwrap();
    all.push(reader("dictionary", file, read));
    all.push(reader("dictionary of tensors", without_checksum(&tensors), read));
    all
}

/// Sizes, as whole numbers of four and of eight bytes.
const SIZES: [u64; 9] = [0, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 1 << 40, 1 << 62, (1 << 63) - 1, 1 << 63, u64::MAX];
/// What stands for a number in a text.
const TEXTS: [&str; 12] = [
    "0",
    "-1",
    "NaN",
    "Infinity",
    "-inf",
    "1e999",
    "1e-999",
    "2147483648",
    "4294967296",
    "9223372036854775807",
    "9223372036854775808",
    "36893488147419103232",
];

/// `bytes` with every place of its first `reach` bytes, and every number of its texts, made absurd in turn.
fn absurd(bytes: &[u8], reach: usize, mut read: impl FnMut(&[u8])) -> usize {
    let mut count = 0;
    let mut try_one = |bytes: &[u8]| {
        read(bytes);
        count += 1;
    };
    let mut changed = bytes.to_vec();
    for at in 0..bytes.len().min(reach) {
        let mut put = |value: &[u8]| {
            let end = (at + value.len()).min(bytes.len());
            changed[at..end].copy_from_slice(&value[..end - at]);
            try_one(&changed);
            changed[at..end].copy_from_slice(&bytes[at..end]);
        };
        for size in SIZES {
            put(&size.to_le_bytes());
            put(&size.to_be_bytes());
            if let Ok(short) = u32::try_from(size) {
                put(&short.to_le_bytes());
                put(&short.to_be_bytes());
            }
        }
        for odd in [f64::NAN, f64::INFINITY, -f64::MAX] {
            put(&odd.to_le_bytes());
            put(&(odd as f32).to_le_bytes());
        }
    }
    let mut at = 0;
    while at < bytes.len().min(4 * reach) {
        let digits = bytes[at..].iter().take_while(|b| b.is_ascii_digit()).count();
        for text in TEXTS.iter().filter(|_| digits > 0) {
            try_one(&[&bytes[..at], text.as_bytes(), &bytes[at + digits..]].concat());
            // Fields of a fixed width keep it.
            let mut same = bytes.to_vec();
            same[at..at + digits]
                .iter_mut()
                .zip(text.bytes().rev().chain(std::iter::repeat(b'7')))
                .for_each(|(b, t)| *b = t);
            try_one(&same);
        }
        at += digits.max(1);
    }
    count
}

#[test]
fn sizes_up_to_two_to_the_63rd_and_numbers_that_are_none() {
    alone("sizes_up_to_two_to_the_63rd_and_numbers_that_are_none", 600, || {
        let mut count = 0;
        for reader in readers(16) {
            let (name, whole) = (reader.name, reader.whole());
            let reach = if reader.bytes.len() > 4096 { 400 } else { 600 };
            // Refused, read as it was written (a place that means nothing, or is optional), or read as another value.
            let (mut refused, mut harmless, mut other) = (0, 0, 0);
            count += absurd(&reader.bytes, reach, |b| match (reader.read)(b) {
                None => refused += 1,
                Some(read) if read == whole => harmless += 1,
                Some(_) => other += 1,
            });
            println!("{name}: {refused} refused, {harmless} harmless, {other} read as another value");
            assert!(refused > 0 && (other == 0 || !SEALED.contains(&name)), "{name}: {refused}, {harmless}, {other}");
        }
        println!("{count} executions");
    });
}

/// The same where a checksum would refuse every change before it is looked at: the checksum is made to fit.
#[test]
fn absurd_numbers_behind_a_checksum_that_fits() {
    alone("absurd_numbers_behind_a_checksum_that_fits", 600, || {
        let whole = dictionary::to_bytes(&small_dictionary()).unwrap();
        let body = &whole[..whole.len() - 32];
        let (head, payload) = body.split_at((24 + dictionary_header(body)).next_multiple_of(64));
        let mut count = absurd(head, 700, |head| {
            let whole = [head, payload].concat();
            let sealed = [&whole[..], &sha2::Sha256::digest(&whole)].concat();
            dictionary::from_bytes(&sealed, "a").map_or_else(line, |d| dictionary::validate(&d).unwrap());
        });

        let slot = Slot::new("a.calib");
        calibration::save(&slot.path, &small_calibration(), false).unwrap();
        for whole in [fs::read(&slot.path).unwrap(), include_bytes!("../../tests/reference/golden-1.calib").to_vec()] {
            let length = u32::from_le_bytes(whole[12..16].try_into().unwrap()) as usize;
            let (head, packed) = whole.split_at(16 + length);
            let mut payload = Vec::new();
            std::io::Read::read_to_end(&mut flate2::read::DeflateDecoder::new(packed), &mut payload).unwrap();
            let text = std::str::from_utf8(&head[16..]).unwrap();
            let hash =
                |bytes: &[u8]| sha2::Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect::<String>();
            let old = hash(&payload);
            assert!(text.contains(&old));
            let mut good = 0;
            count += absurd(&payload, 300, |changed| {
                let text = text.replace(&old, &hash(changed));
                let mut file = [&head[..12], &(text.len() as u32).to_le_bytes(), text.as_bytes()].concat();
                let mut deflate = flate2::write::DeflateEncoder::new(&mut file, flate2::Compression::fast());
                std::io::Write::write_all(&mut deflate, changed).unwrap();
                deflate.finish().unwrap();
                match calibration::load(slot.put(&file)) {
                    Ok(c) => {
                        assert!(c.lattice.pitch().is_finite() && c.lattice.pitch() > 0.0);
                        assert!(c.lenslets.iter().all(|l| l.x.is_finite() && l.y.is_finite() && l.trust.is_finite()));
                        good += 1;
                    }
                    Err(e) => line(e),
                }
            });
            assert!(good > 0, "the checksum never fitted");
        }
        println!("{count} executions");
    });
}

#[test]
fn large_files_cut_off_at_random_lengths() {
    let side = big();
    // Larger ones by how much the largest have.
    alone("large_files_cut_off_at_random_lengths", if side <= 400 { 600 } else { 1000 }, || {
        for (seed, reader) in readers(side).into_iter().enumerate() {
            let (name, bytes, whole) = (reader.name, &reader.bytes, reader.whole());
            let mut rng = ChaCha8Rng::seed_from_u64(seed as u64);
            let mut harmless = 0;
            for _ in 0..CUTS {
                let length = rng.random_range(0..bytes.len());
                if let Some(read) = (reader.read)(&bytes[..length]) {
                    // A white image or a mark at the end may be missing; what is read was written. A profile is a text
                    // without an end: names may be cut off its list.
                    assert!(
                        name == "profile" || whole.starts_with(&read),
                        "{name} cut off at {length} of {} bytes is another one",
                        bytes.len()
                    );
                    harmless += 1;
                }
            }
            println!("{name}: {} KiB, {CUTS} cuts, {harmless} of them harmless", bytes.len() / 1024);
        }
    });
}

/// Texts that are nested too deeply for a stack, or larger than any description.
#[test]
fn texts_deep_and_huge() {
    alone("texts_deep_and_huge", 600, || {
        let deep: Vec<Vec<u8>> =
            ["[", "{\"a\":", "[{\"a\":", "{\"views\":["].map(|open| open.repeat(1_000_000).into()).into();
        let long = format!("{{\"a\":\"{}\"}}", "x".repeat(20 << 20)).into_bytes();
        let many = format!("{{\"a\":[{}0]}}", "0,".repeat(4 << 20)).into_bytes();
        let texts = [&deep[..], &[long, many]].concat();
        let readers = readers(16);
        let of = |name: &str| readers.iter().find(|r| r.name == name).unwrap();
        for text in &texts {
            for name in ["text beside a raw", "light field directory", "profile"] {
                assert!((of(name).read)(text).is_none(), "{name}");
            }
            // It may be sound JSON with nothing of use in it.
            (of("metadata").read)(text);
            (of("archive of white images").read)(&tar(&[("a.RAW", b"x"), ("cal_file_manifest.json", text)]));
        }
        for open in ["a = [", "[[a.", "a = {a = "] {
            assert!((of("profile").read)(open.repeat(1_000_000).as_bytes()).is_none());
        }
    });
}
