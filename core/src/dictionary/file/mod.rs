//! Files of dictionaries: `.lfd` and `.safetensors`, with the same contents. The format written depends on the file's
//! ending, the format read on its first bytes.

mod lfd;
mod lfd_header;
mod npy;
mod quantise;
mod safetensors;

use std::io::Read;
use std::path::Path;

use super::error::Error;
use super::limits;
use super::model::{Dictionary, ModelKind};

pub use lfd::{FORMAT_VERSION, to_bytes};
pub use npy::export_npy;

/// The format of a dictionary's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// `.lfd`: small, sealed by a checksum.
    Lfd,
    /// `.safetensors`: read by many tools.
    Safetensors,
}

impl Format {
    /// The format that [`save`] writes under this name: safetensors for names that end in `.safetensors` (in any case),
    /// else `.lfd`.
    ///
    /// ```
    /// use lenslet_core::dictionary::Format;
    /// use std::path::Path;
    ///
    /// assert_eq!(Format::of(Path::new("mine.safetensors")), Format::Safetensors);
    /// assert_eq!(Format::of(Path::new("mine.lfd")), Format::Lfd);
    /// ```
    #[must_use]
    pub fn of(path: &Path) -> Self {
        match path.extension() {
            Some(ending) if ending.eq_ignore_ascii_case("safetensors") => Format::Safetensors,
            _ => Format::Lfd,
        }
    }

    /// The format of a file that begins with these bytes (at least the first nine), where it is one of the two.
    ///
    /// ```
    /// use lenslet_core::dictionary::Format;
    ///
    /// assert_eq!(Format::detect(b"\x89LFD\r\n\x1a\n\x03"), Some(Format::Lfd));
    /// assert_eq!(Format::detect(b"P5 16 16 255 "), None);
    /// ```
    #[must_use]
    pub fn detect(head: &[u8]) -> Option<Self> {
        if head.starts_with(&lfd::MAGIC) {
            return Some(Format::Lfd);
        }
        safetensors::begins_as_safetensors(head).then_some(Format::Safetensors)
    }

    /// The bytes of a dictionary's file. The same dictionary always gives the same bytes.
    ///
    /// # Errors
    /// [`Error::Parameter`] when it is not a valid dictionary.
    pub fn to_bytes(self, dictionary: &Dictionary) -> Result<Vec<u8>, Error> {
        match self {
            Format::Lfd => lfd::to_bytes(dictionary),
            Format::Safetensors => safetensors::to_safetensors(dictionary),
        }
    }
}

/// Writes a dictionary's file, whole or not at all, in the format that [`Format::of`] gives for its name.
///
/// # Errors
/// [`Error::Parameter`] when it is not a valid dictionary; [`Error::Output`] when the file exists (without `force`) or
/// cannot be written.
///
/// ```
/// use lenslet_core::dictionary;
///
/// # let bytes = include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/reference/golden-1.lfd"));
/// # let folder = tempfile::tempdir()?;
/// let dictionary = dictionary::from_bytes(bytes, "golden-1.lfd")?;
/// for name in ["mine.lfd", "mine.safetensors"] {
///     let path = folder.path().join(name);
///     dictionary::save(&path, &dictionary, false)?;
///     assert_eq!(dictionary::load(&path)?, dictionary);
///     assert!(dictionary::save(&path, &dictionary, false).is_err()); // it exists
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn save(path: &Path, dictionary: &Dictionary, force: bool) -> Result<(), Error> {
    Ok(crate::output::write_file(path, force, &Format::of(path).to_bytes(dictionary)?)?)
}

/// Reads a dictionary's file of either format.
///
/// # Errors
/// [`Error::Io`] when it cannot be read, [`Error::NotDictionary`], [`Error::Version`] of a newer lenslet,
/// [`Error::Unsupported`] contents, and [`Error::Malformed`] when it is damaged.
pub fn load(path: &Path) -> Result<Dictionary, Error> {
    let name = path.display().to_string();
    let io = |source| Error::Io { path: name.clone(), source };
    let (file, length) = crate::input::open_regular(path).map_err(io)?;
    if length > limits::FILE {
        return Err(Error::Malformed { path: name, reason: format!("{length} bytes are too many for a dictionary") });
    }
    let mut bytes = Vec::new();
    // The file may grow while it is read.
    file.take(limits::FILE).read_to_end(&mut bytes).map_err(io)?;
    from_bytes(&bytes, &name)
}

/// Reads the bytes of a dictionary's file of either format; errors call it `name`.
///
/// # Errors
/// As [`load`].
///
/// ```
/// use lenslet_core::dictionary::{self, Footprint};
///
/// # let bytes = include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/reference/golden-1.lfd"));
/// let dictionary = dictionary::from_bytes(bytes, "golden-1.lfd")?;
/// let model = dictionary.model(Footprint::Point).expect("it has one");
/// assert_eq!(model.patch_model.low.dim(), (12, 8)); // atoms, features
/// let error = dictionary::from_bytes(b"atoms", "notes.txt").unwrap_err();
/// assert!(error.to_string().starts_with("notes.txt is not a lenslet dictionary"));
/// # Ok::<(), dictionary::Error>(())
/// ```
pub fn from_bytes(bytes: &[u8], name: &str) -> Result<Dictionary, Error> {
    match Format::detect(bytes) {
        Some(Format::Lfd) => lfd::read_lfd(bytes, name),
        Some(Format::Safetensors) => safetensors::read_safetensors(bytes, name),
        None => Err(Error::NotDictionary { path: name.into() }),
    }
}

/// What the models of a dictionary were trained for, read from the header of its file of either format. Fast, and
/// unchecked: whether the file is whole is known only after [`from_bytes`].
///
/// # Errors
/// As [`load`].
///
/// ```
/// use lenslet_core::dictionary::{self, Footprint};
/// use lenslet_core::interpolation::Interpolation;
///
/// # let bytes = include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/reference/golden-1.lfd"));
/// let kinds = dictionary::read_kinds(bytes, "golden-1.lfd")?;
/// assert_eq!((kinds[1].footprint, kinds[1].base), (Footprint::Lenslet, Interpolation::Barycentric));
/// # Ok::<(), dictionary::Error>(())
/// ```
pub fn read_kinds(bytes: &[u8], name: &str) -> Result<Vec<ModelKind>, Error> {
    match Format::detect(bytes) {
        Some(Format::Lfd) => lfd::read_lfd_kinds(bytes, name),
        Some(Format::Safetensors) => safetensors::read_safetensors_kinds(bytes, name),
        None => Err(Error::NotDictionary { path: name.into() }),
    }
}
