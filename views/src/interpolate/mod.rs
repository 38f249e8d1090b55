//! Single views from their own samples (paper sections 4.1 and 4.2, and a C¹ cubic surface as a stronger baseline).
//!
//! Every interpolation prepares once for a lattice and a target size ([`prepare_interpolator`]), then makes view after
//! view.

mod barycentric;
mod bicubic;
mod cubic;
mod interpolator;

use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;

use crate::Error;

pub use barycentric::Barycentric;
pub use bicubic::Bicubic;
pub use cubic::Cubic;
pub use interpolator::ViewInterpolator;

/// Prepares the interpolation of single views of `samples` at the size `target`.
///
/// # Errors
/// [`Interpolation::Multiview`], which needs all views ([`crate::multiview::RefinedViews`]); centres that cannot be
/// triangulated; a size out of range.
pub fn prepare_interpolator(
    interpolation: Interpolation,
    samples: &HexSamples,
    target: &Size,
) -> Result<Box<dyn ViewInterpolator>, Error> {
    Ok(match interpolation {
        Interpolation::Bicubic => Box::new(Bicubic::prepare(samples, target)?),
        Interpolation::Barycentric => Box::new(Barycentric::prepare(samples, target)?),
        Interpolation::Cubic => Box::new(Cubic::prepare(samples, target)?),
        Interpolation::Multiview => {
            return Err(Error::Parameter("multi-view refinement does not work on a single view".into()));
        }
    })
}
