//! NumPy's .npy (format 1.0 to 3.0): written as one f32 array (v, u, t, s, c), views streamed to their places;
//! read with 2 to 5 dimensions, f32, f64, u8 or u16, in C or Fortran order.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use ndarray::Array3;

use super::block::{BlockLayout, SampleBlock};
use super::colour::ColourSpace;
use super::error::{Error, io_at, malformed, unsupported};
use super::format::ReadOptions;
use super::meta::Meta;
use super::sample::{SampleFormat, SampleKind};
use super::view_io::{ViewSink, ViewSource, check_all_written, check_finite};
use super::write_queue::WriteQueue;
use crate::input::open_regular;
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
    pending: Option<Pending>,
    queue: WriteQueue,
}

impl Writer {
    pub(super) fn create(path: &Path, meta: Meta, force: bool) -> Result<Self, Error> {
        let pending = Pending::file(path, force)?;
        let (t, s, c) = meta.view_shape();
        let head = header_bytes(&[meta.views[0], meta.views[1], t, s, c]);
        let mut file = pending.handle()?;
        file.write_all(&head).map_err(io_at(path))?;
        let data = (meta.views[0] * meta.views[1]) as u64 * (t * s * c) as u64 * 4;
        file.set_len(head.len() as u64 + data).map_err(io_at(path))?;
        let written = vec![false; meta.views[0] * meta.views[1]];
        Ok(Writer { meta, written, data_start: head.len() as u64, pending: Some(pending), queue: WriteQueue::new() })
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
        let Some(pending) = &self.pending else { return Err(Error::Parameter("light field is finished".into())) };
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
        check_all_written(&self.written, self.meta.views[1])?;
        match self.pending.take() {
            Some(pending) => Ok(pending.commit()?),
            None => Ok(()),
        }
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        // Only an abandoned writer still has jobs; their errors do not matter.
        let _ = self.queue.wait();
    }
}

/// Reads a .npy as a light field; C order view by view, Fortran order from memory.
pub(super) struct Reader {
    path: PathBuf,
    meta: Meta,
    number: SampleFormat,
    scale: f32,
    /// Where the data starts, and channels stored (4 where the last is dropped).
    start: u64,
    stored: usize,
    whole: Option<SampleBlock>,
}

impl Reader {
    pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<Self, Error> {
        let (mut file, length) = open_regular(path).map_err(io_at(path))?;
        let (text, start) = read_header(&mut file, path)?;
        let header = parse_header(&text).map_err(|reason| malformed(path, format!("not a .npy header: {reason}")))?;
        let number = sample_format(&header.descr).ok_or_else(|| {
            unsupported(path, format!("numbers of type {}; save the array as float32 or uint16", header.descr))
        })?;
        let Some(scale) = number.kind.full_scale() else {
            return Err(unsupported(path, format!("numbers of type {}", header.descr)));
        };
        let (views, size, stored) =
            interpret_shape(&header.shape, options).map_err(|reason| unsupported(path, reason))?;
        let colour = options.colour.unwrap_or(ColourSpace::Srgb);
        let meta = Meta::new(views, size, if stored == 4 { 3 } else { stored }, colour);
        meta.check().map_err(|e| unsupported(path, e.to_string()))?;
        // Meta::check bounds every factor, so the product stays far below 2^64.
        let values = (views[0] * views[1]) as u64 * (size[0] * size[1] * stored) as u64;
        let expected = start + values * number.kind.bytes() as u64;
        if length < expected {
            return Err(malformed(path, format!("ends early: {length} bytes, its header needs {expected}")));
        }
        let whole = if header.fortran {
            let (vu, ts) = ((views[0], views[1]), (size[0], size[1]));
            // Fortran order: the first stored index runs fastest; which axes were stored does not change the order.
            let strides = [1, vu.0, vu.0 * vu.1, vu.0 * vu.1 * ts.0, vu.0 * vu.1 * ts.0 * ts.1];
            let strides = if header.running { [vu.1, 1, strides[2], strides[3], strides[4]] } else { strides };
            let layout = BlockLayout { strides, number, scale };
            Some(SampleBlock::read(path, start, values, layout)?)
        } else {
            None
        };
        Ok(Reader { path: path.to_path_buf(), meta, number, scale, start, stored, whole })
    }
}

impl ViewSource for Reader {
    fn meta(&self) -> &Meta {
        &self.meta
    }

    fn read(&self, v: usize, u: usize) -> Result<Array3<f32>, Error> {
        self.meta.check_place(v, u)?;
        let (t, s, c) = self.meta.view_shape();
        let view = match &self.whole {
            Some(whole) => whole.view(v, u, (t, s, c)),
            None => {
                let bytes = t * s * self.stored * self.number.kind.bytes();
                let index = v * self.meta.views[1] + u;
                let (mut file, _) = open_regular(&self.path).map_err(io_at(&self.path))?;
                file.seek(SeekFrom::Start(self.start + index as u64 * bytes as u64)).map_err(io_at(&self.path))?;
                let mut buffer = vec![0; bytes];
                file.read_exact(&mut buffer).map_err(io_at(&self.path))?;
                let mut values = self.number.read_all(&buffer, self.scale);
                if self.stored != c {
                    values = values.chunks_exact(self.stored).flat_map(|p| p[..c].iter().copied()).collect();
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
    /// Four dimensions of which the first counts the views.
    running: bool,
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
    let shape = shape?;
    let running = shape.len() == 4 && matches!(shape[3], 3 | 4);
    Ok(Header { descr: descr.to_string(), fortran, shape, running })
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

/// Views, size and stored channels of an array of this shape.
fn interpret_shape(shape: &[usize], options: &ReadOptions) -> Result<([usize; 2], [usize; 2], usize), String> {
    match *shape {
        [v, u, t, s, c @ (1 | 3 | 4)] => Ok(([v, u], [t, s], c)),
        [n, t, s, c @ (3 | 4)] => {
            let side = n.isqrt();
            match options.views {
                Some([v, u]) if v.checked_mul(u) == Some(n) => Ok(([v, u], [t, s], c)),
                None if side * side == n => Ok(([side, side], [t, s], c)),
                _ => Err(format!("{n} views in a row: say how they are arranged with --views ROWSxCOLUMNS")),
            }
        }
        [v, u, t, s] => Ok(([v, u], [t, s], 1)),
        [t, s, c @ (1 | 3 | 4)] => Ok(([1, 1], [t, s], c)),
        [t, s] => Ok(([1, 1], [t, s], 1)),
        _ => Err(format!("an array of shape {shape:?}; a light field has shape (v, u, t, s, c) with c = 1 or 3")),
    }
}
