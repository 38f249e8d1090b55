//! A single picture as a light field of one view.

use std::path::{Path, PathBuf};

use ndarray::Array3;

use super::colour::ColourSpace;
use super::error::Error;
use super::format::ReadOptions;
use super::image_file::{self, Shape};
use super::meta::Meta;
use super::view_io::ViewSource;

/// A single image as a light field of one view.
pub(super) struct SinglePicture {
    path: PathBuf,
    meta: Meta,
}

impl SinglePicture {
    pub(super) fn open(path: &Path, options: &ReadOptions) -> Result<Self, Error> {
        let Shape { width, height, channels } = image_file::read_shape(path)?;
        let colour = options.colour.unwrap_or(ColourSpace::Srgb);
        Ok(SinglePicture { path: path.to_path_buf(), meta: Meta::new([1, 1], [height, width], channels, colour) })
    }
}

impl ViewSource for SinglePicture {
    fn meta(&self) -> &Meta {
        &self.meta
    }

    fn read(&self, v: usize, u: usize) -> Result<Array3<f32>, Error> {
        self.meta.check_place(v, u)?;
        image_file::read_view(&self.path, &self.meta)
    }
}
