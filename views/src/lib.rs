//! From hexagonal samples to views in high resolution (paper section 4): disparity, interpolation of single views,
//! refinement by all views, and learned reconstruction with a dictionary on top of either.
//!
//! Nothing here prints, exits or knows a command line; errors are typed ([`Error`]). Parallel loops run on the caller's rayon pool.

pub mod disparity;
pub mod encode;
mod error;
pub mod interpolate;
pub mod multiview;
pub mod reconstruct;
mod renderer;
mod target;

pub use error::Error;
pub use renderer::{Method, RenderOptions, render, working_size};
pub use target::{Sink, Target, pitch};
