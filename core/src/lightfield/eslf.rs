//! Lenslet pictures (ESLF): the views interleaved, pixel (t, s) of view (v, u) at row `t·V + v`, column `s·U + u`.

use std::path::Path;

use ndarray::Array3;

use super::block::{BlockLayout, BlockViews, SampleBlock};
use super::colour::ColourSpace;
use super::error::{Error, malformed, unsupported};
use super::format::ReadOptions;
use super::image_file;
use super::meta::{MAX_SIDE, Meta};
use super::view_io::{ViewSink, check_all_written};
use crate::output::Pending;

/// Most values of such a picture; 2 GiB at 16 bits.
const MAX_VALUES: usize = 1 << 30;

/// Reads a lenslet picture, kept in memory as stored.
pub(super) fn open(path: &Path, views: [usize; 2], options: &ReadOptions) -> Result<BlockViews, Error> {
    let shape = image_file::read_shape_within(path, MAX_VALUES)?;
    let [rows, columns] = views;
    // Incomplete lenslets at the right and bottom edge are left out.
    let size = [shape.height / rows.max(1), shape.width / columns.max(1)];
    let colour = options.colour.unwrap_or(ColourSpace::Srgb);
    let meta = Meta::new(views, size, shape.channels, colour);
    meta.check().map_err(|e| malformed(path, format!("no lenslet picture of {rows}x{columns} views: {e}")))?;
    let (bytes, number, channels) = image_file::read_stored(path, MAX_VALUES)?;
    let line = shape.width * channels;
    let layout = BlockLayout {
        strides: [line, channels, rows * line, columns * channels, 1],
        number,
        scale: number.kind.full_scale().unwrap_or(1.0),
    };
    Ok(BlockViews::new(path, meta, SampleBlock::new(bytes, layout)))
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
        check_all_written(&self.written, self.meta.views[1])?;
        let (height, width) = (self.meta.views[0] * self.meta.size[0], self.meta.views[1] * self.meta.size[1]);
        let path = self.pending.path();
        let png = image_file::encode_png(&self.samples, width, height, self.meta.channels, path)?;
        self.pending.write(&png)?;
        Ok(self.pending.commit()?)
    }
}
