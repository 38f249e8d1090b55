//! Views one at a time: where they are written to, and where they are read from.

use std::path::Path;

use ndarray::Array3;

use super::error::{Error, malformed};
use super::meta::Meta;

/// A light field being written, one view at a time, in any order; complete only after `finish`.
pub trait ViewSink: Send {
    /// Writes view (row `v`, column `u`, counted from 0), shape (t, s, c), values nominally 0..1.
    ///
    /// # Errors
    /// When the view cannot be encoded or written.
    fn write(&mut self, v: usize, u: usize, view: &Array3<f32>) -> Result<(), Error>;
    /// The folder under its temporary name, for files beside the views; `None` where the light field is a single file.
    fn folder(&self) -> Option<&Path> {
        None
    }
    /// Completes the light field under its final name.
    ///
    /// # Errors
    /// When views are missing or the result cannot be put in place.
    fn finish(self: Box<Self>) -> Result<(), Error>;
}

/// A light field being read, one view at a time.
pub trait ViewSource: Send + Sync {
    /// Its description.
    fn meta(&self) -> &Meta;
    /// What was assumed in reading it, a sentence each, for the user to see; usually nothing.
    fn notes(&self) -> &[String] {
        &[]
    }
    /// Bytes of the files that it is read from, where they are few.
    fn stored_bytes(&self) -> Option<u64> {
        None
    }
    /// Reads view (row `v`, column `u`), shape (t, s, c), values 0..1. Of a view whose weight is 0 because it is absent
    /// (see [`ReadOptions::partial`](super::ReadOptions)) all values are 0.
    ///
    /// # Errors
    /// When the view is missing or malformed.
    fn read(&self, v: usize, u: usize) -> Result<Array3<f32>, Error>;
}

/// Fails when a view was never written.
pub(super) fn check_all_written(written: &[bool], columns: usize) -> Result<(), Error> {
    match written.iter().position(|&w| !w) {
        None => Ok(()),
        Some(i) => {
            let missing = written.iter().filter(|&&w| !w).count();
            let (v, u) = (i / columns, i % columns);
            Err(Error::Parameter(format!("{missing} views were not written, the first is ({v}, {u})")))
        }
    }
}

/// Refuses values that are not numbers.
pub(super) fn check_finite(path: &Path, v: usize, u: usize, view: Array3<f32>) -> Result<Array3<f32>, Error> {
    let Some((first, _)) = view.indexed_iter().find(|(_, x)| !x.is_finite()) else { return Ok(view) };
    let count = view.iter().filter(|x| !x.is_finite()).count();
    let (t, s, c) = first;
    let reason = format!(
        "view ({v}, {u}) has {count} values that are not finite numbers, the first at row {t}, column {s}, channel {c}"
    );
    Err(malformed(path, reason))
}

/// Weights of views by their means of a weight channel: 1 for the largest. `None` where all are the same.
pub(super) fn relative_weights(means: &[f64]) -> Option<Vec<f32>> {
    let most = means.iter().copied().fold(0.0, f64::max);
    if !(most > 0.0 && most.is_finite()) || means.iter().all(|m| (m / most - 1.0).abs() < 1e-3) {
        return None;
    }
    Some(means.iter().map(|m| ((m / most) as f32).clamp(0.0, 1.0)).collect())
}
