//! Planes of floats, and how they are read between their pixels.

mod bilinear;
mod box_mean;
mod gaussian;
mod guided_filter;
mod keys;
mod plane;

pub use bilinear::{
    Cell, Position, bilinear_by_differences, bilinear_by_weights, bilinear_shares, bilinear_with_slopes,
};
pub use box_mean::{box_mean, box_mean_in_bands};
pub use gaussian::GaussianFilter;
pub use guided_filter::{BoxMeans, GuidedFilter};
pub use keys::{catmull_rom_weights, keys_kernel, keys_weights};
pub use plane::Plane;
