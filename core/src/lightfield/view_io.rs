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
    /// Reads view (row `v`, column `u`), shape (t, s, c), values 0..1.
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
    if view.iter().all(|x| x.is_finite()) {
        Ok(view)
    } else {
        Err(malformed(path, format!("view ({v}, {u}) has values that are not finite numbers")))
    }
}
