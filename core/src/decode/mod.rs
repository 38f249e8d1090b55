//! From a raw mosaic to hexagonally sampled views (paper sections 3.1 and 4): vignetting, demosaic, colour, slicing.

use ndarray::Array3;

/// Hexagonal samples: one value a lenslet of each view, before any resampling. Linear light.
#[derive(Debug, Clone, PartialEq)]
pub struct HexSamples {
    /// Sensor size (width, height) in pixels: the frame of `centres`.
    pub sensor: (usize, usize),
    /// Lenslet centres (x, y) in sensor pixels, pixel centres at integers. They place the samples of *every* view.
    pub centres: Vec<[f64; 2]>,
    /// Lattice index (i, j) of each lenslet.
    pub index: Vec<[i32; 2]>,
    /// Views a row and a column (odd): view (v, u) has index `(v + n/2)·n + u + n/2`.
    pub views: usize,
    /// Sensor pixels between neighbouring views.
    pub view_step: f64,
    /// Values, shape (views², lenslets, channels).
    pub values: Array3<f32>,
}
