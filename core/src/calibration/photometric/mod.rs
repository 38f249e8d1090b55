//! Light per pixel: equal colour channels, hot pixels, the vignetting pattern.

pub mod equalise;
pub mod hot_pixels;
pub mod micro_image;
pub mod texture;
pub mod vignetting;
