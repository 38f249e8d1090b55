//! Pictures for the screen and for files: views to 8-bit sRGB, encoded in memory as PNG, JPEG, animated PNG or animated
//! GIF.

mod animation;
mod error;
mod picture;
mod shrink;
mod still;

pub use animation::apng;
#[cfg(feature = "gif")]
pub use animation::gif;
pub use error::Error;
pub use picture::Picture;
pub use shrink::shrink;
pub use still::grey16_png;
