//! Light fields in high resolution: the four resampling methods, learned reconstruction, and what a light field is for.

pub mod ablation;
pub mod apps;
pub mod report;

pub use lenslet_views::{disparity, multiview, reconstruct};
