//! Photos one after the other: the way from files and folders to whatever is made of each photo.

use std::path::{Path, PathBuf};

use lenslet_core::dictionary::Photo;
use lenslet_core::lightfield::ColourSpace;
use lenslet_core::progress::{Interrupted, Observer};

use super::error::Error;
use super::find::find_photos;
use super::luminance::{LuminancePhoto, load_luminance};

/// Shortest side of a usable photo, pixels.
/// Source: chosen; a crop with its borders is hardly smaller.
pub const LEAST_SIDE: usize = 64;

/// The photos of a call. One of them is in memory at a time.
#[derive(Debug, Clone)]
pub struct PhotoSet {
    files: Vec<PathBuf>,
    encoding: ColourSpace,
}

/// What became of the photos of a set.
#[derive(Debug, Clone, Default)]
pub struct PhotoReport {
    /// The photos that were used, in order.
    pub used: Vec<Photo>,
    /// Those that were left out, and why.
    pub skipped: Vec<String>,
}

impl PhotoSet {
    /// Files as given, and the photos inside folders as given; their values are sRGB-encoded or linear.
    ///
    /// # Errors
    /// As [`find_photos`], and [`Error::NoPhoto`].
    pub fn find(inputs: &[PathBuf], encoding: ColourSpace) -> Result<PhotoSet, Error> {
        let files = find_photos(inputs)?;
        if files.is_empty() {
            let places: Vec<String> = inputs.iter().map(|p| p.display().to_string()).collect();
            return Err(Error::NoPhoto { places: places.join(", ") });
        }
        Ok(PhotoSet { files, encoding })
    }

    /// Number of files, usable or not.
    pub fn len(&self) -> usize {
        self.files.len()
    }

    /// Whether there is no file.
    pub fn is_empty(&self) -> bool {
        self.files.is_empty()
    }

    /// Calls `visit` for every usable photo with its number among those, its path and its luminance. A photo that
    /// cannot be used is noted and left out.
    ///
    /// # Errors
    /// [`Error::NoUsablePhoto`], interruption, errors of `visit`.
    ///
    /// ```
    /// use lenslet_core::lightfield::ColourSpace;
    /// use lenslet_core::progress::Silent;
    /// use lenslet_data_gen::photo::{Error, PhotoSet};
    /// let folder = tempfile::tempdir()?;
    /// image::GrayImage::from_fn(80, 70, |x, y| image::Luma([(x + y) as u8])).save(folder.path().join("a.png"))?;
    /// std::fs::write(folder.path().join("b.png"), "no picture")?;
    /// let set = PhotoSet::find(&[folder.path().to_path_buf()], ColourSpace::Srgb)?;
    /// let mut sizes = Vec::new();
    /// let report = set.for_each(&Silent, |_, _, photo| {
    ///     sizes.push(photo.luminance.dim());
    ///     Ok::<(), Error>(())
    /// })?;
    /// assert_eq!((set.len(), sizes, report.used[0].file.as_str()), (2, vec![(70, 80)], "a.png"));
    /// assert!(report.skipped[0].contains("b.png"));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn for_each<E: From<Error> + From<Interrupted>>(
        &self,
        observer: &dyn Observer,
        mut visit: impl FnMut(usize, &Path, &LuminancePhoto) -> Result<(), E>,
    ) -> Result<PhotoReport, E> {
        let mut report = PhotoReport::default();
        observer.begin("photos", self.files.len() as u64);
        for path in &self.files {
            observer.check()?;
            observer.advance(1);
            match load_luminance(path, LEAST_SIDE, self.encoding) {
                Ok(photo) => {
                    visit(report.used.len(), path, &photo)?;
                    report.used.push(Photo { file: photo.name, sha256: photo.sha256 });
                }
                Err(e) => {
                    let note = format!("left out: {e}");
                    observer.note(&note);
                    report.skipped.push(note);
                }
            }
        }
        if report.used.is_empty() {
            let skipped = report.skipped.join("; ");
            return Err(Error::NoUsablePhoto { count: self.files.len(), skipped }.into());
        }
        Ok(report)
    }
}
