//! Checkpoints: everything a run needs to go on as if it had never stopped, in one file beside the output: a .npz and,
//! after it, the SHA-256 of its bytes. The arrays are read only where it matches.

use std::io::Cursor;
use std::path::Path;

use lenslet_core::dictionary::{self, Dictionary};
use lenslet_core::input::read_regular;
use lenslet_core::output;
use ndarray::{Array1, Array2, Ix2};
use ndarray_npy::{NpzReader, NpzWriter};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::error::Error;
use crate::online::OnlineState;
use crate::optimiser::Adam;
use crate::parameters::Parameters;
use crate::refine::RefinementState;
use crate::trace::Epoch;

/// Longest checkpoint that is read, bytes.
/// Source: chosen; a thousand times that of the default dictionary.
const MAX_BYTES: u64 = 8 << 30;
/// Bytes of the checksum at the end.
const CHECKSUM: usize = 32;

/// Where a run is within one pass.
#[derive(Debug, Clone)]
pub enum Stage {
    /// The atoms are being learned; epochs done.
    Learn(usize, OnlineState),
    /// Dl and Dh are being refined; epochs done.
    Refine(usize, RefinementState),
}

/// A run's state after a whole epoch.
#[derive(Debug, Clone)]
pub struct Checkpoint {
    /// Parameters and inputs of the run.
    pub key: Key,
    /// Finished models; `None` before the first one.
    pub done: Option<Dictionary>,
    /// Models finished, and passes of the current one.
    pub at: (usize, usize),
    /// The current stage, None at the beginning of a pass.
    pub stage: Option<Stage>,
    /// Epochs so far.
    pub trace: Vec<Epoch>,
}

/// What must agree between a checkpoint and the run that goes on from it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Key {
    /// Version of the checkpoint's layout.
    pub version: u32,
    /// All parameters.
    pub parameters: Parameters,
    /// Photo files with their hashes.
    pub photos: Vec<dictionary::Photo>,
}

#[derive(Serialize, Deserialize)]
struct Head {
    key: Key,
    at: (usize, usize),
    stage: String,
    epochs: usize,
    count: u64,
    trace: Vec<Epoch>,
}

fn unusable(path: &Path, reason: impl ToString) -> Error {
    Error::Checkpoint { path: path.display().to_string(), reason: reason.to_string() }
}

/// Writes a checkpoint in place of the one before.
///
/// # Errors
/// When it cannot be written.
pub fn save_checkpoint(path: &Path, checkpoint: &Checkpoint) -> Result<(), Error> {
    let mut npz = NpzWriter::new(Cursor::new(Vec::new()));
    let (stage, epochs, count) = match &checkpoint.stage {
        None => ("none", 0, 0),
        Some(Stage::Learn(n, s)) => ("learn", *n, s.batches),
        Some(Stage::Refine(n, s)) => ("refine", *n, s.steps),
    };
    let head = Head {
        key: checkpoint.key.clone(),
        at: checkpoint.at,
        stage: stage.into(),
        epochs,
        count,
        trace: checkpoint.trace.clone(),
    };
    let head = serde_json::to_vec(&head).map_err(|e| unusable(path, e))?;
    let put = |e: ndarray_npy::WriteNpzError| unusable(path, e);
    let mark = format!("{{\"tool\":\"lenslet {}\"}}", env!("CARGO_PKG_VERSION"));
    npz.add_array(output::NPZ_MARK, &Array1::from_vec(mark.into_bytes())).map_err(put)?;
    npz.add_array("head", &Array1::from_vec(head)).map_err(put)?;
    if let Some(done) = &checkpoint.done {
        npz.add_array("done", &Array1::from_vec(dictionary::to_bytes(done)?)).map_err(put)?;
    }
    match &checkpoint.stage {
        None => {}
        Some(Stage::Learn(_, s)) => {
            npz.add_array("atoms", &s.atoms).map_err(put)?;
            npz.add_array("a", &s.a).map_err(put)?;
            npz.add_array("b", &s.b).map_err(put)?;
        }
        Some(Stage::Refine(_, s)) => {
            npz.add_array("low", &s.low).map_err(put)?;
            npz.add_array("high", &s.high).map_err(put)?;
            let moments = [&s.low_moments.first, &s.low_moments.second, &s.high_moments.first, &s.high_moments.second];
            for (i, m) in moments.into_iter().enumerate() {
                npz.add_array(format!("moments{i}"), m).map_err(put)?;
            }
        }
    }
    let mut bytes = npz.finish().map_err(put)?.into_inner();
    let checksum = Sha256::digest(&bytes);
    bytes.extend_from_slice(&checksum);
    Ok(output::write_file(path, true, &bytes)?)
}

/// Reads a checkpoint and checks that it belongs to `key`.
///
/// # Errors
/// When it is damaged, or was made with other parameters or photos.
pub fn load_checkpoint(path: &Path, key: &Key) -> Result<Checkpoint, Error> {
    let bytes = read_regular(path, MAX_BYTES).map_err(|e| unusable(path, e))?;
    let whole =
        bytes.split_last_chunk::<CHECKSUM>().filter(|(body, checksum)| Sha256::digest(body)[..] == checksum[..]);
    let Some((body, _)) = whole else {
        return Err(unusable(path, "it is damaged, or of an earlier version; start again without --resume"));
    };
    let mut npz = NpzReader::new(Cursor::new(body)).map_err(|e| unusable(path, e))?;
    let get = |e: ndarray_npy::ReadNpzError| unusable(path, format!("{e}; start again without --resume"));
    let head: Array1<u8> = npz.by_name("head").map_err(get)?;
    let head: Head = serde_json::from_slice(&head.to_vec()).map_err(|e| unusable(path, e))?;
    if head.key != *key {
        let what = if head.key.parameters == key.parameters { "photos" } else { "parameters" };
        return Err(unusable(
            path,
            format!("it was made with other {what}; give the same ones, or start without --resume"),
        ));
    }
    let names = npz.names().map_err(get)?;
    let done = if names.iter().any(|n| n == "done") {
        let bytes: Array1<u8> = npz.by_name("done").map_err(get)?;
        Some(dictionary::from_bytes(&bytes.to_vec(), &path.display().to_string())?)
    } else {
        None
    };
    let fits = |good: bool| {
        if good { Ok(()) } else { Err(unusable(path, "its matrices do not fit; start again without --resume")) }
    };
    let stage = match head.stage.as_str() {
        "learn" => {
            let atoms: Array2<f32> = npz.by_name("atoms").map_err(get)?;
            let a: Array2<f64> = npz.by_name("a").map_err(get)?;
            let b: Array2<f64> = npz.by_name("b").map_err(get)?;
            fits(a.dim() == (atoms.nrows(), atoms.nrows()) && b.dim() == atoms.dim())?;
            Some(Stage::Learn(head.epochs, OnlineState { atoms, a, b, batches: head.count }))
        }
        "refine" => {
            let low: Array2<f32> = npz.by_name("low").map_err(get)?;
            let high: Array2<f32> = npz.by_name("high").map_err(get)?;
            let mut moment = |i: usize| npz.by_name(&format!("moments{i}")).map_err(get);
            let low_moments: Adam<Ix2> = Adam { first: moment(0)?, second: moment(1)? };
            let high_moments: Adam<Ix2> = Adam { first: moment(2)?, second: moment(3)? };
            fits(low_moments.first.dim() == low.dim() && low_moments.second.dim() == low.dim())?;
            fits(high_moments.first.dim() == high.dim() && high_moments.second.dim() == high.dim())?;
            fits(low.nrows() == high.nrows())?;
            let state = RefinementState { low, high, low_moments, high_moments, steps: head.count };
            Some(Stage::Refine(head.epochs, state))
        }
        _ => None,
    };
    Ok(Checkpoint { key: head.key, done, at: head.at, stage, trace: head.trace })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The key that a checkpoint was written with: the defaults of that time.
    fn key_of(path: &Path) -> Key {
        let bytes = std::fs::read(path).unwrap();
        let mut npz = NpzReader::new(Cursor::new(&bytes[..bytes.len() - CHECKSUM])).unwrap();
        let head: Array1<u8> = npz.by_name("head").unwrap();
        serde_json::from_slice::<Head>(&head.to_vec()).unwrap().key
    }

    /// The beginning of the SHA-256 of values, little-endian, row by row.
    fn hashed(values: impl IntoIterator<Item = Vec<u8>>) -> String {
        let mut hash = Sha256::new();
        values.into_iter().for_each(|bytes| hash.update(bytes));
        hash.finalize()[..8].iter().map(|b| format!("{b:02x}")).collect()
    }

    /// Checkpoints of the first layout, one of each stage, of runs of six atoms that were killed: they can go on now. The
    /// hashes are those of the arrays as NumPy reads them.
    #[test]
    fn earlier_checkpoints_are_read() {
        let read = |name: &str, trace: usize| {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("reference").join(name);
            let key = key_of(&path);
            assert_eq!((key.version, key.parameters.seed, key.photos.len()), (1, 7, 4), "{name}");
            let read = load_checkpoint(&path, &key).unwrap();
            assert_eq!((read.at, read.trace.len(), read.done.is_none()), ((0, 0), trace, true), "{name}");
            read.stage.unwrap()
        };
        let single = |a: &Array2<f32>| hashed(a.iter().map(|v| v.to_le_bytes().to_vec()));
        let double = |a: &Array2<f64>| hashed(a.iter().map(|v| v.to_le_bytes().to_vec()));
        let Stage::Learn(3, s) = read("golden-1-learn.checkpoint", 3) else { panic!("another stage") };
        assert_eq!((s.atoms.dim(), s.batches), ((6, 5), 21));
        assert_eq!(single(&s.atoms), "fa0f0e1ebb181238");
        assert_eq!((double(&s.a).as_str(), double(&s.b).as_str()), ("91c6d859eb5f62e4", "1944f5a451e8f193"));
        let Stage::Refine(1, s) = read("golden-1-refine.checkpoint", 4) else { panic!("another stage") };
        assert_eq!((s.low.dim(), s.high.dim(), s.steps), ((6, 5), (6, 9), 7));
        assert_eq!((single(&s.low).as_str(), single(&s.high).as_str()), ("71e39681dce9e9de", "ce80a3c6765ecd71"));
        let [low, high] = [&s.low_moments, &s.high_moments].map(|m| (single(&m.first), single(&m.second)));
        assert_eq!((low.0.as_str(), low.1.as_str()), ("79774d125eb49b11", "528333b555a4c25b"));
        assert_eq!((high.0.as_str(), high.1.as_str()), ("4cc72ed78704c292", "232042f5f57c2cac"));
    }

    #[test]
    fn what_is_cut_off_or_changed_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.checkpoint");
        let key = Key { version: 1, parameters: Parameters::default(), photos: Vec::new() };
        let atoms = Array2::from_shape_fn((5, 7), |(r, c)| (r * 7 + c) as f32);
        let state = OnlineState { atoms: atoms.clone(), a: Array2::eye(5), b: Array2::zeros((5, 7)), batches: 3 };
        let whole =
            Checkpoint { key: key.clone(), done: None, at: (0, 0), stage: Some(Stage::Learn(2, state)), trace: vec![] };
        save_checkpoint(&path, &whole).unwrap();
        let Some(Stage::Learn(2, read)) = load_checkpoint(&path, &key).unwrap().stage else { panic!("another stage") };
        assert_eq!((read.atoms, read.batches), (atoms, 3));
        let bytes = std::fs::read(&path).unwrap();
        let refused = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            let error = load_checkpoint(&path, &key).unwrap_err().to_string();
            assert!(error.contains("a.checkpoint") && error.contains("--resume"), "{error}");
        };
        for n in 0..bytes.len() {
            refused(&bytes[..n]);
            let mut changed = bytes.clone();
            changed[n] ^= 1 << (n % 8);
            refused(&changed);
        }
    }
}
