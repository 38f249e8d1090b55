//! Section 4.1, the paper's baseline: a regular grid of about one value a pitch first, then bicubic to the target.

use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::sampling::{Weights, bicubic};
use ndarray::{Array3, ArrayView2};

use super::interpolator::ViewInterpolator;
use crate::Error;
use crate::target::native_size;

/// The low-resolution grid's table, and the size of the result.
#[derive(Debug, Clone)]
pub struct Bicubic {
    low: Weights,
    target: Size,
}

impl Bicubic {
    /// The table of the low-resolution grid for the centres of `samples`.
    ///
    /// # Errors
    /// Centres that cannot be triangulated.
    pub fn prepare(samples: &HexSamples, target: &Size) -> Result<Self, Error> {
        let low = native_size(samples);
        let low = Weights::new(&samples.centres, samples.sensor, (low.width, low.height))?;
        Ok(Bicubic { low, target: *target })
    }
}

impl ViewInterpolator for Bicubic {
    fn interpolate_view(&self, values: ArrayView2<'_, f32>) -> Result<Array3<f32>, Error> {
        let low = self.low.apply(values)?;
        Ok(bicubic::resize_bicubic(low.view(), self.target.width, self.target.height)?)
    }
}
