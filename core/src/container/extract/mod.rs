//! Everything a container, calibration bundle or archive holds, as files in a folder: under safe names, never outside
//! of it.

mod files;
mod names;
mod plan;

pub use files::{Extracted, extract};
pub use names::safe_path;
