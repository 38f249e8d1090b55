//! Where a lenslet is expected, and in what light: what measuring starts from.

/// A place to measure at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictedLenslet {
    /// Lattice index along a.
    pub i: i32,
    /// Lattice index along b.
    pub j: i32,
    /// Predicted centre x.
    pub x: f64,
    /// Predicted centre y.
    pub y: f64,
    /// Light at the centre, if known (else 1).
    pub gain: f64,
    /// Relative slope of the broad light (1/pixel) along x and y.
    pub slope: [f64; 2],
}
