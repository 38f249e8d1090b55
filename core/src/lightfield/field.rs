//! A light field in memory.

use ndarray::Array5;

use super::meta::Meta;

/// A whole light field in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct LightField {
    /// Its description.
    pub meta: Meta,
    /// Values nominally 0..1, shape (v, u, t, s, c).
    pub data: Array5<f32>,
}
