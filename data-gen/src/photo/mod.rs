//! Photos: found in folders, decoded upright, as planes of luminance, made smaller.

mod decode;
mod error;
mod find;
mod luminance;
mod reduce;
mod set;

pub(crate) use decode::decode_photo;
pub use error::Error;
pub use find::find_photos;
pub use luminance::{LuminancePhoto, load_luminance};
pub use reduce::{ReductionKernel, reduce_plane};
pub use set::{LEAST_SIDE, PhotoReport, PhotoSet};
