//! The `.calib` file: magic, format version, JSON header, deflated little-endian payload, sha256 of the payload.
//!
//! ```text
//! 0   "LENSCAL\0"
//! 8   format version, u32
//! 12  header length H, u32
//! 16  H bytes of JSON: everything of [`Calibration`] that is small, the payload's size and sha256
//! …   deflated payload: the lattice and quality figures as f64 (those in the header are for information), then
//!     lenslets, hot pixels and the white image as described in `v2`; files of version 1 (`v1`) are read too
//! ```
//! All numbers little-endian.

mod header;
mod v1;
mod v2;
mod white;

use std::io::{Read, Write};
use std::path::Path;

use self::header::{FIGURES, Header, check_lattice, figures, item_bytes, white_pixels};
use super::error::Error;
use super::model::{Calibration, CalibrationQuality, Lattice, Lenslet, Vignetting};
use crate::digest::sha256_hex;

const MAGIC: &[u8; 8] = b"LENSCAL\0";
/// Newest format version read, and the one written.
const VERSION: u32 = 2;
/// Longest header accepted, bytes.
const LONGEST_HEADER: usize = 1 << 20;
/// Deflate level.
/// Source: measured; higher levels take seconds longer and save almost nothing
const LEVEL: u32 = 3;

/// Writes a calibration; refuses an existing file without `force`. Centres are rounded to 1/16384 px, the white image
/// to 1/1024 of its square root (a twentieth of one white image's own noise), trust to 1/255; everything else is exact.
///
/// ```
/// # mod drawn { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/common/drawn.rs")); }
/// # use drawn::*;
/// # use lenslet_core::calibration::{CalibrationOptions, calibrate, load, save};
/// # let camera = calibrate(&[drawn_white()], &CalibrationOptions::default(), &lenslet_core::progress::Silent)?;
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("cam.calib");
/// save(&path, &camera, false)?;
/// assert!(std::fs::read(&path)?.starts_with(b"LENSCAL\0\x02"));
///
/// let read = load(&path)?;
/// assert_eq!((read.lattice, &read.quality, &read.origin), (camera.lattice, &camera.quality, &camera.origin));
/// assert!(read.centres().zip(camera.centres()).all(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]) < 1e-4));
/// assert!(save(&path, &camera, false).is_err(), "an existing file is kept");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`Error::Output`] when the file exists or cannot be written; [`Error::Parameter`] when the white image's pixels do
/// not fit its size.
pub fn save(path: &Path, calibration: &Calibration, force: bool) -> Result<(), Error> {
    let whole = |v: &Vignetting| v.width > 0 && v.width.checked_mul(v.height) == Some(v.white.len());
    if !calibration.vignetting.as_ref().is_none_or(whole) {
        return Err(Error::Parameter(
            "the number of pixels of the calibration's white image does not match its size".into(),
        ));
    }
    let mut payload = Vec::new();
    figures(&calibration.lattice, &calibration.quality).iter().for_each(|v| payload.extend(v.to_le_bytes()));
    v2::write(calibration, &mut payload);
    let header = Header {
        program: concat!("lenslet ", env!("CARGO_PKG_VERSION")).into(),
        width: calibration.width,
        height: calibration.height,
        lattice: calibration.lattice,
        lenslets: calibration.lenslets.len(),
        hot_pixels: calibration.hot_pixels.len(),
        vignetting: calibration.vignetting.as_ref().map(|v| [v.width, v.height]),
        quality: calibration.quality.clone(),
        origin: calibration.origin.clone(),
        payload_bytes: payload.len(),
        payload_sha256: sha256_hex(&payload),
    };
    let io = |e: std::io::Error| Error::Output(crate::output::Error::Io { path: path.to_path_buf(), source: e });
    let json = serde_json::to_vec(&header).map_err(|e| io(e.into()))?;
    let pending = crate::output::Pending::file(path, force)?;
    let mut file = std::io::BufWriter::new(pending.handle()?);
    file.write_all(MAGIC).map_err(io)?;
    file.write_all(&VERSION.to_le_bytes()).map_err(io)?;
    file.write_all(&(json.len() as u32).to_le_bytes()).map_err(io)?;
    file.write_all(&json).map_err(io)?;
    let mut deflate = flate2::write::DeflateEncoder::new(file, flate2::Compression::new(LEVEL));
    deflate.write_all(&payload).map_err(io)?;
    deflate.finish().map_err(io)?.flush().map_err(io)?;
    pending.commit()?;
    Ok(())
}

/// Reads a calibration.
///
/// # Errors
/// [`Error::Read`]; [`Error::Malformed`] for files that are no calibration or damaged; [`Error::Newer`] for a later
/// format version.
pub fn load(path: &Path) -> Result<Calibration, Error> {
    let name = || path.display().to_string();
    let (file, _) = crate::input::open_regular(path).map_err(|source| Error::Read { path: name(), source })?;
    parse(std::io::BufReader::new(file), &name())
}

/// Reads a calibration from a stream; `path` is for messages.
fn parse(mut file: impl Read, path: &str) -> Result<Calibration, Error> {
    let bad = |reason: &str| Error::Malformed { path: path.into(), reason: reason.into() };
    let mut start = [0u8; 16];
    file.read_exact(&mut start).map_err(|_| bad("it is too short"))?;
    if &start[..8] != MAGIC {
        return Err(bad("it does not start like one; make one with `lenslet calibrate`"));
    }
    let word = |k: usize| u32::from_le_bytes([start[k], start[k + 1], start[k + 2], start[k + 3]]);
    if word(8) > VERSION {
        return Err(Error::Newer { path: path.into(), found: word(8), known: VERSION });
    }
    if word(8) == 0 {
        return Err(bad("its format version is 0"));
    }
    let length = word(12) as usize;
    if length > LONGEST_HEADER {
        return Err(bad("its header is too long"));
    }
    let mut json = Vec::new();
    file.by_ref().take(length as u64).read_to_end(&mut json).map_err(|_| bad("its header cannot be read"))?;
    if json.len() != length {
        return Err(bad("it ends within its header"));
    }
    let header: Header = serde_json::from_slice(&json).map_err(|e| bad(&format!("its header is damaged ({e})")))?;
    let pixels = check_header(&header, word(8)).map_err(bad)?;
    // The sizes agree with each other now; no more than the stated payload is read.
    let mut payload = Vec::new();
    flate2::read::DeflateDecoder::new(file)
        .take(header.payload_bytes as u64)
        .read_to_end(&mut payload)
        .map_err(|_| bad("its payload is damaged"))?;
    if payload.len() != header.payload_bytes {
        return Err(bad("it ends within its payload"));
    }
    if sha256_hex(&payload) != header.payload_sha256 {
        return Err(bad("its payload does not match its checksum"));
    }
    let n = header.lenslets;
    let (exact, rest) = payload.split_at(8 * FIGURES);
    let v: [f64; FIGURES] = std::array::from_fn(|k| f64::from_le_bytes(item_bytes(exact, k)));
    let lattice = Lattice { grid: header.lattice.grid, origin: [v[0], v[1]], a: [v[2], v[3]], b: [v[4], v[5]] };
    check_lattice(&lattice).map_err(bad)?;
    let quality =
        CalibrationQuality { residual_rms: v[6], scatter: v[7], noise: v[8], rejected: v[9], confidence: v[10] };
    let payload = match word(8) {
        1 => v1::read(rest, n, header.width, pixels),
        _ => v2::read(rest, &header, &lattice, pixels).map_err(bad)?,
    };
    let (right, bottom) = (header.width as f64 - 1.0, header.height as f64 - 1.0);
    let inside =
        |l: &Lenslet| (0.0..=right).contains(&l.x) && (0.0..=bottom).contains(&l.y) && (0.0..=1.0).contains(&l.trust);
    if !payload.lenslets.iter().all(inside) {
        return Err(bad("it has lenslets that are not on its sensor"));
    }
    let vignetting = header.vignetting.map(|[width, height]| Vignetting { width, height, white: payload.white });
    Ok(Calibration {
        width: header.width,
        height: header.height,
        lattice,
        lenslets: payload.lenslets,
        quality,
        vignetting,
        hot_pixels: payload.hot_pixels,
        origin: header.origin,
    })
}

/// Checks the header's numbers, and the payload's size against them; returns the pixels of the white image.
fn check_header(header: &Header, version: u32) -> Result<usize, &'static str> {
    let pixels = white_pixels(header)?;
    let rest = match version {
        1 => v1::bytes_of(header.lenslets, pixels),
        _ => v2::bytes_of(header.lenslets, header.hot_pixels, pixels),
    };
    if header.payload_bytes != 8 * FIGURES + rest {
        return Err("its payload does not have the size that its header states");
    }
    Ok(pixels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{CalibrationOptions, CalibrationOrigin, Grid, calibrate, tests::planted::PlantedCamera};
    use crate::progress::Silent;

    fn small() -> Calibration {
        let (white, _) =
            PlantedCamera { width: 128, height: 96, jitter: 0.1, grid: Grid::HexRows, ..PlantedCamera::default() }
                .white_image();
        calibrate(&[white], &CalibrationOptions::default(), &Silent).unwrap()
    }

    fn bytes_of(calibration: &Calibration) -> Vec<u8> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.calib");
        save(&path, calibration, false).unwrap();
        std::fs::read(path).unwrap()
    }

    #[test]
    fn what_is_saved_is_loaded() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.calib");
        let mut calibration = small();
        calibration.hot_pixels = vec![0, 7, 128 * 96 - 1];
        save(&path, &calibration, false).unwrap();
        let read = load(&path).unwrap();
        // What is rounded is rounded a little, and only once.
        for (a, b) in read.lenslets.iter().zip(&calibration.lenslets) {
            assert!((a.i, a.j) == (b.i, b.j) && (a.trust - b.trust).abs() <= 0.5 / 255.0 + 1e-6);
            assert!((a.x - b.x).abs() <= 1.0 / 32767.0 && (a.y - b.y).abs() <= 1.0 / 32767.0);
        }
        let roots = |c: &Calibration| -> Vec<f64> {
            c.vignetting.as_ref().unwrap().white.iter().map(|&w| (f64::from(w) / 32768.0).sqrt()).collect()
        };
        for (a, b) in roots(&read).iter().zip(roots(&calibration)) {
            assert!((a - b).abs() <= 0.52 / 1024.0 + if b < 0.05 { 6e-3 } else { 0.0 }, "{a} {b}");
        }
        let small = |c: &Calibration| Calibration { lenslets: Vec::new(), vignetting: None, ..c.clone() };
        assert_eq!(small(&read), small(&calibration));
        assert!(matches!(save(&path, &calibration, false), Err(Error::Output(crate::output::Error::Exists(_)))));
        save(&path, &read, true).unwrap();
        assert_eq!(load(&path).unwrap(), read);
        calibration = Calibration { vignetting: None, hot_pixels: Vec::new(), ..read };
        save(&path, &calibration, true).unwrap();
        assert_eq!(load(&path).unwrap(), calibration);
        assert!(matches!(load(&dir.path().join("none")), Err(Error::Read { .. })));
        calibration.vignetting = Some(Vignetting { width: 5, height: 4, white: vec![0; 19] });
        assert!(matches!(save(&path, &calibration, true), Err(Error::Parameter(_))));
    }

    #[test]
    fn hot_pixels_off_the_sensor_are_refused() {
        let mut calibration = Calibration { vignetting: None, ..small() };
        for wrong in [vec![128 * 96], vec![5, 5], vec![9, 3]] {
            calibration.hot_pixels = wrong;
            assert!(matches!(parse(&bytes_of(&calibration)[..], "x"), Err(Error::Malformed { .. })));
        }
        calibration.hot_pixels = (0..128 * 96).collect();
        assert!(matches!(parse(&bytes_of(&calibration)[..], "x"), Err(Error::Malformed { .. })));
    }

    #[test]
    fn every_truncation_and_every_flipped_byte_is_refused_or_harmless() {
        let bytes = bytes_of(&small());
        let calibration = parse(&bytes[..], "x").unwrap();
        for length in (0..bytes.len()).step_by(61).chain(0..40) {
            assert!(matches!(parse(&bytes[..length], "x"), Err(Error::Malformed { .. })), "{length}");
        }
        for at in (0..bytes.len()).step_by(37).chain(0..600) {
            let mut broken = bytes.clone();
            broken[at] ^= 0x15;
            // A flipped digit in the header's figures can still be a calibration; lenslets and white image cannot
            // change unseen.
            if let Ok(read) = parse(&broken[..], "x") {
                assert!(read.lenslets == calibration.lenslets && read.vignetting == calibration.vignetting);
            }
        }
    }

    #[test]
    fn a_newer_file_is_refused_with_advice() {
        let mut bytes = bytes_of(&small());
        bytes[8] = 3;
        let message = parse(&bytes[..], "cam.calib").unwrap_err().to_string();
        assert!(message.contains("format 3") && message.contains("update"), "{message}");
    }

    #[test]
    fn headers_with_excessive_sizes_are_refused_before_memory_is_allocated() {
        let header = |width: usize, lenslets: usize, payload: usize| Header {
            program: String::new(),
            width,
            height: 100,
            lattice: Lattice { grid: Grid::Square, origin: [0.0; 2], a: [10.0, 0.0], b: [0.0, 10.0] },
            lenslets,
            hot_pixels: 0,
            vignetting: None,
            quality: CalibrationQuality::default(),
            origin: CalibrationOrigin::default(),
            payload_bytes: payload,
            payload_sha256: String::new(),
        };
        for (version, bytes) in [(1, 368), (2, 266)] {
            assert!(check_header(&header(100, 10, bytes), version).is_ok());
            assert!(check_header(&header(100, 10, bytes + 1), version).is_err());
            assert!(check_header(&header(100, usize::MAX / 8, bytes), version).is_err());
            assert!(check_header(&header(usize::MAX, 10, bytes), version).is_err());
        }
        let mut lattice = header(100, 10, 368).lattice;
        assert!(check_lattice(&lattice).is_ok());
        lattice.a = [0.0; 2];
        assert!(check_lattice(&lattice).is_err());
        lattice.a = [f64::NAN; 2];
        assert!(check_lattice(&lattice).is_err());
    }

    #[test]
    fn a_white_image_without_pixels_is_not_saved() {
        let folder = tempfile::tempdir().unwrap();
        let mut camera = small();
        for (width, height, pixels) in [(0, 0, 0), (0, 96, 0), (128, 96, 128 * 96 - 1)] {
            camera.vignetting = Some(Vignetting { width, height, white: vec![1; pixels] });
            assert!(matches!(save(&folder.path().join("a.calib"), &camera, false), Err(Error::Parameter(_))));
        }
    }
}
