//! From samples to views by any method: an interpolation, learned reconstruction on top or not, one view or all.

mod builder;
mod interpolated_views;
mod learned_views;
mod render;
mod working_size;

pub use builder::{RenderSamples, RendererBuilder};
pub use interpolated_views::InterpolatedViews;
pub use learned_views::LearnedViews;
pub use render::Renderer;
pub use working_size::working_size;
