//! Section 4.2: barycentric interpolation on the triangulated centres, straight at the target resolution (eq. 1, 2).

use lenslet_core::decode::HexSamples;
use lenslet_core::sampling::Weights;
use ndarray::{Array3, ArrayView2};

use crate::Error;
use crate::target::Target;

/// The weight table for these centres and this target; good for every view and every capture of the camera.
///
/// # Errors
/// Centres that cannot be triangulated, a target out of range.
pub fn prepare(samples: &HexSamples, target: &Target) -> Result<Weights, Error> {
    Ok(Weights::new(&samples.centres, samples.sensor, (target.width, target.height))?)
}

/// One view (t, s, c) from its values (lenslets, c).
///
/// # Errors
/// Values that do not belong to the table.
pub fn view(prepared: &Weights, values: ArrayView2<'_, f32>) -> Result<Array3<f32>, Error> {
    Ok(prepared.apply(values)?)
}
