//! The light field on disk and in memory: our directory, .npy, and the formats of other tools.
//!
//! Views travel one at a time: [`create`] gives a [`ViewSink`], [`open`] a [`ViewSource`]; [`load`] reads a whole one.

pub mod colour;
mod directory;
mod encode;
mod eslf;
mod image_file;
mod mat;
mod npy;
mod number;
mod numbered;
mod queue;
mod strided;
mod view;

use std::path::Path;
use std::str::FromStr;

use ndarray::{Array3, Array5, s};
use serde::{Deserialize, Serialize};

pub use view::{Encoding, Linear, Srgb, View};

/// Most views along one axis.
pub const MAX_VIEWS: usize = 1024;
/// Longest side of a view, pixels.
pub const MAX_SIDE: usize = 1 << 16;
/// Most values (t·s·c) of one view: 1 GiB as f32.
pub const MAX_VIEW_VALUES: usize = 1 << 28;

/// How values relate to light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ColourSpace {
    /// sRGB primaries, sRGB transfer curve.
    Srgb,
    /// sRGB primaries, linear light.
    Linear,
}

/// What is known of a light field besides its pixels (`lightfield.json`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// Format version, 1.
    pub version: u32,
    /// Views (rows v, columns u).
    pub views: [usize; 2],
    /// View size (height t, width s).
    pub size: [usize; 2],
    /// Channels, 1 or 3.
    pub channels: usize,
    /// Colour space.
    pub colour: ColourSpace,
    /// Output pixels between neighbouring lenslets of a row, if the views were resampled from a lattice.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch: Option<f64>,
    /// Rotation of that lattice, radians.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<f64>,
    /// How far each view can be relied on, 0..=1, row by row: its share of the light of the best lit one, where known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights: Option<Vec<f32>>,
    /// Resampling method that made the views.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method: Option<String>,
    /// What was done, oldest first: free JSON objects (tool, version, parameters, source hashes).
    #[serde(default)]
    pub provenance: Vec<serde_json::Value>,
}

impl Meta {
    /// A light field of `views` (rows, columns) of `size` (height, width), with nothing said about where it came from.
    pub fn new(views: [usize; 2], size: [usize; 2], channels: usize, colour: ColourSpace) -> Self {
        Meta {
            version: 1,
            views,
            size,
            channels,
            colour,
            pitch: None,
            rotation: None,
            weights: None,
            method: None,
            provenance: Vec::new(),
        }
    }

    /// Checks sizes against the limits of this module.
    ///
    /// # Errors
    /// [`Error::Parameter`] with what is out of range.
    pub fn check(&self) -> Result<(), Error> {
        let bad = |what: String| Err(Error::Parameter(what));
        if self.views.iter().any(|&n| n == 0 || n > MAX_VIEWS) {
            return bad(format!("{}x{} views: each must be 1 to {MAX_VIEWS}", self.views[0], self.views[1]));
        }
        if self.size.iter().any(|&n| n == 0 || n > MAX_SIDE) {
            return bad(format!(
                "views of {}x{} pixels: each side must be 1 to {MAX_SIDE}",
                self.size[1], self.size[0]
            ));
        }
        if self.channels != 1 && self.channels != 3 {
            return bad(format!("{} channels: only 1 or 3 can be", self.channels));
        }
        if let Some(w) = &self.weights
            && (w.len() != self.views[0] * self.views[1] || !w.iter().all(|w| (0.0..=1.0).contains(w)))
        {
            return bad(format!(
                "{} weights for {}x{} views, or some not 0 to 1",
                w.len(),
                self.views[0],
                self.views[1]
            ));
        }
        // The limits above keep this product far below the range of usize.
        if self.size[0] * self.size[1] * self.channels > MAX_VIEW_VALUES {
            return bad(format!("views of {}x{} pixels are too large", self.size[1], self.size[0]));
        }
        Ok(())
    }

    /// Shape of one view (t, s, c).
    pub fn view_shape(&self) -> (usize, usize, usize) {
        (self.size[0], self.size[1], self.channels)
    }

    fn check_view(&self, v: usize, u: usize, view: &Array3<f32>) -> Result<(), Error> {
        check_place(self, v, u)?;
        if view.dim() != self.view_shape() {
            let (got, expected) = (view.dim(), self.view_shape());
            return Err(Error::Parameter(format!("view ({v}, {u}) has shape {got:?}, expected {expected:?}")));
        }
        Ok(())
    }
}

/// A whole light field in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct LightField {
    /// What is known besides the pixels.
    pub meta: Meta,
    /// Values nominally 0..1, shape (v, u, t, s, c).
    pub data: Array5<f32>,
}

/// How a light field is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// `lightfield.json` and one 16-bit PNG a view.
    Directory,
    /// One .npy, f32, shape (v, u, t, s, c).
    Npy,
    /// One MATLAB file of level 5 with the variable `LF` (v, u, t, s, c), single, 0..1.
    Mat,
    /// One 16-bit PNG with the views interleaved, a lenslet's views side by side.
    Eslf,
}

impl Format {
    /// The format a name asks for: by its ending, a directory when it has none that is known.
    pub fn of_name(path: &Path) -> Format {
        match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("npy") => Format::Npy,
            Some("mat") => Format::Mat,
            Some("png") => Format::Eslf,
            _ => Format::Directory,
        }
    }
}

impl FromStr for Format {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        match text {
            "dir" | "directory" => Ok(Format::Directory),
            "npy" => Ok(Format::Npy),
            "mat" => Ok(Format::Mat),
            "eslf" => Ok(Format::Eslf),
            _ => Err(Error::Parameter(format!("unknown light field format `{text}`: dir, npy, mat or eslf"))),
        }
    }
}

impl std::fmt::Display for Format {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Format::Directory => "dir",
            Format::Npy => "npy",
            Format::Mat => "mat",
            Format::Eslf => "eslf",
        })
    }
}

/// How to read what does not describe itself.
#[derive(Debug, Clone, Default)]
pub struct ReadOptions {
    /// Views (rows, columns) of files that do not say so (ESLF and other lenslet images).
    pub views: Option<[usize; 2]>,
    /// Colour space of files that do not say so; sRGB when absent. Our own directory says so itself.
    pub colour: Option<ColourSpace>,
    /// [`load`] refuses a light field of more bytes than this (as f32); 0 stands for 8 GiB.
    pub max_bytes: u64,
}

/// Starts a light field of the given format; it appears at `path` when finished.
///
/// # Errors
/// When `path` exists (without `force`) or cannot be written, or `meta` is out of range.
pub fn create(path: &Path, meta: Meta, format: Format, force: bool) -> Result<Box<dyn ViewSink>, Error> {
    meta.check()?;
    Ok(match format {
        Format::Directory => Box::new(directory::Writer::create(path, meta, force)?),
        Format::Npy => Box::new(npy::Writer::create(path, meta, force)?),
        Format::Mat => Box::new(mat::Writer::create(path, meta, force)?),
        Format::Eslf => Box::new(eslf::Writer::create(path, meta, force)?),
    })
}

/// Opens a light field: our directory, a folder of numbered pictures, a .npy of 2 to 5 dimensions, a MATLAB file, a
/// lenslet picture (with `options.views`), or a single picture as a light field of one view.
///
/// # Errors
/// When nothing readable is there, or its parts contradict each other.
pub fn open(path: &Path, options: &ReadOptions) -> Result<Box<dyn ViewSource>, Error> {
    let what = std::fs::metadata(path).map_err(io_at(path))?;
    if what.is_dir() {
        return Ok(if path.join(directory::DESCRIPTION).exists() {
            Box::new(directory::Reader::open(path)?)
        } else {
            Box::new(numbered::Reader::open(path, options)?)
        });
    }
    let head = head(path)?;
    if head.starts_with(npy::MAGIC) {
        return Ok(Box::new(npy::Reader::open(path, options)?));
    }
    mat::refuse_level_73(path, &head)?;
    if head.starts_with(mat::MAGIC) {
        return Ok(Box::new(mat::open(path, options)?));
    }
    Ok(match options.views {
        Some(views) => Box::new(eslf::open(path, views, options)?),
        None => Box::new(image_file::Single::open(path, options)?),
    })
}

/// Reads a whole light field into memory.
///
/// # Errors
/// As [`open`], and when it is larger than `options.max_bytes`.
pub fn load(path: &Path, options: &ReadOptions) -> Result<LightField, Error> {
    let source = open(path, options)?;
    let meta = source.meta().clone();
    let [rows, columns] = meta.views;
    let (t, w, c) = meta.view_shape();
    let limit = if options.max_bytes == 0 { 8 << 30 } else { options.max_bytes };
    let bytes = (rows * columns) as u64 * (t * w * c) as u64 * 4;
    if bytes > limit {
        let (mib, limit) = (bytes >> 20, limit >> 20);
        let reason = format!("needs {mib} MiB in memory, more than the limit of {limit} MiB");
        return Err(Error::Unsupported { path: path.display().to_string(), reason });
    }
    let mut data = Array5::zeros((rows, columns, t, w, c));
    for v in 0..rows {
        for u in 0..columns {
            data.slice_mut(s![v, u, .., .., ..]).assign(&source.read(v, u)?);
        }
    }
    Ok(LightField { meta, data })
}

/// The first bytes of a file, fewer when it is shorter.
fn head(path: &Path) -> Result<Vec<u8>, Error> {
    use std::io::Read;
    let mut head = Vec::with_capacity(640);
    let file = std::fs::File::open(path).map_err(io_at(path))?;
    file.take(640).read_to_end(&mut head).map_err(io_at(path))?;
    Ok(head)
}

fn io_at(path: &Path) -> impl FnOnce(std::io::Error) -> Error + '_ {
    move |source| Error::Io { path: path.display().to_string(), source }
}

/// Fails for a view that is not there.
fn check_place(meta: &Meta, v: usize, u: usize) -> Result<(), Error> {
    let [rows, columns] = meta.views;
    if v < rows && u < columns {
        return Ok(());
    }
    Err(Error::Parameter(format!("view ({v}, {u}) is outside of {rows}x{columns} views")))
}

/// Fails when a view was never written.
fn all_written(written: &[bool], columns: usize) -> Result<(), Error> {
    match written.iter().position(|&w| !w) {
        None => Ok(()),
        Some(i) => {
            let missing = written.iter().filter(|&&w| !w).count();
            let (v, u) = (i / columns, i % columns);
            Err(Error::Parameter(format!("{missing} views were not written, the first is ({v}, {u})")))
        }
    }
}

/// Refuses values that are not numbers.
fn finite(path: &Path, v: usize, u: usize, view: Array3<f32>) -> Result<Array3<f32>, Error> {
    if view.iter().all(|x| x.is_finite()) {
        Ok(view)
    } else {
        Err(malformed(path, format!("view ({v}, {u}) has values that are not finite numbers")))
    }
}

fn malformed(path: &Path, reason: impl Into<String>) -> Error {
    Error::Malformed { path: path.display().to_string(), reason: reason.into() }
}

fn unsupported(path: &Path, reason: impl Into<String>) -> Error {
    Error::Unsupported { path: path.display().to_string(), reason: reason.into() }
}

/// Somewhere views can be written, one at a time, in any order; complete only after `finish`.
pub trait ViewSink: Send {
    /// Writes view (row `v`, column `u`, counted from 0), shape (t, s, c), values nominally 0..1.
    ///
    /// # Errors
    /// When the view cannot be encoded or written.
    fn write(&mut self, v: usize, u: usize, view: &Array3<f32>) -> Result<(), Error>;
    /// The folder under its temporary name, for companions of the views; none where the light field is a single file.
    fn folder(&self) -> Option<&Path> {
        None
    }
    /// Completes the light field under its final name.
    ///
    /// # Errors
    /// When views are missing or the result cannot be put in place.
    fn finish(self: Box<Self>) -> Result<(), Error>;
}

/// Somewhere views can be read from, one at a time.
pub trait ViewSource: Send + Sync {
    /// What is known besides the pixels.
    fn meta(&self) -> &Meta;
    /// Reads view (row `v`, column `u`), shape (t, s, c), values 0..1.
    ///
    /// # Errors
    /// When the view is missing or malformed.
    fn read(&self, v: usize, u: usize) -> Result<Array3<f32>, Error>;
}

/// What goes wrong with light fields on disk.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Reading or writing failed.
    #[error("{path}: {source}")]
    Io {
        /// Which file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// The file is not what it should be.
    #[error("{path}: {reason}")]
    Malformed {
        /// Which file.
        path: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A valid file of a kind that is not supported.
    #[error("{path}: {reason}")]
    Unsupported {
        /// Which file.
        path: String,
        /// What is not supported.
        reason: String,
    },
    /// The caller asked for something impossible.
    #[error("{0}")]
    Parameter(String),
    /// The output exists already or cannot be put in place.
    #[error(transparent)]
    Output(#[from] crate::output::Error),
}
