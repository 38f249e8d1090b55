//! What a light field is for: refocusing, depth, moving the viewpoint, a page to play with.

pub mod depth;
mod error;
mod even_light;
mod linear_light;
pub mod refocus;
#[cfg(feature = "pages")]
pub mod viewer;
pub mod viewpoint;

pub use error::Error;
pub use even_light::{even_out_light, fill_dark_views};
pub use linear_light::to_linear_light;
