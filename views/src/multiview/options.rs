//! How views are refined by all the others.

use crate::disparity;

/// How the image is made of the scattered samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Fit {
    /// Weighted least-squares pixels, single-view interpolation as the prior.
    #[default]
    Smooth,
    /// As in the paper: triangulate all samples, interpolate barycentrically. Takes seconds a view; kept for
    /// comparison.
    Triangulation,
}

impl Fit {
    /// Name on the command line and in records.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Fit::Smooth => "least-squares",
            Fit::Triangulation => "triangulation",
        }
    }
}

/// How views are refined.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How the image is made of the samples; default [`Fit::Smooth`].
    pub fit: Fit,
    /// How disparity is estimated; `range` and `limit` are in pixels of the target view per view step. The default is
    /// that of [`disparity::Options`], for linear light.
    pub disparity: disparity::Options,
    /// Disparity of the middle view where it is known beforehand, shape (t, s) of any size, pixels of the target view
    /// per view step; `None`, the default: estimated.
    pub known: Option<ndarray::Array2<f32>>,
}

impl Default for Options {
    fn default() -> Self {
        let disparity = disparity::Options { linear: true, side: SIDE, ..disparity::Options::default() };
        Options { fit: Fit::default(), disparity, known: None }
    }
}

/// Longer side of the views in which disparity is searched, pixels.
///
/// Source: chosen for speed.
const SIDE: usize = 640;
