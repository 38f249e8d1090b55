//! From hexagonal samples to views in high resolution (paper section 4): disparity, interpolation of single views,
//! refinement by all views, and learned reconstruction with a dictionary on top of either.
//!
//! [`RenderSamples::renderer`] is the way in: `samples.renderer(Method::multiview().learned()).prepare()?.view(3, 3)?`.
//! Nothing here prints, exits or depends on a command line; errors are typed ([`Error`]). Parallel loops run on the
//! caller's rayon pool.

pub mod assess;
mod buckets;
pub mod disparity;
mod error;
pub mod interpolate;
pub mod inverse;
mod method;
pub mod multiview;
pub mod reconstruct;
mod renderer;
mod target;

pub use error::Error;
pub use method::{Learned, Method};
pub use renderer::{InterpolatedViews, LearnedViews, RenderSamples, Renderer, RendererBuilder, working_size};
pub use target::{PixelSink, Sink, mean_pitch, native_size, view_pitch};
