//! A cubic C¹ surface through the same samples: a fair, stronger baseline than the paper's two plain methods.

use lenslet_core::decode::HexSamples;
use lenslet_core::sampling::Cubic;
use ndarray::{Array3, ArrayView2};

use crate::Error;
use crate::target::Target;

/// The surface's tables for these centres and this target.
///
/// # Errors
/// Centres that cannot be triangulated, a target out of range.
pub fn prepare(samples: &HexSamples, target: &Target) -> Result<Cubic, Error> {
    Ok(Cubic::new(&samples.centres, samples.sensor, (target.width, target.height))?)
}

/// One view (t, s, c) from its values (lenslets, c).
///
/// # Errors
/// Values that do not belong to the tables.
pub fn view(prepared: &Cubic, values: ArrayView2<'_, f32>) -> Result<Array3<f32>, Error> {
    Ok(prepared.apply(values)?)
}
