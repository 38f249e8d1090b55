//! Noise as a function of brightness.

/// A piecewise linear curve of noise (a standard deviation or a variance, whatever its maker measured) over brightness;
/// constant beyond its first and last knot.
///
/// ```
/// use lenslet_core::noise::NoiseCurve;
///
/// let curve = NoiseCurve::new(vec![(0.2, 0.01), (0.6, 0.03)]);
/// assert!((curve.noise_at(0.4) - 0.02).abs() < 1e-6);
/// assert_eq!((curve.noise_at(0.0), curve.noise_at(1.0)), (0.01, 0.03));
/// assert_eq!(NoiseCurve::constant(0.05).noise_at(0.7), 0.05);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct NoiseCurve {
    /// (brightness, noise), by brightness.
    knots: Vec<(f32, f32)>,
}

impl NoiseCurve {
    /// From knots (brightness, noise) in ascending order of brightness; none of them means no noise.
    #[must_use]
    pub fn new(knots: Vec<(f32, f32)>) -> Self {
        NoiseCurve { knots }
    }

    /// The same noise at every brightness.
    #[must_use]
    pub fn constant(noise: f32) -> Self {
        NoiseCurve { knots: vec![(0.0, noise)] }
    }

    /// The noise at a brightness; that of the first knot where the brightness is not a number.
    #[must_use]
    pub fn noise_at(&self, brightness: f32) -> f32 {
        let after = self.knots.partition_point(|k| k.0 <= brightness);
        match (after.checked_sub(1).and_then(|k| self.knots.get(k)), self.knots.get(after)) {
            (Some(a), Some(b)) => a.1 + (b.1 - a.1) * (brightness - a.0) / (b.0 - a.0),
            (Some(k), None) | (None, Some(k)) => k.1,
            (None, None) => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn knots_are_met_and_ends_are_flat() {
        let curve = NoiseCurve::new(vec![(0.1, 3.0), (0.5, 1.0), (0.5, 2.0), (0.9, 4.0)]);
        for (brightness, noise) in [(-1.0, 3.0), (0.1, 3.0), (0.3, 2.0), (0.7, 3.0), (0.9, 4.0), (f32::INFINITY, 4.0)] {
            assert!((curve.noise_at(brightness) - noise).abs() < 1e-5, "{brightness}");
        }
        assert_eq!(curve.noise_at(f32::NAN), 3.0);
        assert_eq!(NoiseCurve::new(Vec::new()).noise_at(0.5), 0.0);
    }
}
