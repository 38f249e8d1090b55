//! Training pairs from photos, and simulated captures with their truth.

pub mod pairs;
pub mod simulate;
