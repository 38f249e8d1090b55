//! A lenslet as the lattice predicts it: the start of its measurement.

/// A predicted lenslet: where to measure, and in what light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictedLenslet {
    /// Lattice index along a.
    pub i: i32,
    /// Lattice index along b.
    pub j: i32,
    /// Predicted centre x, pixels.
    pub x: f64,
    /// Predicted centre y, pixels.
    pub y: f64,
    /// Light at the centre (the image's units); 1 where it is not known yet.
    pub gain: f64,
    /// Relative slope of the illumination along x and y, (∂F/∂x, ∂F/∂y)/F, 1/pixel.
    pub slope: [f64; 2],
}
