//! `samples.npz`: what was measured, kept beside the views so that later steps can go back to it.
//!
//! A NumPy archive (zip, nothing compressed) of `values` f32 (views², lenslets, channels), `centres` f64 (lenslets, 2; x, y),
//! `index` i32 (lenslets, 2; i, j), `offsets` f64 (views², 2; u, v in sensor pixels), `sensor` i32 (2; width, height) and
//! `weights` f32 (views²; how far each view can be relied on, 1 where an older file does not say).

use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use flate2::Crc;
use ndarray::Array3;

use super::{Error, HexSamples};
use crate::output::Pending;

/// Name of the file inside a light field's directory.
pub const SAMPLES: &str = "samples.npz";

/// The samples that lie in a light field's folder, or beside a light field that is one file.
#[must_use]
pub fn beside(light_field: &Path) -> Option<PathBuf> {
    let within = light_field.join(SAMPLES);
    [within, light_field.with_extension(SAMPLES)].into_iter().find(|path| path.is_file())
}

const NAMES: [&str; 6] = ["values", "centres", "index", "offsets", "sensor", "weights"];
/// A .npy of format 1.0 begins so.
const MAGIC: &[u8] = b"\x93NUMPY\x01\x00";
const LOCAL: u32 = 0x0403_4b50;
const CENTRAL: u32 = 0x0201_4b50;
const END: u32 = 0x0605_4b50;

fn failed(path: &Path, reason: impl ToString) -> Error {
    Error::File { path: path.display().to_string(), reason: reason.to_string() }
}

/// Writes the samples under a name of their own.
///
/// # Errors
/// When the file exists (without `force`) or cannot be written.
pub fn save(path: &Path, samples: &HexSamples, force: bool) -> Result<(), Error> {
    let pending = Pending::file(path, force)?;
    write(pending.path(), samples)?;
    Ok(pending.commit()?)
}

/// Writes the samples at `path` as it is: for folders that are themselves not yet under their final name.
///
/// # Errors
/// When the file cannot be written, or the samples are too many for the format (4 GiB).
pub fn write(path: &Path, samples: &HexSamples) -> Result<(), Error> {
    let file = File::create(path).map_err(|e| failed(path, e))?;
    put(BufWriter::with_capacity(1 << 20, file), samples).map_err(|e| failed(path, e))
}

fn put(mut out: impl Write, samples: &HexSamples) -> std::io::Result<()> {
    let n = samples.views;
    let half = (n / 2) as f64;
    let step = samples.view_step;
    let offsets = (0..n * n).flat_map(|k| [((k % n) as f64 - half) * step, ((k / n) as f64 - half) * step]);
    let lenslets = samples.centres.len();
    let (views, _, channels) = samples.values.dim();
    let mut values = Vec::with_capacity(4 * samples.values.len());
    values.extend(samples.values.iter().flat_map(|v| v.to_le_bytes()));
    let parts: [(Vec<u8>, Vec<u8>); 6] = [
        (head("<f4", &[views, lenslets, channels]), values),
        (head("<f8", &[lenslets, 2]), samples.centres.iter().flatten().flat_map(|v| v.to_le_bytes()).collect()),
        (head("<i4", &[lenslets, 2]), samples.index.iter().flatten().flat_map(|v| v.to_le_bytes()).collect()),
        (head("<f8", &[n * n, 2]), offsets.flat_map(f64::to_le_bytes).collect()),
        (
            head("<i4", &[2]),
            [samples.sensor.0, samples.sensor.1].iter().flat_map(|&v| (v as i32).to_le_bytes()).collect(),
        ),
        (head("<f4", &[samples.weights.len()]), samples.weights.iter().flat_map(|v| v.to_le_bytes()).collect()),
    ];
    let mut directory = Vec::new();
    let mut at = 0u64;
    for (name, (head, data)) in NAMES.iter().zip(&parts) {
        let name = format!("{name}.npy");
        let mut crc = Crc::new();
        crc.update(head);
        crc.update(data);
        let too_big = || std::io::Error::other("more than 4 GiB of samples");
        let size = u32::try_from(head.len() + data.len()).map_err(|_| too_big())?;
        let place = u32::try_from(at).map_err(|_| too_big())?;
        // Version needed, flags, method, time, date (1980-01-01), checksum, sizes, name length, no extra field.
        let mut common = Vec::new();
        for v in [20u16, 0, 0, 0, 0x21] {
            common.extend(v.to_le_bytes());
        }
        for v in [crc.sum(), size, size] {
            common.extend(v.to_le_bytes());
        }
        common.extend((name.len() as u16).to_le_bytes());
        common.extend(0u16.to_le_bytes());
        out.write_all(&LOCAL.to_le_bytes())?;
        out.write_all(&common)?;
        out.write_all(name.as_bytes())?;
        out.write_all(head)?;
        out.write_all(data)?;
        at += (4 + common.len() + name.len()) as u64 + u64::from(size);
        directory.extend(CENTRAL.to_le_bytes());
        directory.extend(20u16.to_le_bytes());
        directory.extend(&common);
        // Comment length, disk, attributes (inner, outer), place.
        directory.extend([0; 2 + 2 + 2 + 4]);
        directory.extend(place.to_le_bytes());
        directory.extend(name.as_bytes());
    }
    out.write_all(&directory)?;
    out.write_all(&END.to_le_bytes())?;
    let count = NAMES.len() as u16;
    for v in [0, 0, count, count] {
        out.write_all(&v.to_le_bytes())?;
    }
    out.write_all(&(directory.len() as u32).to_le_bytes())?;
    out.write_all(&(at as u32).to_le_bytes())?;
    out.write_all(&0u16.to_le_bytes())?;
    out.flush()
}

/// A .npy header, format 1.0, padded so that the data starts at a multiple of 64.
fn head(descr: &str, shape: &[usize]) -> Vec<u8> {
    let shape: Vec<String> = shape.iter().map(usize::to_string).collect();
    let shape = if shape.len() == 1 { format!("{},", shape[0]) } else { shape.join(", ") };
    let text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({shape}), }}");
    let whole = (MAGIC.len() + 2 + text.len() + 1).next_multiple_of(64);
    let mut out = MAGIC.to_vec();
    out.extend(((whole - MAGIC.len() - 2) as u16).to_le_bytes());
    out.extend(text.as_bytes());
    out.resize(whole - 1, b' ');
    out.push(b'\n');
    out
}

/// Reads what [`save`] wrote, or what `numpy.savez` made of the same arrays.
///
/// # Errors
/// A file that is not such an archive, is compressed or damaged, or whose arrays contradict each other.
pub fn load(path: &Path) -> Result<HexSamples, Error> {
    let mut file = File::open(path).map_err(|e| failed(path, e))?;
    let parts = members(&mut file).map_err(|reason| failed(path, reason))?;
    let mut array = |name: &str, descr: &str| -> Result<(Vec<usize>, Vec<u8>), Error> {
        let wanted = format!("{name}.npy");
        let member = parts.iter().find(|m| m.name == wanted);
        let member = member.ok_or_else(|| failed(path, format!("it has no array `{name}`")))?;
        let bytes = contents(&mut file, member).map_err(|reason| failed(path, reason))?;
        parse(bytes, descr).map_err(|reason| failed(path, format!("array `{name}`: {reason}")))
    };
    let (shape, values) = array("values", "<f4")?;
    let (centre_shape, centres) = array("centres", "<f8")?;
    let (index_shape, index) = array("index", "<i4")?;
    let (offset_shape, offsets) = array("offsets", "<f8")?;
    let (sensor_shape, sensor) = array("sensor", "<i4")?;
    // Files from before there were weights have five arrays.
    let weights = if parts.len() == 5 { None } else { Some(array("weights", "<f4")?) };
    let disagree = || failed(path, "its arrays do not fit each other");
    let &[views, lenslets, channels] = &shape[..] else { return Err(disagree()) };
    let n = views.isqrt();
    let fits = n * n == views
        && n % 2 == 1
        && matches!(channels, 1 | 3)
        && centre_shape == [lenslets, 2]
        && index_shape == [lenslets, 2]
        && offset_shape == [views, 2]
        && sensor_shape == [2]
        && weights.as_ref().is_none_or(|(shape, _)| *shape == [views]);
    if !fits {
        return Err(disagree());
    }
    let f64s = |b: &[u8]| -> Vec<f64> { b.as_chunks().0.iter().map(|&c| f64::from_le_bytes(c)).collect() };
    let i32s = |b: &[u8]| -> Vec<i32> { b.as_chunks().0.iter().map(|&c| i32::from_le_bytes(c)).collect() };
    let f32s = |b: &[u8]| -> Vec<f32> { b.as_chunks().0.iter().map(|&c| f32::from_le_bytes(c)).collect() };
    let values = f32s(&values);
    let weights = weights.map_or_else(|| vec![1.0; views], |(_, bytes)| f32s(&bytes));
    let (centres, index, offsets, sensor) = (f64s(&centres), i32s(&index), f64s(&offsets), i32s(&sensor));
    // The first view stands at −(n/2)·step; a single view says nothing of the step.
    let view_step = if n > 1 { -offsets[0] / (n / 2) as f64 } else { 1.0 };
    let side = |v: i32| usize::try_from(v).ok().filter(|&v| v > 0 && v <= 1 << 20);
    let (Some(width), Some(height)) = (side(sensor[0]), side(sensor[1])) else { return Err(disagree()) };
    let sane = view_step > 0.0
        && view_step < 1e3
        && centres.iter().all(|c| c.abs() < 1e9)
        && weights.iter().all(|w| (0.0..=1.0).contains(w));
    if !sane {
        return Err(disagree());
    }
    Ok(HexSamples {
        sensor: (width, height),
        centres: centres.as_chunks().0.to_vec(),
        index: index.as_chunks().0.to_vec(),
        views: n,
        view_step,
        weights,
        values: Array3::from_shape_vec((views, lenslets, channels), values).map_err(|_| disagree())?,
    })
}

/// A member of the archive.
struct Member {
    name: String,
    crc: u32,
    size: u32,
    place: u32,
}

fn le16(b: &[u8], at: usize) -> Option<usize> {
    Some(usize::from(u16::from_le_bytes(b.get(at..at + 2)?.try_into().ok()?)))
}

fn le32(b: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(b.get(at..at + 4)?.try_into().ok()?))
}

fn members(file: &mut File) -> Result<Vec<Member>, String> {
    let io = |e: std::io::Error| e.to_string();
    let length = file.seek(SeekFrom::End(0)).map_err(io)?;
    // The end record is 22 bytes and a comment of up to 65535.
    let tail = length.min(22 + 65_535);
    file.seek(SeekFrom::Start(length - tail)).map_err(io)?;
    let mut end = Vec::new();
    file.take(tail).read_to_end(&mut end).map_err(io)?;
    let not = || "it is not a NumPy archive (.npz)".to_string();
    let at = (0..end.len().saturating_sub(21)).rev().find(|&k| le32(&end, k) == Some(END)).ok_or_else(not)?;
    let (Some(count), Some(size), Some(place)) = (le16(&end, at + 10), le32(&end, at + 12), le32(&end, at + 16)) else {
        return Err(not());
    };
    if u64::from(place) + u64::from(size) > length {
        return Err("it ends early".into());
    }
    file.seek(SeekFrom::Start(u64::from(place))).map_err(io)?;
    let mut directory = Vec::new();
    file.take(u64::from(size)).read_to_end(&mut directory).map_err(io)?;
    let mut found = Vec::new();
    let mut at = 0;
    while le32(&directory, at) == Some(CENTRAL) {
        let record = |k| le16(&directory, at + k).ok_or_else(not);
        let long = |k| le32(&directory, at + k).ok_or_else(not);
        if record(10)? != 0 {
            return Err("it is compressed; write it with numpy.savez".into());
        }
        let name = directory.get(at + 46..at + 46 + record(28)?).ok_or_else(not)?;
        let name = String::from_utf8_lossy(name).into_owned();
        found.push(Member { name, crc: long(16)?, size: long(24)?, place: long(42)? });
        at += 46 + record(28)? + record(30)? + record(32)?;
    }
    if found.len() != count {
        return Err("its directory is damaged".into());
    }
    Ok(found)
}

fn contents(file: &mut File, member: &Member) -> Result<Vec<u8>, String> {
    let io = |e: std::io::Error| format!("{}: {e}", member.name);
    let damaged = || format!("{} is damaged", member.name);
    file.seek(SeekFrom::Start(u64::from(member.place))).map_err(io)?;
    let mut local = [0; 30];
    file.read_exact(&mut local).map_err(io)?;
    let (Some(LOCAL), Some(name), Some(extra)) = (le32(&local, 0), le16(&local, 26), le16(&local, 28)) else {
        return Err(damaged());
    };
    file.seek(SeekFrom::Current((name + extra) as i64)).map_err(io)?;
    // Reading stops at the end of the file, whatever size the archive claims.
    let mut bytes = Vec::new();
    file.take(u64::from(member.size)).read_to_end(&mut bytes).map_err(io)?;
    let mut crc = Crc::new();
    crc.update(&bytes);
    if bytes.len() != member.size as usize || crc.sum() != member.crc {
        return Err(damaged());
    }
    Ok(bytes)
}

/// Shape and data of a .npy of the type `descr`.
fn parse(mut bytes: Vec<u8>, descr: &str) -> Result<(Vec<usize>, Vec<u8>), String> {
    let item: usize = descr[2..].parse().map_err(|_| "no such type".to_string())?;
    if !bytes.starts_with(MAGIC) {
        return Err("it is not a .npy of format 1.0".into());
    }
    let start = 10 + le16(&bytes, 8).unwrap_or(0);
    let text = bytes.get(10..start).map(String::from_utf8_lossy).ok_or("its header is cut off")?.into_owned();
    if !text.contains(&format!("'{descr}'")) || !text.contains("'fortran_order': False") {
        return Err(format!("expected {descr} in C order"));
    }
    let shape = text.split_once("'shape': (").and_then(|(_, s)| s.split_once(')')).ok_or("it has no shape")?.0;
    let shape: Option<Vec<usize>> =
        shape.split(',').map(str::trim).filter(|n| !n.is_empty()).map(|n| n.parse().ok()).collect();
    let shape = shape.ok_or("its shape is not made of numbers")?;
    let expected = shape.iter().try_fold(item, |n, &k| n.checked_mul(k)).ok_or("its shape is too large")?;
    if bytes.len() - start != expected {
        return Err(format!("{} bytes where its shape needs {expected}", bytes.len() - start));
    }
    bytes.drain(..start);
    Ok((shape, bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some() -> HexSamples {
        HexSamples {
            sensor: (40, 30),
            centres: vec![[1.5, 2.5], [11.5, 2.25], [6.0, 11.0]],
            index: vec![[0, 0], [1, 0], [0, 1]],
            views: 3,
            view_step: 1.25,
            weights: (0..9).map(|k| 1.0 - 0.125 * (k as f32 - 4.0).abs()).collect(),
            values: Array3::from_shape_fn((9, 3, 3), |(v, k, c)| v as f32 - 0.1 * k as f32 + 0.01 * c as f32),
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("samples.npz");
        save(&path, &some(), false).unwrap();
        assert_eq!(load(&path).unwrap(), some());
        assert!(matches!(save(&path, &some(), false), Err(Error::Output(_))));
        // Another implementation reads it, too.
        let mut npz = ndarray_npy::NpzReader::new(File::open(&path).unwrap()).unwrap();
        let values: Array3<f32> = npz.by_name("values.npy").unwrap();
        assert_eq!(values, some().values);
        let sensor: ndarray::Array1<i32> = npz.by_name("sensor.npy").unwrap();
        assert_eq!(sensor.as_slice().unwrap(), &[40, 30]);
    }

    #[test]
    fn every_truncation_and_every_flipped_byte_is_survived() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("samples.npz");
        save(&path, &some(), false).unwrap();
        let whole = std::fs::read(&path).unwrap();
        for n in (0..whole.len()).step_by(5) {
            std::fs::write(&path, &whole[..n]).unwrap();
            assert!(load(&path).is_err(), "{n} bytes");
        }
        for n in (0..whole.len()).step_by(5) {
            let mut bytes = whole.clone();
            bytes[n] ^= 0xff;
            std::fs::write(&path, &bytes).unwrap();
            // Either refused, or the byte meant nothing; never something else.
            if let Ok(read) = load(&path) {
                assert_eq!(read, some(), "byte {n}");
            }
        }
    }

    #[test]
    fn arrays_that_contradict_each_other_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("samples.npz");
        let mut odd = some();
        odd.centres.pop();
        save(&path, &odd, false).unwrap();
        assert!(load(&path).is_err());
    }
}
