//! A lenslet as the image shows it: centre, light, and the variance of the centre.

/// A measured lenslet. The variance of its centre along axis k is `unit[k]·misfit`, pixels².
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
    /// Variance of x and y (pixels²) if a pixel at the centre had unit variance relative to gain².
    pub unit: [f64; 2],
    /// Weighted mean squared residual per degree of freedom, relative to gain².
    pub misfit: f64,
    /// Whether the measurement succeeded.
    pub usable: bool,
}

impl MeasuredLenslet {
    /// A lenslet whose centre (`x`, `y`) comes from elsewhere (a paraboloid, a mean), its light unknown.
    pub fn from_position(i: i32, j: i32, x: f64, y: f64) -> Self {
        MeasuredLenslet { i, j, x, y, gain: 1.0, unit: [1.0; 2], misfit: 0.0, usable: true }
    }
}

/// Square root of the median misfit: the typical residual of a pixel as a share of its lenslet's light. Infinite
/// without usable lenslets.
pub fn typical_misfit(measured: &[MeasuredLenslet]) -> f64 {
    let mut all: Vec<f64> = measured.iter().filter(|m| m.usable).map(|m| m.misfit).collect();
    if all.is_empty() {
        return f64::INFINITY;
    }
    let half = all.len() / 2;
    all.select_nth_unstable_by(half, f64::total_cmp).1.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_typical_misfit_is_the_root_of_the_median_of_usable_lenslets() {
        let mut all = [1.0, 25.0, 9.0, 4.0]
            .map(|misfit| MeasuredLenslet { misfit, ..MeasuredLenslet::from_position(0, 0, 1.0, 2.0) });
        all[0].usable = false;
        assert_eq!(typical_misfit(&all), 3.0);
        assert_eq!(typical_misfit(&all[..1]), f64::INFINITY);
        assert_eq!(MeasuredLenslet::from_position(0, 0, 1.0, 2.0).misfit, 0.0);
    }
}
