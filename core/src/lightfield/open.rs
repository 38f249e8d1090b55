//! Light fields opened, started and loaded, whatever their format.

use std::path::Path;

use ndarray::{Array5, s};

use super::colour::ColourSpace;
use super::error::{Error, io_at};
use super::field::LightField;
use super::find_order::{describe_order, find_order};
use super::format::{Format, ReadOptions};
use super::meta::Meta;
use super::reordered::Reordered;
use super::view_io::{Numbering, ViewSink, ViewSource};
use super::view_order::ReadOrder;
use super::{directory, eslf, mat, npy, numbered, single};
use crate::input::open_regular;
use crate::picture_file::may_expand;

/// Largest light field, bytes as f32, that [`load`] reads when its options give no limit.
/// Source: chosen.
const MAX_BYTES: u64 = 8 << 30;

/// Starts a light field of the given format; it appears at `path` when finished.
///
/// # Errors
/// When `path` exists (without `force`) or cannot be written, or `meta` is out of range.
///
/// ```
/// use lenslet_core::lightfield::{ColourSpace, Format, Meta, ReadOptions, create, open};
/// use ndarray::Array3;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("views.npy");
/// let mut sink = create(&path, Meta::new([1, 2], [4, 5], 3, ColourSpace::Srgb), Format::Npy, false)?;
/// for u in [1, 0] {
///     sink.write(0, u, &Array3::from_elem((4, 5, 3), u as f32))?; // in any order
/// }
/// assert!(!path.exists());
/// sink.finish()?;
///
/// let source = open(&path, &ReadOptions::default())?;
/// assert_eq!((source.meta().views, source.read(0, 1)?[[3, 4, 2]]), ([1, 2], 1.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn create(path: &Path, meta: Meta, format: Format, force: bool) -> Result<Box<dyn ViewSink>, Error> {
    meta.check()?;
    Ok(match format {
        Format::Directory => Box::new(directory::Writer::create(path, meta, force)?),
        Format::Npy => Box::new(npy::Writer::create(path, meta, force)?),
        Format::Mat => Box::new(mat::Writer::create(path, meta, force)?),
        Format::Eslf => Box::new(eslf::Writer::create(path, meta, force)?),
    })
}

/// Opens a light field: lenslet's directory, a folder of numbered pictures, a .npy of 2 to 5 dimensions, a MATLAB file,
/// a lenslet picture (with `options.views`), or a single picture as a light field of one view.
///
/// # Errors
/// When `path` is no readable light field, or its parts contradict each other.
pub fn open(path: &Path, options: &ReadOptions) -> Result<Box<dyn ViewSource>, Error> {
    let views = options.views.map(|views| options.order.unwrap_or_default().stored_views(views));
    let source = in_own_order(path, open_any(path, &ReadOptions { views, ..options.clone() })?, options);
    let meta = source.meta();
    let contradicts = |what: String| {
        let path = path.display().to_string();
        Err(Error::Unsupported { path, reason: format!("{what}; leave out the option, or mend the light field") })
    };
    if let Some([rows, columns]) = options.views
        && meta.views != [rows, columns]
    {
        let [r, c] = meta.views;
        let found = if options.order.is_none() && source.order().is_some_and(|read| read.order.columns_first) {
            " (its columns come first, by parallax: --order columns if so, --order rows if not)"
        } else {
            ""
        };
        return contradicts(format!("it has {r}x{c} views{found}, not the {rows}x{columns} of --views"));
    }
    if options.colour == Some(ColourSpace::Linear) && meta.colour == ColourSpace::Srgb {
        return contradicts("its description says that its values are sRGB-encoded, not linear light".into());
    }
    Ok(source)
}

/// `source` read in this project's order of views.
fn in_own_order(path: &Path, source: Box<dyn ViewSource>, options: &ReadOptions) -> Box<dyn ViewSource> {
    let numbering = source.numbering();
    let (read_order, notes) = match options.order {
        Some(order) => (ReadOrder { order, agreement: None }, Vec::new()),
        None if numbering == Numbering::Described || options.header_only => return source,
        None => {
            let Some(found) = find_order(&*source) else { return source };
            let note = describe_order(found.order, numbering).map(|note| format!("{}: {note}", path.display()));
            (found, note.into_iter().collect())
        }
    };
    Box::new(Reordered::new(source, read_order, notes))
}

fn open_any(path: &Path, options: &ReadOptions) -> Result<Box<dyn ViewSource>, Error> {
    let what = std::fs::metadata(path).map_err(io_at(path))?;
    if what.is_dir() {
        return Ok(if path.join(directory::DESCRIPTION).exists() {
            Box::new(directory::Reader::open(path, options)?)
        } else {
            Box::new(numbered::Reader::open(path, options)?)
        });
    }
    let head = read_head(path)?;
    if head.starts_with(npy::MAGIC) {
        return Ok(Box::new(npy::Reader::open(path, options)?));
    }
    mat::refuse_level_73(path, &head)?;
    if head.starts_with(mat::MAGIC) {
        return Ok(Box::new(mat::open(path, options)?));
    }
    Ok(match options.views.or_else(|| eslf::stated_views(path)) {
        Some(views) => Box::new(eslf::open(path, views, options)?),
        None => Box::new(single::SinglePicture::open(path, options)?),
    })
}

/// Reads a whole light field into memory.
///
/// # Errors
/// As [`open`], and when it is larger than `options.max_bytes`.
pub fn load(path: &Path, options: &ReadOptions) -> Result<LightField, Error> {
    read_all(&*open(path, options)?, path, options.max_bytes)
}

/// Reads all views of `source`, the light field at `path`, into memory: at most `max_bytes`, 8 GiB if that is 0. Absent
/// views are 0, and so is their weight.
///
/// # Errors
/// As [`load`].
pub fn read_all(source: &dyn ViewSource, path: &Path, max_bytes: u64) -> Result<LightField, Error> {
    let meta = source.meta().clone();
    let [rows, columns] = meta.views;
    let (t, w, c) = meta.view_shape();
    let limit = if max_bytes == 0 { MAX_BYTES } else { max_bytes };
    let bytes = (rows * columns) as u64 * (t * w * c) as u64 * 4;
    if bytes > limit {
        let (mib, limit) = (bytes >> 20, limit >> 20);
        let reason = format!("needs {mib} MiB in memory, more than the limit of {limit} MiB");
        return Err(Error::Unsupported { path: path.display().to_string(), reason });
    }
    if source.stored_bytes().is_some_and(|length| !may_expand(bytes / 4, length)) {
        let reason =
            format!("its small files would need {} MiB in memory; they are damaged, or of one colour", bytes >> 20);
        return Err(Error::Unsupported { path: path.display().to_string(), reason });
    }
    let mut data = Array5::zeros((rows, columns, t, w, c));
    for v in 0..rows {
        for u in 0..columns {
            if source.is_absent(v, u)? {
                continue;
            }
            data.slice_mut(s![v, u, .., .., ..]).assign(&source.read(v, u)?);
        }
    }
    Ok(LightField { meta, data })
}

/// The first bytes of a file, fewer when it is shorter.
fn read_head(path: &Path) -> Result<Vec<u8>, Error> {
    use std::io::Read;
    let mut head = Vec::with_capacity(640);
    let (file, _) = open_regular(path).map_err(io_at(path))?;
    file.take(640).read_to_end(&mut head).map_err(io_at(path))?;
    Ok(head)
}

impl LightField {
    /// Reads a light field of any format (see [`open`]) whole into memory, at most 8 GiB.
    ///
    /// # Errors
    /// As [`load`].
    ///
    /// ```
    /// use lenslet_core::lightfield::{ColourSpace, LightField, Meta};
    /// use ndarray::Array5;
    ///
    /// let folder = tempfile::tempdir()?;
    /// let meta = Meta::new([2, 2], [4, 6], 1, ColourSpace::Linear);
    /// let field = LightField { meta, data: Array5::from_elem((2, 2, 4, 6, 1), 0.2) };
    /// for name in ["views.lf", "views.npy", "views.mat"] {
    ///     field.save(folder.path().join(name))?;
    ///     let back = LightField::open(folder.path().join(name))?;
    ///     assert!((back.data[[1, 1, 3, 5, 0]] - 0.2).abs() < 1e-5);
    /// }
    /// assert!(field.save(folder.path().join("views.npy")).is_err()); // nothing is replaced
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn open(path: impl AsRef<Path>) -> Result<LightField, Error> {
        load(path.as_ref(), &ReadOptions::default())
    }

    /// Writes the light field in the format given by the ending ([`Format::of_name`]): .npy, .mat, .png (ESLF), else
    /// lenslet's directory.
    ///
    /// # Errors
    /// When `path` exists or cannot be written, or `meta` is out of range or does not fit the data.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        let path = path.as_ref();
        let mut sink = create(path, self.meta.clone(), Format::of_name(path), false)?;
        let (rows, columns, ..) = self.data.dim();
        for v in 0..rows {
            for u in 0..columns {
                sink.write(v, u, &self.data.slice(s![v, u, .., .., ..]).to_owned())?;
            }
        }
        sink.finish()
    }
}
