//! Any capture file to a [`Capture`]: the content decides the kind; facts come from metadata, else from a profile.

use std::path::Path;

use super::capture::Capture;
use super::error::Error;
use super::profile::CameraProfile;
use super::segments::{self, Container};
use super::{file, lfp, picture, raw};

/// Opens a capture, with the camera profile of a name (`lytro-f01`) or TOML file as a command line gives it; else as
/// [`Capture::open`] and [`Capture::open_as`].
///
/// # Errors
/// As [`Capture::open`], and when there is no such profile.
pub fn open_capture(path: &Path, profile: Option<&str>) -> Result<Capture, Error> {
    match profile {
        Some(name) => Capture::open_as(path, &CameraProfile::find(name)?),
        None => Capture::open(path),
    }
}

impl Capture {
    /// Opens a capture file: a container (.lfp, .lfr), a raw mosaic as a picture (PNG, TIFF, JPEG, BMP, PGM; 8 or
    /// 16 bit, one channel), or a packed .raw with its metadata in a .txt or .json of the same name.
    ///
    /// Raw files without metadata and pictures are recognised by their size.
    ///
    /// # Errors
    /// When the file cannot be read, is none of these, or names an image it does not hold.
    ///
    /// ```
    /// use lenslet_core::container::{Capture, Cfa, Levels, RawMosaic, write_lfp};
    ///
    /// let folder = tempfile::tempdir()?;
    /// let path = folder.path().join("flat.lfp");
    /// let mosaic = RawMosaic { width: 32, height: 16, data: vec![700; 512] };
    /// write_lfp(&path, &Capture::bare(mosaic, Cfa::Bggr, Levels { black: [168.0; 4], white: [4095.0; 4] }), false)?;
    ///
    /// let capture = Capture::open(&path)?;
    /// assert_eq!((capture.mosaic.width, capture.mosaic.data[511], capture.cfa), (32, 700, Cfa::Bggr));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn open(path: impl AsRef<Path>) -> Result<Capture, Error> {
        read_capture(path.as_ref(), None)
    }

    /// Opens a capture file; facts that it lacks are taken from `camera`.
    ///
    /// # Errors
    /// As [`Capture::open`].
    pub fn open_as(path: impl AsRef<Path>, camera: &CameraProfile) -> Result<Capture, Error> {
        read_capture(path.as_ref(), Some(camera))
    }
}

fn read_capture(path: &Path, profile: Option<&CameraProfile>) -> Result<Capture, Error> {
    let head = file::head(path, 16)?;
    if head.is_empty() {
        return Err(Error::not_recognised(path, "the file is empty"));
    }
    if head.starts_with(&segments::MAGIC) {
        return lfp::capture_from_container(&Container::open(path)?, profile);
    }
    if picture::check_picture(path, &head)? {
        let bytes = file::read(path, "a picture", picture::MAX_FILE)?;
        return picture::capture_from_picture(path, &bytes, profile);
    }
    raw::capture_from_raw(path, profile)
}
