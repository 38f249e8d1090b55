//! A single picture as a light field of one view.

use std::path::{Path, PathBuf};

use ndarray::Array3;

use super::colour::ColourSpace;
use super::error::Error;
use super::format::ReadOptions;
use super::image_file::{self, Shape};
use super::meta::Meta;
use super::value_range::PictureRange;
use super::view_io::{Numbering, ViewSource};

/// A single image as a light field of one view.
pub(super) struct SinglePicture {
    path: PathBuf,
    meta: Meta,
    range: PictureRange,
}

impl SinglePicture {
    pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<Self, Error> {
        let Shape { width, height, channels } = image_file::read_shape(path)?;
        let colour = options.colour.unwrap_or(ColourSpace::Srgb);
        let range =
            if options.header_only { PictureRange::default() } else { PictureRange::of(path, options.full_scale)? };
        let path = path.to_path_buf();
        Ok(SinglePicture { path, meta: Meta::new([1, 1], [height, width], channels, colour), range })
    }
}

impl ViewSource for SinglePicture {
    fn meta(&self) -> &Meta {
        &self.meta
    }

    fn notes(&self) -> &[String] {
        self.range.note.as_slice()
    }

    fn numbering(&self) -> Numbering {
        Numbering::Described
    }

    fn read(&self, v: usize, u: usize) -> Result<Array3<f32>, Error> {
        self.meta.check_place(v, u)?;
        Ok(self.range.apply(image_file::read_view(&self.path, &self.meta)?))
    }
}
