//! Scores of pictures: PSNR and SSIM against a truth, sharpness and jaggedness of edges, contrast of patterns,
//! agreement of views, and the registration that makes results of other tools comparable.
//!
//! [`Scores::between`] gives the three numbers that every table of this project shows.

mod align;
mod consistency;
mod edge;
mod error;
mod pattern;
mod psnr;
mod scores;
mod ssim;
mod window;

pub use align::Alignment;
pub use consistency::view_consistency;
pub use edge::{Edge, slanted_edge};
pub use error::Error;
pub use pattern::{Pattern, pattern_contrast};
pub use psnr::{mean_squared_error, psnr};
pub use scores::Scores;
pub use ssim::{SsimWindow, ssim, ssim_map_plain};
pub use window::{BORDER, Window};
