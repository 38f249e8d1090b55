//! Raw captures of lenslet light-field cameras to high-resolution light fields, and what a light field is for.
//!
//! This crate gathers the ones below it and adds [`apps`]: refocusing, depth, views from between the views, a page to play
//! with. The `lenslet` program, behind the feature `cli`, is built on it.

pub mod apps;
pub mod image_io;
#[cfg(feature = "pages")]
pub mod page;
pub mod prelude;

pub use lenslet_core::{
    calibration, container, decode, dictionary, interpolation, lightfield, metrics, output, progress, sampling, sparse,
};
pub use lenslet_views::{self as views, disparity, interpolate, multiview, reconstruct};
