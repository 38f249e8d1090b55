//! Errors of calibration, by cause: images, cameras, parameters, files.

/// Errors of calibrating a camera, and of reading or writing a calibration.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No image was given.
    #[error("no image was given to calibrate from")]
    NoImages,
    /// An image too small to hold a pattern, or whose pixels do not fit its size.
    #[error("image {index} ({width}x{height}) cannot be calibrated: {reason}")]
    BadImage {
        /// Which of the images, counted from 1.
        index: usize,
        /// Its width in pixels.
        width: usize,
        /// Its height in pixels.
        height: usize,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// Images of several sizes.
    #[error("image {index} is {got_width}x{got_height} but the first is {width}x{height}; give images of one camera")]
    SizesDiffer {
        /// Which of the images, counted from 1.
        index: usize,
        /// Its width.
        got_width: usize,
        /// Its height.
        got_height: usize,
        /// Width of the first.
        width: usize,
        /// Height of the first.
        height: usize,
    },
    /// Images of several cameras.
    #[error("image {index} is of camera {got}, the first of camera {expected}; calibrate one camera at a time")]
    CamerasDiffer {
        /// Which of the images, counted from 1.
        index: usize,
        /// Serial number found.
        got: String,
        /// Serial number of the first.
        expected: String,
    },
    /// Too little light to find lenslets.
    #[error("the image is black (its mean is {percent:.2} % of full scale); give a brighter white image")]
    Black {
        /// Mean light, per cent of full scale.
        percent: f64,
    },
    /// Too many saturated pixels to find lenslets.
    #[error("the image is saturated ({percent:.0} % of its pixels are at the white level); give a darker white image")]
    Saturated {
        /// Share of pixels at the white level, per cent.
        percent: f64,
    },
    /// An image given as black that has light on it.
    #[error("image {index} is not black: take it with the lens covered, or leave it out")]
    NotBlack {
        /// Which of the images, counted from 1.
        index: usize,
    },
    /// An image given as white that shows a scene.
    #[error(
        "image {index} is no white image: a scene shows in it (neighbouring lenslets differ by {percent:.0} %); give white \
         images, captures of an evenly lit white surface, or calibrate from ordinary captures with --from-captures"
    )]
    NotWhite {
        /// Which of the images, counted from 1.
        index: usize,
        /// How much the light of a lenslet differs from its neighbours', per cent.
        percent: f64,
    },
    /// The image does not show a lenslet pattern.
    #[error(
        "no lenslet pattern found ({reason}); is this a white image of a lenslet camera, as it came from the sensor?"
    )]
    NoPattern {
        /// What was looked for and not found.
        reason: String,
    },
    /// The calibration is of another camera than the capture: sensor size, serial number or model differ.
    #[error("the calibration does not fit this capture: {0}")]
    WrongCamera(String),
    /// A parameter out of range.
    #[error("{0}")]
    Parameter(String),
    /// The observer cancelled the work.
    #[error(transparent)]
    Interrupted(#[from] crate::progress::Interrupted),
    /// A capture that calibration begins from cannot be opened; the message names the file.
    #[error(transparent)]
    Capture(#[from] crate::container::Error),
    /// An error together with the file it concerns.
    #[error("{}: {error}", path.display())]
    InFile {
        /// The capture concerned.
        path: std::path::PathBuf,
        /// What went wrong.
        error: Box<Error>,
    },
    /// Reading a file failed.
    #[error("cannot read {path}: {source}")]
    Read {
        /// Which file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// The file is not a calibration, or a broken one.
    #[error("{path} is not a usable calibration: {reason}")]
    Malformed {
        /// Which file.
        path: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The file was made by a later version of this program.
    #[error(
        "{path} is a calibration of format {found}, this program reads up to {known}; update lenslet, or calibrate again"
    )]
    Newer {
        /// Which file.
        path: String,
        /// Format version found.
        found: u32,
        /// Newest format version known here.
        known: u32,
    },
    /// Writing the file failed.
    #[error(transparent)]
    Output(#[from] crate::output::Error),
}

impl Error {
    /// Which of the images the error concerns, counted from 0; `None` where it concerns all of them or none.
    pub fn image_index(&self) -> Option<usize> {
        match self {
            Error::BadImage { index, .. }
            | Error::SizesDiffer { index, .. }
            | Error::CamerasDiffer { index, .. }
            | Error::NotBlack { index }
            | Error::NotWhite { index, .. } => index.checked_sub(1),
            _ => None,
        }
    }

    /// Adds the file the error concerns: that of the image it names, else the first; `paths` are those of the images,
    /// in order. Interruption stays as it is.
    #[must_use]
    pub fn in_file_of(self, paths: &[std::path::PathBuf]) -> Error {
        match paths.get(self.image_index().unwrap_or(0)) {
            Some(path) if !matches!(self, Error::Interrupted(_)) => {
                Error::InFile { path: path.clone(), error: Box::new(self) }
            }
            _ => self,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_of_the_image_is_named_but_for_an_interruption() {
        let paths = ["a.lfp", "b.lfp"].map(std::path::PathBuf::from);
        let named = |error: Error| match error.in_file_of(&paths) {
            Error::InFile { path, .. } => Some(path),
            _ => None,
        };
        assert_eq!(named(Error::NotBlack { index: 2 }), Some(paths[1].clone()));
        assert_eq!(named(Error::NotBlack { index: 0 }), Some(paths[0].clone()));
        assert_eq!(named(Error::NoImages), Some(paths[0].clone()));
        assert_eq!(named(Error::Interrupted(crate::progress::Interrupted)), None);
        assert_eq!(named(Error::NotBlack { index: 3 }), None);
    }
}
