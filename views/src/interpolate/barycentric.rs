//! Section 4.2: barycentric interpolation on the triangulated centres, straight at the target resolution (eq. 1, 2).

use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::sampling::Weights;
use ndarray::{Array3, ArrayView2};

use super::interpolator::ViewInterpolator;
use crate::Error;

/// Three lenslets and their weights for every pixel.
#[derive(Debug, Clone)]
pub struct Barycentric(Weights);

impl Barycentric {
    /// The weight table for the centres of `samples` at the size `target`.
    ///
    /// # Errors
    /// Centres that cannot be triangulated, a size out of range.
    pub fn prepare(samples: &HexSamples, target: &Size) -> Result<Self, Error> {
        Ok(Barycentric(Weights::new(&samples.centres, samples.sensor, *target)?))
    }
}

impl ViewInterpolator for Barycentric {
    fn interpolate_view(&self, values: ArrayView2<'_, f32>) -> Result<Array3<f32>, Error> {
        Ok(self.0.apply(values)?)
    }
}
