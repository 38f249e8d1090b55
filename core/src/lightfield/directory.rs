//! Lenslet's directory (`docs/file-formats.md`): `lightfield.json` and `view_VV_UU.png`, 16 bit, row v, column u, from
//! 00. A view whose weight is 0 may be absent.

use std::collections::HashSet;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use ndarray::Array3;

use super::error::{Error, absent, io_at, malformed, unsupported};
use super::format::ReadOptions;
use super::image_file;
use super::meta::Meta;
use super::view_io::{Numbering, ViewSink, ViewSource, check_all_written, name_places, tell_absent};
use super::write_queue::WriteQueue;
use crate::input::read_regular;
use crate::output::{Pending, write_part};

/// Name of the description.
pub(super) const DESCRIPTION: &str = "lightfield.json";
/// Largest description that is read, bytes.
const MAX_DESCRIPTION: u64 = 4 << 20;

fn view_name(v: usize, u: usize) -> String {
    format!("view_{v:02}_{u:02}.png")
}

/// Writes views as they come; encoding happens on the rayon pool.
pub(super) struct Writer {
    meta: Meta,
    written: Vec<bool>,
    // Dropped after `queue` has been waited for (see Drop), so no job writes into a folder being removed.
    pending: Option<Pending>,
    queue: WriteQueue,
}

impl Writer {
    pub(super) fn create(path: &Path, meta: Meta, force: bool) -> Result<Self, Error> {
        let pending = Pending::directory(path, force)?;
        let written = vec![false; meta.views[0] * meta.views[1]];
        Ok(Writer { meta, written, pending: Some(pending), queue: WriteQueue::new() })
    }
}

impl ViewSink for Writer {
    fn write(&mut self, v: usize, u: usize, view: &Array3<f32>) -> Result<(), Error> {
        self.meta.check_view(v, u, view)?;
        let Some(pending) = &self.pending else { return Err(Error::Parameter("light field is finished".into())) };
        let path = pending.path().join(view_name(v, u));
        let samples = image_file::to_sixteen_bits(view);
        let (height, width, channels) = view.dim();
        self.written[v * self.meta.views[1] + u] = true;
        self.queue.submit(move || {
            let png = image_file::encode_png(&samples, width, height, channels, None, &path)?;
            write_part(&path, &png).map_err(io_at(&path))
        })
    }

    fn folder(&self) -> Option<&Path> {
        self.pending.as_ref().map(Pending::path)
    }

    fn finish(mut self: Box<Self>) -> Result<(), Error> {
        self.queue.wait()?;
        check_all_written(&self.written, &self.meta)?;
        let Some(pending) = self.pending.take() else { return Ok(()) };
        let path = pending.path().join(DESCRIPTION);
        let text = serde_json::to_string_pretty(&self.meta)
            .map_err(|e| Error::Parameter(format!("cannot describe the light field: {e}")))?;
        write_part(&path, (text + "\n").as_bytes()).map_err(io_at(&path))?;
        Ok(pending.commit()?)
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        // Only an abandoned writer still has jobs; their errors do not matter.
        let _ = self.queue.wait();
    }
}

/// Reads lenslet's directory.
pub(super) struct Reader {
    folder: PathBuf,
    meta: Meta,
    /// Bytes of the pictures.
    stored: u64,
    /// Places without a picture, row by row.
    absent: Vec<usize>,
    notes: Vec<String>,
}

impl Reader {
    pub(super) fn open(folder: &Path, options: &ReadOptions) -> Result<Self, Error> {
        let path = folder.join(DESCRIPTION);
        let bytes = read_regular(&path, MAX_DESCRIPTION).map_err(io_at(&path))?;
        let value: serde_json::Value =
            serde_json::from_slice(&bytes).map_err(|e| malformed(&path, format!("not a description: {e}")))?;
        if let Some(version) = value.get("version").and_then(serde_json::Value::as_u64)
            && version != 1
        {
            let reason =
                format!("format version {version}, but only version 1 is known here; a newer lenslet may read it");
            return Err(unsupported(&path, reason));
        }
        let meta: Meta =
            serde_json::from_value(value).map_err(|e| malformed(&path, format!("not a description: {e}")))?;
        meta.check().map_err(|e| malformed(&path, e.to_string()))?;
        let (stored, absent) = check_pictures(folder, &meta).map_err(|reason| malformed(&path, reason))?;
        let mut notes = Vec::new();
        if !absent.is_empty() {
            notes.push(format!("{}: {}", folder.display(), tell_absent(folder, &meta, &absent, options.partial)?));
        }
        Ok(Reader { folder: folder.to_path_buf(), meta, stored, absent, notes })
    }
}

/// Compares the description with the pictures' headers: every view that has a weight is there, all are of the size and
/// channels described, and there are no more of them. Bytes of the pictures together, and the places without one.
fn check_pictures(folder: &Path, meta: &Meta) -> Result<(u64, Vec<usize>), String> {
    let [rows, columns] = meta.views;
    let (height, width, channels) = meta.view_shape();
    let described = format!("it describes {rows}x{columns} views of {width}x{height}");
    let entries = std::fs::read_dir(folder).map_err(|e| e.to_string())?;
    let there: HashSet<OsString> = entries.flatten().map(|entry| entry.file_name()).collect();
    let is_there = |k: &usize| there.contains(OsStr::new(&view_name(k / columns, k % columns)));
    let absent: Vec<usize> = (0..rows * columns).filter(|k| !is_there(k)).collect();
    let lost: Vec<usize> = absent.iter().copied().filter(|&k| meta.weight(k) > 0.0).collect();
    if let Some(first) = lost.first() {
        let name = view_name(first / columns, first % columns);
        return Err(format!(
            "{described}, but {} of them are not there ({name}: {}): copy them again, or take {DESCRIPTION} away, so that the \
             pictures count by their names and the others as absent",
            lost.len(),
            name_places(&lost, columns)
        ));
    }
    if absent.len() == rows * columns {
        return Err(format!("{described}, but none is there"));
    }
    let mut stored = 0;
    for k in (0..rows * columns).filter(|k| absent.binary_search(k).is_err()) {
        let path = folder.join(view_name(k / columns, k % columns));
        let shape = image_file::read_shape(&path).map_err(|e| format!("{described}, but {e}"))?;
        if (shape.height, shape.width) != (height, width) {
            let name = path.display();
            return Err(format!("{described}, but {name} has {}x{} pixels", shape.width, shape.height));
        }
        // A grey view among coloured ones has three equal channels.
        if shape.channels > channels {
            return Err(format!("it describes views of 1 channel, but {} has {}", path.display(), shape.channels));
        }
        stored += std::fs::metadata(&path).map_or(0, |m| m.len());
    }
    for (v, u) in [(rows, 0), (0, columns)] {
        let more = view_name(v, u);
        if folder.join(&more).is_file() {
            return Err(format!("{described}, but there is also {more}"));
        }
    }
    Ok((stored, absent))
}

impl ViewSource for Reader {
    fn meta(&self) -> &Meta {
        &self.meta
    }

    fn numbering(&self) -> Numbering {
        Numbering::Described
    }

    fn stored_bytes(&self) -> Option<u64> {
        Some(self.stored)
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn is_absent(&self, v: usize, u: usize) -> Result<bool, Error> {
        self.meta.check_place(v, u)?;
        Ok(self.absent.binary_search(&(v * self.meta.views[1] + u)).is_ok())
    }

    fn read(&self, v: usize, u: usize) -> Result<Array3<f32>, Error> {
        if self.is_absent(v, u)? {
            return Err(absent(&self.folder, v, u));
        }
        let path = self.folder.join(view_name(v, u));
        image_file::read_view(&path, &self.meta)
    }
}
