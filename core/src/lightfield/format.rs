//! The formats of light fields on disk.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use super::axes::Axes;
use super::colour::ColourSpace;
use super::error::Error;
use super::view_order::ViewOrder;

/// How a light field is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// `lightfield.json` and one 16-bit PNG per view.
    Directory,
    /// One .npy, f32, shape (v, u, t, s, c).
    Npy,
    /// One MATLAB file of level 5 with the variable `LF` (v, u, t, s, c), single, 0..1.
    Mat,
    /// One 16-bit PNG with the views interleaved, a lenslet's views side by side.
    Eslf,
}

impl Format {
    /// All of them.
    pub const ALL: [Format; 4] = [Format::Directory, Format::Npy, Format::Mat, Format::Eslf];

    /// Its name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Format::Directory => "dir",
            Format::Npy => "npy",
            Format::Mat => "mat",
            Format::Eslf => "eslf",
        }
    }

    /// The format given by the ending of a file name; [`Format::Directory`] for any other ending, and without one.
    ///
    /// ```
    /// use lenslet_core::lightfield::Format;
    /// use std::path::Path;
    ///
    /// assert_eq!(Format::of_name(Path::new("views.NPY")), Format::Npy);
    /// assert_eq!(Format::of_name(Path::new("views.lf")), Format::Directory);
    /// ```
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
        let text = if text == "directory" { "dir" } else { text };
        let unknown = || Error::Parameter(format!("unknown light field format `{text}`: dir, npy, mat or eslf"));
        Format::ALL.into_iter().find(|f| f.name() == text).ok_or_else(unknown)
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// How to read files that lack a description.
#[derive(Debug, Clone, Default)]
pub struct ReadOptions {
    /// Views (rows, columns) of files that do not state them (ESLF and other lenslet images).
    pub views: Option<[usize; 2]>,
    /// Colour space of files that do not state it; sRGB when absent. Lenslet's own directory states it.
    pub colour: Option<ColourSpace>,
    /// The stored value that is 1.0 (255, 1023, 65535, …) of arrays and pictures without a description; found from the
    /// type and the range of the numbers when absent.
    pub full_scale: Option<f32>,
    /// The order of the axes of arrays; when absent (v, u, t, s, c), (v, u, t, s), or (n, t, s, c) with views in a row.
    pub axes: Option<Axes>,
    /// The order of views; when absent that of the description, else found by the parallax of the pictures, else rows
    /// first. Not looked for with `header_only`.
    pub order: Option<ViewOrder>,
    /// Also take folders in which views of a full grid are absent: these have weight 0, and cannot be read
    /// ([`ViewSource::is_absent`](super::ViewSource::is_absent)); read whole ([`load`](super::load)) their values are 0.
    /// Refused when false.
    pub partial: bool,
    /// Only look at headers: the description is read, numbers are not, and reading views may fail.
    pub header_only: bool,
    /// [`load`](super::load) refuses a light field of more bytes than this (as f32); 0, the default, means 8 GiB.
    pub max_bytes: u64,
}
