//! NumPy's .npy (format 1.0 to 3.0): written as one f32 array (v, u, t, s, c), views streamed to their places;
//! read with 2 to 5 dimensions, f32, f64, u8 or u16, in C or Fortran order. Its description stands beside it
//! (`NAME.npy.json`).

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use ndarray::Array3;

use super::axes::{ArrayLayout, lay_out};
use super::block::{BlockLayout, SampleBlock};
use super::colour::ColourSpace;
use super::companion::{Companion, MAX_TEXT, companion_path, fingerprint_of_file};
use super::error::{Error, io_at, malformed, unsupported};
use super::format::ReadOptions;
use super::meta::Meta;
use super::sample::{SampleFormat, SampleKind};
use super::value_range::{Extent, full_scale};
use super::view_io::{Numbering, ViewSink, ViewSource, check_all_written, check_finite, relative_weights};
use super::write_queue::WriteQueue;
use crate::input::{open_regular, read_regular};
use crate::output::{NPY_HEADER, Pending, write_at};

/// First bytes of every .npy.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";
/// Longest header that is read, bytes (NumPy's own limit is 10000).
const MAX_HEADER: u64 = 1 << 16;

/// Writes views to their places in the file as they come.
pub(super) struct Writer {
    meta: Meta,
    written: Vec<bool>,
    data_start: u64,
    /// The array, and its description beside it.
    pending: Option<[Pending; 2]>,
    queue: WriteQueue,
}

impl Writer {
    pub(super) fn create(path: &Path, meta: Meta, force: bool) -> Result<Self, Error> {
        let pending = Pending::file(path, force)?;
        // A description that lenslet wrote is nothing without its array: one that is left is replaced, any other file kept.
        let beside = Pending::file(&companion_path(path), true)?;
        let (t, s, c) = meta.view_shape();
        let head = header_bytes(&[meta.views[0], meta.views[1], t, s, c]);
        let mut file = pending.handle()?;
        file.write_all(&head).map_err(io_at(path))?;
        let data = (meta.views[0] * meta.views[1]) as u64 * (t * s * c) as u64 * 4;
        file.set_len(head.len() as u64 + data).map_err(io_at(path))?;
        let written = vec![false; meta.views[0] * meta.views[1]];
        Ok(Writer {
            meta,
            written,
            data_start: head.len() as u64,
            pending: Some([pending, beside]),
            queue: WriteQueue::new(),
        })
    }
}

/// A version 1.0 header for a C-ordered little-endian f32 array, padded to the length by which lenslet's own files are
/// recognised (a multiple of 64, as NumPy asks for).
fn header_bytes(shape: &[usize]) -> Vec<u8> {
    let shape: Vec<String> = shape.iter().map(usize::to_string).collect();
    let text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}), }}", shape.join(", "));
    let whole = (10 + text.len() + 1).next_multiple_of(64).max(NPY_HEADER);
    let mut head = MAGIC.to_vec();
    head.extend([1, 0]);
    head.extend(((whole - 10) as u16).to_le_bytes());
    head.extend(text.as_bytes());
    head.resize(whole - 1, b' ');
    head.push(b'\n');
    head
}

impl ViewSink for Writer {
    fn write(&mut self, v: usize, u: usize, view: &Array3<f32>) -> Result<(), Error> {
        self.meta.check_view(v, u, view)?;
        let Some([pending, _]) = &self.pending else { return Err(Error::Parameter("light field is finished".into())) };
        let (file, path) = (pending.handle()?, pending.path().to_path_buf());
        let mut bytes = vec![0; 4 * view.len()];
        match view.as_slice() {
            Some(values) => {
                for (to, x) in bytes.as_chunks_mut().0.iter_mut().zip(values) {
                    *to = x.to_le_bytes();
                }
            }
            None => {
                for (to, x) in bytes.as_chunks_mut().0.iter_mut().zip(view) {
                    *to = x.to_le_bytes();
                }
            }
        }
        let index = v * self.meta.views[1] + u;
        let place = self.data_start + index as u64 * bytes.len() as u64;
        self.written[index] = true;
        self.queue.submit(move || write_at(&file, &bytes, place).map_err(io_at(&path)))
    }

    fn finish(mut self: Box<Self>) -> Result<(), Error> {
        self.queue.wait()?;
        check_all_written(&self.written, &self.meta)?;
        let Some([pending, beside]) = self.pending.take() else { return Ok(()) };
        let (t, s, c) = self.meta.view_shape();
        let length = 4 * (self.written.len() * t * s * c) as u64;
        let fingerprint = fingerprint_of_file(pending.path(), self.data_start, length)?;
        let text = Companion::new(&self.meta, fingerprint).to_text()?;
        beside.write((text + "\n").as_bytes())?;
        // First, so that an array that is there has its description; one of other numbers is left alone.
        beside.commit()?;
        Ok(pending.commit()?)
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        // Only an abandoned writer still has jobs; their errors do not matter.
        let _ = self.queue.wait();
    }
}

/// Reads a .npy as a light field: view by view where views are stored whole, else from memory.
pub(super) struct Reader {
    path: PathBuf,
    meta: Meta,
    number: SampleFormat,
    scale: f32,
    start: u64,
    layout: ArrayLayout,
    whole: Option<SampleBlock>,
    notes: Vec<String>,
    numbering: Numbering,
    length: u64,
}

impl Reader {
    pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<Self, Error> {
        let (mut file, length) = open_regular(path).map_err(io_at(path))?;
        let (text, start) = read_header(&mut file, path)?;
        let header = parse_header(&text).map_err(|reason| malformed(path, format!("not a .npy header: {reason}")))?;
        let number = sample_format(&header.descr).ok_or_else(|| {
            unsupported(path, format!("numbers of type {}; save the array as float32 or uint16", header.descr))
        })?;
        let Some(usual) = number.kind.full_scale() else {
            return Err(unsupported(path, format!("numbers of type {}", header.descr)));
        };
        let layout = lay_out(&header.shape, header.fortran, options.axes.as_ref(), options.views)
            .map_err(|reason| unsupported(path, reason))?;
        let (views, size) = (layout.views, layout.size);
        let meta = Meta::new(views, size, layout.channels(), options.colour.unwrap_or(ColourSpace::Srgb));
        meta.check().map_err(|e| unsupported(path, e.to_string()))?;
        // Meta::check bounds every factor, so the product stays far below 2^64.
        let values = (views[0] * views[1]) as u64 * (size[0] * size[1] * layout.stored) as u64;
        let bytes = values * number.kind.bytes() as u64;
        if length < start + bytes {
            let expected = start + bytes;
            return Err(malformed(path, format!("ends early: {length} bytes, its header needs {expected}")));
        }
        let path = path.to_path_buf();
        let (notes, numbering) = (Vec::new(), Numbering::Pairs);
        let mut reader =
            Reader { path, meta, number, scale: usual, start, layout, whole: None, notes, numbering, length };
        reader.describe(bytes, options)?;
        if !options.header_only {
            reader.examine(&header, values, options)?;
        }
        Ok(reader)
    }

    /// Takes over the description beside the array, if it belongs to it.
    fn describe(&mut self, bytes: u64, options: &ReadOptions) -> Result<(), Error> {
        let beside = companion_path(&self.path);
        let own = self.path.display().to_string();
        // Arrays of one view, maps and masks among them, usually have none.
        let assumed = || {
            let colour = "sRGB-encoded values (--input-linear if they are linear light), no known pitch or method";
            format!("{own}: no description beside it ({}); assumed: {colour}", beside.display())
        };
        if options.axes.is_some() || !beside.is_file() {
            if options.colour.is_none() && self.meta.views != [1, 1] {
                self.notes.push(assumed());
            }
            return Ok(());
        }
        let text = read_regular(&beside, MAX_TEXT).map_err(|e| e.to_string());
        let found = text.and_then(|text| Companion::from_text(&text)).and_then(|found| {
            let fingerprint = fingerprint_of_file(&self.path, self.start, bytes).map_err(|e| e.to_string())?;
            found.of(&self.meta, &fingerprint)
        });
        match found {
            Ok(meta) => (self.meta, self.numbering) = (meta, Numbering::Described),
            Err(why) => {
                let text = format!("{own}: the description {} is left alone: {why}", beside.display());
                self.notes.push(text);
                self.notes.push(assumed());
            }
        }
        Ok(())
    }

    /// Looks at the numbers: which of them is 1.0, whether all are numbers, what the fourth channel weighs.
    fn examine(&mut self, header: &Header, values: u64, options: &ReadOptions) -> Result<(), Error> {
        let ArrayLayout { strides, stored, .. } = self.layout;
        let mut whole = if self.layout.has_whole_views() {
            None
        } else {
            let layout = BlockLayout { strides, number: self.number, scale: 1.0 };
            Some(SampleBlock::read(&self.path, self.start, values, layout)?)
        };
        let mut extent = Extent::default();
        // A fourth channel is a weight, on whatever scale.
        let mut weights = Vec::new();
        if stored == 4 {
            let [rows, columns] = self.meta.views;
            let (t, s, _) = self.meta.view_shape();
            for k in 0..rows * columns {
                let view = self.stored_view(k / columns, k % columns, whole.as_ref(), (t, s, 4))?;
                let mut sum = 0.0;
                for pixel in view.chunks_exact(4 * self.number.kind.bytes()) {
                    let (colour, weight) = pixel.split_at(3 * self.number.kind.bytes());
                    extent.add(self.number, colour);
                    sum += self.number.read(weight);
                }
                weights.push(sum / (t * s) as f64);
            }
        } else if let Some(whole) = &whole {
            extent.add(self.number, whole.bytes());
        } else if Extent::matters(self.number.kind) {
            let (mut file, _) = open_regular(&self.path).map_err(io_at(&self.path))?;
            file.seek(SeekFrom::Start(self.start)).map_err(io_at(&self.path))?;
            let mut left = values * self.number.kind.bytes() as u64;
            let mut buffer = vec![0; 1 << 20];
            while left > 0 {
                let part = &mut buffer[..left.min(1 << 20) as usize];
                file.read_exact(part).map_err(io_at(&self.path))?;
                extent.add(self.number, part);
                left -= part.len() as u64;
            }
        }
        if Extent::matters(self.number.kind) || options.full_scale.is_some() {
            let place = |k: u64| place_in(k, header, stored);
            let (scale, note) = full_scale(&self.path, self.number.kind, &extent, options.full_scale, place)?;
            self.scale = scale;
            self.notes.extend(note);
        }
        if let Some(block) = &mut whole {
            block.set_scale(self.scale);
        }
        self.whole = whole;
        if self.meta.weights.is_none() {
            self.meta.weights = relative_weights(&weights);
        }
        Ok(())
    }

    /// A view's bytes as stored, channels last.
    fn stored_view(
        &self,
        v: usize,
        u: usize,
        whole: Option<&SampleBlock>,
        (t, s, c): (usize, usize, usize),
    ) -> Result<Vec<u8>, Error> {
        if let Some(whole) = whole {
            return Ok(whole.stored_view(v, u, (t, s, c)));
        }
        let width = self.number.kind.bytes();
        let [step_v, step_u, ..] = self.layout.strides;
        let at = self.start + ((v * step_v + u * step_u) * width) as u64;
        let (mut file, _) = open_regular(&self.path).map_err(io_at(&self.path))?;
        file.seek(SeekFrom::Start(at)).map_err(io_at(&self.path))?;
        let mut buffer = vec![0; t * s * c * width];
        file.read_exact(&mut buffer).map_err(io_at(&self.path))?;
        Ok(buffer)
    }
}

/// Index of number `k` of those looked at, as NumPy counts.
fn place_in(k: u64, header: &Header, stored: usize) -> String {
    // Of arrays with a weight three of four numbers were looked at, in the order of views.
    let mut k = if stored == 4 { k / 3 * 4 + k % 3 } else { k };
    let mut index = vec![0; header.shape.len()];
    let order: Vec<usize> =
        if header.fortran && stored != 4 { (0..index.len()).collect() } else { (0..index.len()).rev().collect() };
    for i in order {
        let side = header.shape[i].max(1) as u64;
        index[i] = k % side;
        k /= side;
    }
    format!("{index:?}")
}

impl ViewSource for Reader {
    fn meta(&self) -> &Meta {
        &self.meta
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn numbering(&self) -> Numbering {
        self.numbering
    }

    fn stored_bytes(&self) -> Option<u64> {
        Some(self.length)
    }

    fn read(&self, v: usize, u: usize) -> Result<Array3<f32>, Error> {
        self.meta.check_place(v, u)?;
        let (t, s, c) = self.meta.view_shape();
        let view = match &self.whole {
            Some(whole) => whole.view(v, u, (t, s, c)),
            None => {
                let stored = self.layout.stored;
                let buffer = self.stored_view(v, u, None, (t, s, stored))?;
                let mut values = self.number.read_all(&buffer, self.scale);
                if stored != c {
                    values = values.chunks_exact(stored).flat_map(|p| p[..c].iter().copied()).collect();
                }
                Array3::from_shape_vec((t, s, c), values).map_err(|e| malformed(&self.path, e.to_string()))?
            }
        };
        check_finite(&self.path, v, u, view)
    }
}

struct Header {
    descr: String,
    fortran: bool,
    shape: Vec<usize>,
}

/// The header's text and where the data starts.
fn read_header(file: &mut File, path: &Path) -> Result<(String, u64), Error> {
    let mut fixed = [0; 8];
    let short = |_| malformed(path, "ends within its header");
    file.read_exact(&mut fixed).map_err(short)?;
    let (length, start) = match (fixed.starts_with(MAGIC), fixed[6]) {
        (true, 1) => {
            let mut n = [0; 2];
            file.read_exact(&mut n).map_err(short)?;
            (u64::from(u16::from_le_bytes(n)), 10)
        }
        (true, 2 | 3) => {
            let mut n = [0; 4];
            file.read_exact(&mut n).map_err(short)?;
            (u64::from(u32::from_le_bytes(n)), 12)
        }
        (true, version) => return Err(unsupported(path, format!(".npy format version {version}"))),
        (false, _) => return Err(malformed(path, "not a .npy file")),
    };
    if length > MAX_HEADER {
        return Err(malformed(path, format!("a header of {length} bytes")));
    }
    let mut text = vec![0; length as usize];
    file.read_exact(&mut text).map_err(short)?;
    let text = String::from_utf8(text).map_err(|_| malformed(path, "the header is not text"))?;
    Ok((text, start + length))
}

/// Reads the dictionary literal `{'descr': …, 'fortran_order': …, 'shape': (…), }`.
fn parse_header(text: &str) -> Result<Header, String> {
    let value = |key: &str| {
        let at = text.find(&format!("'{key}'")).ok_or(format!("no {key}"))?;
        let rest = text[at + key.len() + 2..].trim_start();
        rest.strip_prefix(':').map(str::trim_start).ok_or(format!("no value of {key}"))
    };
    let descr = value("descr")?;
    let descr = descr.strip_prefix('\'').and_then(|d| d.split_once('\'')).ok_or("descr is not a simple type")?.0;
    let order = value("fortran_order")?;
    let fortran = order.starts_with("True");
    if !fortran && !order.starts_with("False") {
        return Err("fortran_order is neither True nor False".into());
    }
    let shape = value("shape")?;
    let shape = shape.strip_prefix('(').and_then(|s| s.split_once(')')).ok_or("shape is not a tuple")?.0;
    let shape = shape.split(',').map(str::trim).filter(|n| !n.is_empty());
    let shape: Result<Vec<usize>, String> =
        shape.map(|n| n.trim_end_matches('L').parse().map_err(|_| format!("shape has `{n}`"))).collect();
    Ok(Header { descr: descr.to_string(), fortran, shape: shape? })
}

fn sample_format(descr: &str) -> Option<SampleFormat> {
    let (order, kind) = descr.split_at_checked(1)?;
    let big_endian = match order {
        "<" | "|" | "=" => false,
        ">" => true,
        _ => return None,
    };
    let kind = match kind {
        "u1" => SampleKind::U8,
        "u2" => SampleKind::U16,
        "f4" => SampleKind::F32,
        "f8" => SampleKind::F64,
        _ => return None,
    };
    Some(SampleFormat { kind, big_endian })
}
