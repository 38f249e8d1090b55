//! From a raw mosaic to hexagonally sampled views (paper sections 3.1 and 4): vignetting, demosaic, colour, slicing.
//!
//! Decoding is a list of steps in three stages ([`Steps`]); any of them can be left out or exchanged, to measure what
//! it contributes. All values are linear light; views are encoded for the screen after resampling.

mod aperture;
mod check;
mod chroma_denoise;
mod cokriging;
mod colour;
mod demosaic;
mod error;
mod gamut;
mod hot_pixels;
mod micro_image;
mod mosaic;
mod options;
mod pipeline;
mod raw_stage;
mod samples;
mod samples_file;
mod slice;
mod steps;
mod turn;
mod view_stage;
mod white_balance;

pub use error::Error;
pub use options::{Options, WhiteBalance};
pub use pipeline::sample_views;
pub use samples::HexSamples;
pub use samples_file::{SAMPLES_FILE, SamplesOrigin, find_samples_file, samples_beside, view_fingerprint};
pub use steps::{Demosaic, RawStep, Steps, ViewStep, steps_for};
