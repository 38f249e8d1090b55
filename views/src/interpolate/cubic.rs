//! A cubic C¹ surface through the same samples: a stronger baseline than the two plain methods of the paper.

use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::sampling;
use ndarray::{Array3, ArrayView2};

use super::interpolator::ViewInterpolator;
use crate::Error;

/// Coefficients of the surface for every pixel.
#[derive(Debug, Clone)]
pub struct Cubic(sampling::Cubic);

impl Cubic {
    /// The surface's tables for the centres of `samples` at the size `target`.
    ///
    /// # Errors
    /// Centres that cannot be triangulated, a size out of range.
    pub fn prepare(samples: &HexSamples, target: &Size) -> Result<Self, Error> {
        Ok(Cubic(sampling::Cubic::new(&samples.centres, samples.sensor, *target)?))
    }
}

impl ViewInterpolator for Cubic {
    fn interpolate_view(&self, values: ArrayView2<'_, f32>) -> Result<Array3<f32>, Error> {
        Ok(self.0.apply(values)?)
    }
}
