//! Views one at a time: where they are written to, and where they are read from.

use std::path::Path;

use ndarray::Array3;

use super::error::{Error, malformed, unsupported};
use super::meta::Meta;
use super::view_order::ReadOrder;

/// A light field being written, one view at a time, in any order; complete only after `finish`. Views whose weight is 0
/// may be left out: they are absent then.
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

/// What the numbers of views rest on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Numbering {
    /// A description of this project: they are rows and columns.
    Described,
    /// Two numbers a view, in names or as axes of an array.
    Pairs,
    /// One running number.
    Running,
}

/// A light field being read, one view at a time.
pub trait ViewSource: Send + Sync {
    /// Its description.
    fn meta(&self) -> &Meta;
    /// What was assumed in reading it, a sentence each, for the user to see; usually nothing.
    fn notes(&self) -> &[String] {
        &[]
    }
    /// What its numbers of views rest on.
    fn numbering(&self) -> Numbering;
    /// The order that its views are stored in, where it was stated or looked for; they are read in this project's.
    fn order(&self) -> Option<ReadOrder> {
        None
    }
    /// Bytes of the files that it is read from, where they are few.
    fn stored_bytes(&self) -> Option<u64> {
        None
    }
    /// Whether view (row `v`, column `u`) is absent (see [`ReadOptions::partial`](super::ReadOptions)): it has no picture,
    /// or in an array weight 0 and nothing but zeros.
    ///
    /// # Errors
    /// When this cannot be told because the view cannot be read.
    fn is_absent(&self, v: usize, u: usize) -> Result<bool, Error> {
        let meta = self.meta();
        meta.check_place(v, u)?;
        Ok(meta.weight(v * meta.views[1] + u) <= 0.0 && self.read(v, u)?.iter().all(|x| *x == 0.0))
    }
    /// Reads view (row `v`, column `u`), shape (t, s, c), values 0..1.
    ///
    /// # Errors
    /// When the view is absent ([`Error::Absent`]; of an array its zeros are read) or malformed.
    fn read(&self, v: usize, u: usize) -> Result<Array3<f32>, Error>;
}

/// Fails when a view was never written that has a weight.
pub(super) fn check_all_written(written: &[bool], meta: &Meta) -> Result<(), Error> {
    let lacks = |k: usize| !written[k] && meta.weight(k) > 0.0;
    match (0..written.len()).find(|&k| lacks(k)) {
        None => Ok(()),
        Some(i) => {
            let missing = (0..written.len()).filter(|&k| lacks(k)).count();
            let (v, u) = (i / meta.views[1], i % meta.views[1]);
            Err(Error::Parameter(format!("{missing} views were not written, the first is ({v}, {u})")))
        }
    }
}

/// Names in messages.
/// Source: chosen.
const FEW: usize = 4;

/// The first of some places (row by row) in a grid of `columns`, for messages.
pub(super) fn name_places(places: &[usize], columns: usize) -> String {
    let some: Vec<String> =
        places.iter().take(FEW).map(|k| format!("row {}, column {}", k / columns, k % columns)).collect();
    format!("{}{}", some.join("; "), if places.len() > FEW { "; …" } else { "" })
}

/// What is said of the absent views of a light field, and the refusal where all are needed.
pub(super) fn tell_absent(path: &Path, meta: &Meta, places: &[usize], partial: bool) -> Result<String, Error> {
    let [rows, columns] = meta.views;
    let missing = format!("{} views of {rows}x{columns} are missing ({})", places.len(), name_places(places, columns));
    if partial {
        Ok(format!("{missing}; the others are used"))
    } else {
        Err(unsupported(path, format!("{missing}; all are needed here")))
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
