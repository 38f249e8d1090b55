//! The texels of which layers are made.

/// Texels of one layer at most: 512 MiB.
pub(super) const MOST_TEXELS: f64 = 32e6;

/// Side of a texel, standard deviations of the footprint.
///
/// Source: chosen; box, Gaussian and spline together have the footprint's variance.
pub(super) const TEXEL: f64 = 0.8;
