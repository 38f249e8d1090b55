//! What goes wrong in calibration, by whose fault.

/// What goes wrong when a camera is calibrated or a calibration is read.
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
    /// Too little light to see anything.
    #[error("the image is black (its mean is {percent:.2} % of full scale); give a brighter white image")]
    Black {
        /// Mean light, per cent of full scale.
        percent: f64,
    },
    /// Too much light to see anything.
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
    /// The image does not show a lenslet pattern.
    #[error(
        "no lenslet pattern found ({reason}); is this a white image of a lenslet camera, as it came from the sensor?"
    )]
    NoPattern {
        /// What was looked for and not found.
        reason: String,
    },
    /// A calibration and a capture that do not belong together.
    #[error("the calibration does not fit this capture: {0}")]
    WrongCamera(String),
    /// A parameter out of range.
    #[error("{0}")]
    Parameter(String),
    /// The observer asked to stop.
    #[error("interrupted")]
    Interrupted,
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
