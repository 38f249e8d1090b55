//! `samples.npz`: the samples that views were made from, stored beside them for later steps.
//!
//! A NumPy archive (zip, nothing compressed) of `values` f32 (views², lenslets, channels), `centres` f64 (lenslets, 2;
//! x, y), `index` i32 (lenslets, 2; i, j), `offsets` f64 (views², 2; u, v in sensor pixels), `sensor` i32 (2; width,
//! height) and `weights` f32 (views²; how reliable each view is, 1 where an older file has none). The same samples
//! give the same bytes. Before all, `lenslet` u8 is JSON that says which program wrote the file and what the samples
//! belong to ([`SamplesOrigin`]); older files have none.
//!
//! Files are not trusted: the memory used depends on the size of the file, never on a size that it states.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use crate::geometry::Size;
use ndarray::{Array1, Array2, Array3};
use ndarray_npy::{NpzWriter, WriteNpzError};
use serde::{Deserialize, Serialize};
use zip::ZipArchive;
use zip::result::ZipError;

use super::error::Error;
use super::samples::HexSamples;
use crate::input::open_regular;
use crate::output::{NPZ_MARK, Pending};

/// Name of the file of samples inside a light field's directory.
pub const SAMPLES_FILE: &str = "samples.npz";
/// First bytes of a .npy of format 1.0.
const MAGIC: &[u8] = b"\x93NUMPY\x01\x00";

/// The file of samples beside a light field that is one file: its whole name, and `.samples.npz`.
#[must_use]
pub fn samples_beside(light_field: &Path) -> PathBuf {
    let mut name = light_field.as_os_str().to_os_string();
    name.push(".");
    name.push(SAMPLES_FILE);
    name.into()
}

/// The file of the samples that a light field was made from: in its folder, or beside a light field that is one file
/// ([`samples_beside`]; earlier versions left its last ending out, so that several light fields shared one file: see
/// [`SamplesOrigin`] for whether they belong).
#[must_use]
pub fn find_samples_file(light_field: &Path) -> Option<PathBuf> {
    let within = light_field.join(SAMPLES_FILE);
    let old = light_field.with_extension(SAMPLES_FILE);
    [within, samples_beside(light_field), old].into_iter().find(|path| path.is_file())
}

/// What samples belong to.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SamplesOrigin {
    /// SHA-256 of the capture's file, hexadecimal.
    #[serde(default)]
    pub capture_sha256: String,
    /// [`view_fingerprint`] of the middle view of the light field (row and column N/2 of N) as it was written.
    #[serde(default)]
    pub middle_view: Option<u32>,
}

/// What the mark of the file holds.
#[derive(Serialize, Deserialize)]
struct Mark {
    tool: String,
    #[serde(flatten)]
    origin: SamplesOrigin,
}

impl SamplesOrigin {
    /// What the samples in a file belong to; `None` where the file does not say.
    ///
    /// # Errors
    /// When the file cannot be read or is no NumPy archive.
    pub fn read(path: &Path) -> Result<Option<SamplesOrigin>, Error> {
        let (file, _) = open_regular(path).map_err(|e| failed(path, e))?;
        let mut archive = Archive::open(file).map_err(|reason| failed(path, reason))?;
        let Ok(mark) = archive.array(NPZ_MARK, "|u1", |[byte]: [u8; 1]| byte) else { return Ok(None) };
        Ok(serde_json::from_slice::<Mark>(&mark.items).ok().map(|m| m.origin))
    }
}

/// A number that a view keeps in every format that holds 16 bits a value: the CRC-32 of its values, cut to 0..1 and
/// rounded to 16 bits.
///
/// ```
/// use lenslet_core::decode::view_fingerprint;
/// use ndarray::Array3;
///
/// let view = Array3::from_elem((2, 3, 1), 0.25f32);
/// let stored = view.mapv(|x| (x * 65535.0).round() / 65535.0);
/// assert_eq!(view_fingerprint(&view), view_fingerprint(&stored));
/// assert_ne!(view_fingerprint(&view), view_fingerprint(&(view + 0.01)));
/// ```
#[must_use]
pub fn view_fingerprint(view: &Array3<f32>) -> u32 {
    let mut crc = flate2::Crc::new();
    let bytes: Vec<u8> = view.iter().flat_map(|x| ((x.clamp(0.0, 1.0) * 65535.0 + 0.5) as u16).to_le_bytes()).collect();
    crc.update(&bytes);
    crc.sum()
}

fn failed(path: &Path, reason: impl ToString) -> Error {
    Error::File { path: path.display().to_string(), reason: reason.to_string() }
}

impl HexSamples {
    /// Writes the samples to a file that is whole or absent.
    ///
    /// # Errors
    /// When the file exists (without `force`) or cannot be written, or the samples are too many for the format (4 GiB).
    pub fn save(&self, path: &Path, force: bool) -> Result<(), Error> {
        self.save_of(path, force, &SamplesOrigin::default())
    }

    /// As [`HexSamples::save`], with what the samples belong to.
    ///
    /// # Errors
    /// As [`HexSamples::save`].
    pub fn save_of(&self, path: &Path, force: bool, origin: &SamplesOrigin) -> Result<(), Error> {
        let pending = Pending::file(path, force)?;
        write_archive(pending.handle()?, self, origin).map_err(|e| failed(path, e))?;
        Ok(pending.commit()?)
    }

    /// Reads what [`HexSamples::save`] wrote, or what `numpy.savez` made of the same arrays.
    ///
    /// # Errors
    /// A file that is not such an archive, is compressed or damaged, or whose arrays contradict each other.
    ///
    /// ```
    /// use lenslet_core::geometry::Size;
    /// use lenslet_core::decode::HexSamples;
    /// use ndarray::Array3;
    ///
    /// let samples = HexSamples {
    ///     sensor: Size::new(40, 30),
    ///     centres: vec![[10.0, 10.0]],
    ///     index: vec![[0, 0]],
    ///     views: 1,
    ///     view_step: 1.0,
    ///     weights: vec![1.0],
    ///     values: Array3::from_elem((1, 1, 3), 0.5),
    /// };
    /// let folder = tempfile::tempdir()?;
    /// let path = folder.path().join("samples.npz");
    /// samples.save(&path, false)?;
    /// assert_eq!(HexSamples::load(&path)?, samples);
    /// assert!(samples.save(&path, false).is_err(), "it exists");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn load(path: &Path) -> Result<HexSamples, Error> {
        let (file, _) = open_regular(path).map_err(|e| failed(path, e))?;
        read_archive(file).map_err(|reason| failed(path, reason))
    }
}

fn write_archive(file: File, samples: &HexSamples, origin: &SamplesOrigin) -> Result<(), WriteNpzError> {
    let pairs = |v: &[[f64; 2]]| Array2::from_shape_fn((v.len(), 2), |(k, n)| v[k][n]);
    let offsets: Vec<[f64; 2]> = (0..samples.views * samples.views).map(|k| samples.view_offset(k)).collect();
    let index = Array2::from_shape_fn((samples.index.len(), 2), |(k, n)| samples.index[k][n]);
    let mark = Mark { tool: concat!("lenslet ", env!("CARGO_PKG_VERSION")).into(), origin: origin.clone() };
    let mut npz = NpzWriter::new(file);
    npz.add_array(NPZ_MARK, &Array1::from_vec(serde_json::to_vec(&mark).unwrap_or_default()))?;
    npz.add_array("values", &samples.values)?;
    npz.add_array("centres", &pairs(&samples.centres))?;
    npz.add_array("index", &index)?;
    npz.add_array("offsets", &pairs(&offsets))?;
    npz.add_array("sensor", &Array1::from_vec(vec![samples.sensor.width as i32, samples.sensor.height as i32]))?;
    npz.add_array("weights", &Array1::from_vec(samples.weights.clone()))?;
    npz.finish()?;
    Ok(())
}

fn read_archive(file: File) -> Result<HexSamples, String> {
    let mut archive = Archive::open(file)?;
    let values = archive.array("values", "<f4", f32::from_le_bytes)?;
    let centres = archive.array("centres", "<f8", f64::from_le_bytes)?;
    let index = archive.array("index", "<i4", i32::from_le_bytes)?;
    let offsets = archive.array("offsets", "<f8", f64::from_le_bytes)?;
    let sensor = archive.array("sensor", "<i4", i32::from_le_bytes)?;
    // Files written before weights were added have five arrays.
    let weights =
        if archive.0.len() == 5 { None } else { Some(archive.array("weights", "<f4", f32::from_le_bytes)?) };

    let disagree = || "its arrays do not fit each other".to_string();
    let &[views, lenslets, channels] = &values.shape[..] else { return Err(disagree()) };
    let n = views.isqrt();
    let fits = n * n == views
        && n % 2 == 1
        && matches!(channels, 1 | 3)
        && centres.shape == [lenslets, 2]
        && index.shape == [lenslets, 2]
        && offsets.shape == [views, 2]
        && sensor.shape == [2]
        && weights.as_ref().is_none_or(|w| w.shape == [views]);
    if !fits {
        return Err(disagree());
    }
    let weights = weights.map_or_else(|| vec![1.0; views], |w| w.items);
    // The first view lies at −(n/2)·step; of a single view the step is not known.
    let view_step = if n > 1 { -offsets.items[0] / (n / 2) as f64 } else { 1.0 };
    let side = |v: i32| usize::try_from(v).ok().filter(|&v| v > 0 && v <= 1 << 20);
    let (Some(width), Some(height)) = (side(sensor.items[0]), side(sensor.items[1])) else { return Err(disagree()) };
    let sane = view_step > 0.0
        && view_step < 1e3
        && centres.items.iter().all(|c| c.abs() < 1e9)
        && weights.iter().all(|w| (0.0..=1.0).contains(w));
    if !sane {
        return Err(disagree());
    }
    Ok(HexSamples {
        sensor: Size::new(width, height),
        centres: centres.items.as_chunks().0.to_vec(),
        index: index.items.as_chunks().0.to_vec(),
        views: n,
        view_step,
        weights,
        values: Array3::from_shape_vec((views, lenslets, channels), values.items).map_err(|_| disagree())?,
    })
}

/// A NumPy archive being read.
struct Archive(ZipArchive<BufReader<File>>);

/// Shape and items of an array in C order.
struct Array<T> {
    shape: Vec<usize>,
    items: Vec<T>,
}

impl Archive {
    fn open(file: File) -> Result<Archive, String> {
        let opened = ZipArchive::new(BufReader::new(file));
        opened.map(Archive).map_err(|_| "it is not a NumPy archive (.npz), or its end is missing".into())
    }

    /// The array `name`, whose items have the NumPy type `descr`.
    fn array<T, const N: usize>(
        &mut self,
        name: &str,
        descr: &str,
        item: impl Fn([u8; N]) -> T,
    ) -> Result<Array<T>, String> {
        let mut member = self.0.by_name(&format!("{name}.npy")).map_err(|e| match e {
            ZipError::FileNotFound => format!("it has no array `{name}`"),
            ZipError::UnsupportedArchive(_) => "it is compressed; write it with numpy.savez".into(),
            other => format!("array `{name}`: {other}"),
        })?;
        // Grows with the bytes read, not with the size that the archive states; the checksum is verified at the end.
        let mut bytes = Vec::new();
        member.read_to_end(&mut bytes).map_err(|e| format!("array `{name}` is damaged: {e}"))?;
        let (shape, start) = parse_header::<N>(&bytes, descr).map_err(|reason| format!("array `{name}`: {reason}"))?;
        Ok(Array { shape, items: bytes[start..].as_chunks::<N>().0.iter().map(|&b| item(b)).collect() })
    }
}

/// Shape of a whole .npy of type `descr`, items of `N` bytes, and where its data starts.
fn parse_header<const N: usize>(bytes: &[u8], descr: &str) -> Result<(Vec<usize>, usize), String> {
    let Some(&[low, high]) = bytes.strip_prefix(MAGIC).and_then(|rest| rest.first_chunk::<2>()) else {
        return Err("it is not a .npy of format 1.0".into());
    };
    let start = MAGIC.len() + 2 + usize::from(u16::from_le_bytes([low, high]));
    let text = bytes.get(MAGIC.len() + 2..start).map(String::from_utf8_lossy).ok_or("its header is cut off")?;
    if !text.contains(&format!("'{descr}'")) || !text.contains("'fortran_order': False") {
        return Err(format!("expected {descr} in C order"));
    }
    let shape = text.split_once("'shape': (").and_then(|(_, s)| s.split_once(')')).ok_or("it has no shape")?.0;
    let shape: Option<Vec<usize>> =
        shape.split(',').map(str::trim).filter(|n| !n.is_empty()).map(|n| n.parse().ok()).collect();
    let shape = shape.ok_or("its shape is not made of numbers")?;
    let expected = shape.iter().try_fold(N, |n, &k| n.checked_mul(k)).ok_or("its shape is too large")?;
    if bytes.len() - start != expected {
        return Err(format!("{} bytes where its shape needs {expected}", bytes.len() - start));
    }
    Ok((shape, start))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some() -> HexSamples {
        HexSamples {
            sensor: Size::new(40, 30),
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
        some().save(&path, false).unwrap();
        assert_eq!(HexSamples::load(&path).unwrap(), some());
        assert!(matches!(some().save(&path, false), Err(Error::Output(_))));
        // Saving twice gives the same bytes, and another implementation can read them.
        let again = dir.path().join("again.npz");
        some().save(&again, false).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), std::fs::read(&again).unwrap());
        let mut npz = ndarray_npy::NpzReader::new(File::open(&path).unwrap()).unwrap();
        let values: Array3<f32> = npz.by_name("values.npy").unwrap();
        assert_eq!(values, some().values);
        let sensor: ndarray::Array1<i32> = npz.by_name("sensor.npy").unwrap();
        assert_eq!(sensor.as_slice().unwrap(), &[40, 30]);
    }

    #[test]
    fn truncated_files_and_flipped_bytes_never_give_other_samples() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("samples.npz");
        some().save(&path, false).unwrap();
        let whole = std::fs::read(&path).unwrap();
        for n in (0..whole.len()).step_by(5) {
            std::fs::write(&path, &whole[..n]).unwrap();
            assert!(HexSamples::load(&path).is_err(), "{n} bytes");
        }
        for n in (0..whole.len()).step_by(5) {
            let mut bytes = whole.clone();
            bytes[n] ^= 0xff;
            std::fs::write(&path, &bytes).unwrap();
            // Either an error, or the byte has no meaning; never other samples.
            if let Ok(read) = HexSamples::load(&path) {
                assert_eq!(read, some(), "byte {n}");
            }
        }
    }

    #[test]
    fn files_of_the_first_writer_are_read() {
        // Written by version 0.1, before the archive came from a crate.
        let old: &[u8] = include_bytes!("../../tests/reference/golden-1-samples.npz");
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("samples.npz");
        std::fs::write(&path, old).unwrap();
        assert_eq!(HexSamples::load(&path).unwrap(), some());
    }

    #[test]
    fn arrays_that_contradict_each_other_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("samples.npz");
        let mut odd = some();
        odd.centres.pop();
        odd.save(&path, false).unwrap();
        assert!(HexSamples::load(&path).is_err());
    }
}
