//! Light fields stored as one block of numbers in any axis order, held in memory as stored.

use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use ndarray::Array3;

use crate::input::open_regular;

use super::error::{Error, io_at, unsupported};
use super::meta::Meta;
use super::sample::SampleFormat;
use super::view_io::{Numbering, ViewSource, check_finite};

/// Largest block held in memory, bytes.
const MAX_BLOCK: u64 = 4 << 30;

/// Where the value (v, u, t, s, c) is, counted in numbers from the start, and how the numbers are stored.
#[derive(Debug, Clone, Copy)]
pub(super) struct BlockLayout {
    /// Steps along v, u, t, s and c.
    pub(super) strides: [usize; 5],
    /// The stored number.
    pub(super) number: SampleFormat,
    /// The stored value of 1.0.
    pub(super) scale: f32,
}

/// A block of numbers read as views.
pub(super) struct SampleBlock {
    bytes: Vec<u8>,
    layout: BlockLayout,
}

impl SampleBlock {
    /// Takes numbers already in memory.
    pub(super) fn new(bytes: Vec<u8>, layout: BlockLayout) -> Self {
        SampleBlock { bytes, layout }
    }

    /// Reads `count` numbers from `start` of a file; the caller has compared them with its length.
    pub(super) fn read(path: &Path, start: u64, count: u64, layout: BlockLayout) -> Result<Self, Error> {
        let length = count * layout.number.kind.bytes() as u64;
        if length > MAX_BLOCK {
            let reason = format!(
                "{} MiB in an order that must be read whole, more than the limit of {} MiB; save it in C order",
                length >> 20,
                MAX_BLOCK >> 20
            );
            return Err(unsupported(path, reason));
        }
        let (mut file, _) = open_regular(path).map_err(io_at(path))?;
        file.seek(SeekFrom::Start(start)).map_err(io_at(path))?;
        let mut bytes = vec![0; length as usize];
        file.read_exact(&mut bytes).map_err(io_at(path))?;
        Ok(SampleBlock { bytes, layout })
    }

    /// All bytes, as stored.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Sets the stored value of 1.0.
    pub(super) fn set_scale(&mut self, scale: f32) {
        self.layout.scale = scale;
    }

    /// The bytes of view (v, u) in the order (t, s, c).
    pub(super) fn stored_view(&self, v: usize, u: usize, (h, w, c): (usize, usize, usize)) -> Vec<u8> {
        let BlockLayout { strides, number, .. } = self.layout;
        let width = number.kind.bytes();
        let mut out = Vec::with_capacity(h * w * c * width);
        for t in 0..h {
            for s in 0..w {
                for k in 0..c {
                    let at = v * strides[0] + u * strides[1] + t * strides[2] + s * strides[3] + k * strides[4];
                    out.extend_from_slice(self.bytes.get(at * width..(at + 1) * width).unwrap_or(&[0; 8][..width]));
                }
            }
        }
        out
    }

    /// Mean of channel `c` over view (v, u) of (t, s) pixels, as stored.
    pub(super) fn mean_of_channel(&self, v: usize, u: usize, (h, w): (usize, usize), c: usize) -> f64 {
        let BlockLayout { strides, number, .. } = self.layout;
        let width = number.kind.bytes();
        let origin = v * strides[0] + u * strides[1] + c * strides[4];
        let one = |t: usize, s: usize| {
            let at = width * (origin + t * strides[2] + s * strides[3]);
            self.bytes.get(at..at + width).map_or(0.0, |b| number.read(b))
        };
        let sum: f64 = (0..h).flat_map(|t| (0..w).map(move |s| (t, s))).map(|(t, s)| one(t, s)).sum();
        sum / (h * w).max(1) as f64
    }

    /// View (v, u) of shape (t, s, c); places outside of the block read as 0.
    pub(super) fn view(&self, v: usize, u: usize, shape: (usize, usize, usize)) -> Array3<f32> {
        let BlockLayout { strides, number, scale } = self.layout;
        let width = number.kind.bytes();
        let origin = v * strides[0] + u * strides[1];
        Array3::from_shape_fn(shape, |(t, s, c)| {
            let at = width * (origin + t * strides[2] + s * strides[3] + c * strides[4]);
            self.bytes.get(at..at + width).map_or(0.0, |b| (number.read(b) / f64::from(scale)) as f32)
        })
    }
}

/// A light field that is one block in memory.
pub(super) struct BlockViews {
    path: PathBuf,
    meta: Meta,
    block: SampleBlock,
    notes: Vec<String>,
    numbering: Numbering,
    length: u64,
}

impl BlockViews {
    /// The light field of the file `path` of `length` bytes; the shape of `block` is that of `meta`.
    pub(super) fn new(
        path: &Path,
        meta: Meta,
        block: SampleBlock,
        notes: Vec<String>,
        numbering: Numbering,
        length: u64,
    ) -> Self {
        BlockViews { path: path.to_path_buf(), meta, block, notes, numbering, length }
    }
}

impl ViewSource for BlockViews {
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
        check_finite(&self.path, v, u, self.block.view(v, u, self.meta.view_shape()))
    }
}
