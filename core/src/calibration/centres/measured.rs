//! A lenslet as the image shows it: centre, light, and how sure both are.

/// A measured lenslet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredLenslet {
    /// Lattice index along a.
    pub i: i32,
    /// Lattice index along b.
    pub j: i32,
    /// Centre x, pixels.
    pub x: f64,
    /// Centre y, pixels.
    pub y: f64,
    /// Light at the centre.
    pub gain: f64,
    /// Variance of x and y for unit variance of a pixel at the centre, both relative to the gain (see [`MeasuredLenslet::misfit`]).
    pub unit: [f64; 2],
    /// Mean squared residual a degree of freedom, weighted, relative to the gain².
    pub misfit: f64,
    /// Whether the measurement means anything.
    pub usable: bool,
}

impl MeasuredLenslet {
    /// A lenslet found at (`x`, `y`) by other means, with nothing known of its light.
    pub fn from_position(i: i32, j: i32, x: f64, y: f64) -> Self {
        MeasuredLenslet { i, j, x, y, gain: 1.0, unit: [1.0; 2], misfit: 0.0, usable: true }
    }
}

/// Typical misfit of a pixel relative to its lenslet's brightness: what `measure` clips by.
pub fn typical_misfit(measured: &[MeasuredLenslet]) -> f64 {
    let mut all: Vec<f64> = measured.iter().filter(|m| m.usable).map(|m| m.misfit).collect();
    if all.is_empty() {
        return f64::INFINITY;
    }
    let half = all.len() / 2;
    all.select_nth_unstable_by(half, f64::total_cmp).1.sqrt()
}
