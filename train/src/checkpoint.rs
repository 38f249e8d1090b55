//! Checkpoints: everything a run needs to go on as if it had never stopped, in one .npz file beside the output.

use std::fs::File;
use std::path::Path;

use lenslet_core::dictionary::{self, Dictionary};
use lenslet_core::output::Pending;
use ndarray::{Array1, Array2};
use ndarray_npy::{NpzReader, NpzWriter};
use serde::{Deserialize, Serialize};

use super::run::Epoch;
use super::{Error, Parameters, online, refine};

/// Where a run is within one pass.
#[derive(Debug, Clone)]
pub enum Stage {
    /// The atoms are being learned; epochs done.
    Learn(usize, online::State),
    /// Dl and Dh are being refined; epochs done.
    Refine(usize, refine::State),
}

/// A run's state after a whole epoch.
#[derive(Debug, Clone)]
pub struct Checkpoint {
    /// What the run was asked for, with the names of its inputs.
    pub key: Key,
    /// Finished models and, last, the unfinished one's finished passes; None before the first pass is finished.
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

fn wrong(path: &Path, reason: impl ToString) -> Error {
    Error::Checkpoint { path: path.display().to_string(), reason: reason.to_string() }
}

/// Writes a checkpoint in place of the one before.
///
/// # Errors
/// When it cannot be written.
pub fn save(path: &Path, checkpoint: &Checkpoint) -> Result<(), Error> {
    let pending = Pending::file(path, true)?;
    let file = File::create(pending.path()).map_err(|e| wrong(path, e))?;
    let mut npz = NpzWriter::new(file);
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
    let head = serde_json::to_vec(&head).map_err(|e| wrong(path, e))?;
    let put = |e: ndarray_npy::WriteNpzError| wrong(path, e);
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
            for (i, m) in s.moments.iter().enumerate() {
                npz.add_array(format!("moments{i}"), m).map_err(put)?;
            }
        }
    }
    let mut file = npz.finish().map_err(put)?;
    std::io::Write::flush(&mut file).map_err(|e| wrong(path, e))?;
    Ok(pending.commit()?)
}

/// Reads a checkpoint and checks that it belongs to `key`.
///
/// # Errors
/// When it is damaged, or was made with other parameters or photos.
pub fn load(path: &Path, key: &Key) -> Result<Checkpoint, Error> {
    let file = File::open(path).map_err(|e| wrong(path, e))?;
    let mut npz = NpzReader::new(file).map_err(|e| wrong(path, e))?;
    let get = |e: ndarray_npy::ReadNpzError| wrong(path, format!("{e}; start again without --resume"));
    let head: Array1<u8> = npz.by_name("head").map_err(get)?;
    let head: Head = serde_json::from_slice(&head.to_vec()).map_err(|e| wrong(path, e))?;
    if head.key != *key {
        let what = if head.key.parameters == key.parameters { "photos" } else { "parameters" };
        return Err(wrong(
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
        if good { Ok(()) } else { Err(wrong(path, "its matrices do not fit; start again without --resume")) }
    };
    let stage = match head.stage.as_str() {
        "learn" => {
            let atoms: Array2<f32> = npz.by_name("atoms").map_err(get)?;
            let a: Array2<f64> = npz.by_name("a").map_err(get)?;
            let b: Array2<f64> = npz.by_name("b").map_err(get)?;
            fits(a.dim() == (atoms.nrows(), atoms.nrows()) && b.dim() == atoms.dim())?;
            Some(Stage::Learn(head.epochs, online::State { atoms, a, b, batches: head.count }))
        }
        "refine" => {
            let low: Array2<f32> = npz.by_name("low").map_err(get)?;
            let high: Array2<f32> = npz.by_name("high").map_err(get)?;
            let mut moment = |i: usize| npz.by_name(&format!("moments{i}")).map_err(get);
            let moments: [Array2<f32>; 4] = [moment(0)?, moment(1)?, moment(2)?, moment(3)?];
            fits(moments[0].dim() == low.dim() && moments[1].dim() == low.dim())?;
            fits(moments[2].dim() == high.dim() && moments[3].dim() == high.dim() && low.nrows() == high.nrows())?;
            Some(Stage::Refine(head.epochs, refine::State { low, high, moments, steps: head.count }))
        }
        _ => None,
    };
    Ok(Checkpoint { key: head.key, done, at: head.at, stage, trace: head.trace })
}
