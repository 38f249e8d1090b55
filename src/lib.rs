//! Light fields in high resolution: the four resampling methods, learned reconstruction, and what a light field is for.

pub mod ablation;
pub mod apps;
pub mod infer;
pub mod report;
pub mod resample;
