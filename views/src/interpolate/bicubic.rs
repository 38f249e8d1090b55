//! Section 4.1, the paper's baseline: a regular grid of about one value a pitch first, then bicubic to the target.

use lenslet_core::decode::HexSamples;
use lenslet_core::sampling::{Weights, bicubic};
use ndarray::{Array3, ArrayView2};

use crate::Error;
use crate::target::Target;

/// What the two passes need.
#[derive(Debug, Clone)]
pub struct Prepared {
    low: Weights,
    target: Target,
}

/// The low-resolution grid's table.
///
/// # Errors
/// Centres that cannot be triangulated.
pub fn prepare(samples: &HexSamples, target: &Target) -> Result<Prepared, Error> {
    let low = Target::native(samples);
    Ok(Prepared { low: Weights::new(&samples.centres, samples.sensor, (low.width, low.height))?, target: *target })
}

/// One view (t, s, c) from its values (lenslets, c).
///
/// # Errors
/// Values that do not belong to the table, a target out of range.
pub fn view(prepared: &Prepared, values: ArrayView2<'_, f32>) -> Result<Array3<f32>, Error> {
    let low = prepared.low.apply(values)?;
    Ok(bicubic::resize(low.view(), prepared.target.width, prepared.target.height)?)
}
