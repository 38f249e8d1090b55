//! Lenslet pictures (ESLF): the views interleaved, pixel (t, s) of view (v, u) at row `t·V + v`, column `s·U + u`.

use std::path::Path;

use ndarray::Array3;

use super::block::{BlockLayout, BlockViews, SampleBlock};
use super::colour::ColourSpace;
use super::companion::Companion;
use super::error::{Error, io_at, malformed, unsupported};
use super::format::ReadOptions;
use super::image_file;
use super::meta::{MAX_SIDE, Meta};
use super::value_range::{Extent, full_scale};
use super::view_io::{Numbering, ViewSink, check_all_written, relative_weights};
use crate::output::Pending;

/// Most values of such a picture; 2 GiB at 16 bits.
const MAX_VALUES: usize = 1 << 30;

/// Reads a lenslet picture, kept in memory as stored.
pub(super) fn open(path: &Path, views: [usize; 2], options: &ReadOptions) -> Result<BlockViews, Error> {
    let shape = image_file::read_shape_within(path, MAX_VALUES)?;
    let length = std::fs::metadata(path).map_err(io_at(path))?.len();
    let [rows, columns] = views;
    // Incomplete lenslets at the right and bottom edge are left out.
    let size = [shape.height / rows.max(1), shape.width / columns.max(1)];
    let colour = options.colour.unwrap_or(ColourSpace::Srgb);
    let mut meta = Meta::new(views, size, shape.channels, colour);
    meta.check().map_err(|e| malformed(path, format!("no lenslet picture of {rows}x{columns} views: {e}")))?;
    let (mut notes, mut numbering) = (Vec::new(), Numbering::Pairs);
    if let Some(text) = image_file::read_description(path) {
        match Companion::from_text(text.as_bytes()).and_then(|found| found.of(&meta, "")) {
            Ok(described) => (meta, numbering) = (described, Numbering::Described),
            Err(why) => notes.push(format!("{}: its description is left alone: {why}", path.display())),
        }
    }
    if options.header_only {
        let layout = BlockLayout { strides: [0; 5], number: image_file::EIGHT_BITS, scale: 255.0 };
        return Ok(BlockViews::new(path, meta, SampleBlock::new(Vec::new(), layout), notes, numbering, length));
    }
    let (bytes, number, channels) = image_file::read_stored_with_alpha(path, MAX_VALUES)?;
    let line = shape.width * channels;
    let mut extent = Extent::default();
    if channels == shape.channels {
        extent.add(number, &bytes);
    } else {
        // Alpha is a weight.
        let pixel = channels * number.kind.bytes();
        bytes.chunks_exact(pixel).for_each(|p| extent.add(number, &p[..shape.channels * number.kind.bytes()]));
    }
    let (scale, note) = full_scale(path, number.kind, &extent, options.full_scale, |k| format!("value {k}"))?;
    notes.extend(note);
    let layout = BlockLayout { strides: [line, channels, rows * line, columns * channels, 1], number, scale };
    let block = SampleBlock::new(bytes, layout);
    if channels != shape.channels && meta.weights.is_none() {
        let mean = |k: usize| block.mean_of_channel(k / columns, k % columns, (size[0], size[1]), shape.channels);
        meta.weights = relative_weights(&(0..rows * columns).map(mean).collect::<Vec<_>>());
    }
    Ok(BlockViews::new(path, meta, block, notes, numbering, length))
}

/// Views (rows, columns) of a lenslet picture that this project wrote.
pub(super) fn stated_views(path: &Path) -> Option<[usize; 2]> {
    let text = image_file::read_description(path)?;
    let [[rows, columns], [height, width]] = Companion::from_text(text.as_bytes()).ok()?.shape();
    // Cut or scaled by another program, it is a picture like any other.
    let shape = image_file::read_shape_within(path, MAX_VALUES).ok()?;
    (shape.height == rows * height && shape.width == columns * width).then_some([rows, columns])
}

/// Writes a lenslet picture, 16 bit; its pixels stay in memory until it is finished.
pub(super) struct Writer {
    meta: Meta,
    written: Vec<bool>,
    samples: Vec<u8>,
    pending: Pending,
}

impl Writer {
    pub(super) fn create(path: &Path, meta: Meta, force: bool) -> Result<Self, Error> {
        let values = meta.views[0] * meta.views[1] * meta.size[0] * meta.size[1];
        let (height, width) = (meta.views[0] * meta.size[0], meta.views[1] * meta.size[1]);
        if values > MAX_VALUES / 4 || height > MAX_SIDE || width > MAX_SIDE {
            return Err(unsupported(path, format!("a lenslet picture of {width}x{height} pixels is too large")));
        }
        let pending = Pending::file(path, force)?;
        let samples = vec![0; values * meta.channels * 2];
        Ok(Writer { written: vec![false; meta.views[0] * meta.views[1]], meta, samples, pending })
    }
}

impl ViewSink for Writer {
    fn write(&mut self, v: usize, u: usize, view: &Array3<f32>) -> Result<(), Error> {
        self.meta.check_view(v, u, view)?;
        let [rows, columns] = self.meta.views;
        let (height, width, channels) = view.dim();
        let pixel = 2 * channels;
        let line = width * columns * pixel;
        let stored = image_file::to_sixteen_bits(view);
        for t in 0..height {
            let target = &mut self.samples[(t * rows + v) * line..][..line];
            let source = &stored[t * width * pixel..][..width * pixel];
            for (to, from) in target.chunks_exact_mut(columns * pixel).zip(source.chunks_exact(pixel)) {
                to[u * pixel..(u + 1) * pixel].copy_from_slice(from);
            }
        }
        self.written[v * columns + u] = true;
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<(), Error> {
        check_all_written(&self.written, &self.meta)?;
        let (height, width) = (self.meta.views[0] * self.meta.size[0], self.meta.views[1] * self.meta.size[1]);
        let path = self.pending.path();
        let text = Companion::new(&self.meta, String::new()).to_text()?;
        let png = image_file::encode_png(&self.samples, width, height, self.meta.channels, Some(&text), path)?;
        self.pending.write(&png)?;
        Ok(self.pending.commit()?)
    }
}
