//! White images: which of those in a calibration folder, bundle or archive belongs to a capture.
//!
//! By sha1 where the capture names one; else the same serial number, the nearest zoom step, then the nearest focus
//! step. Black images, dark ones (mean under 500 of 4095) and the darker exposure of a pair are passed over.

mod choice;
mod image;
mod list;

pub use choice::{WhiteChoice, black_images, choose_white_image, find_white_image};
pub use image::{CalibrationImage, ExposureClass};
pub use list::{CalibrationImages, list_calibration_images};
