//! The interface of every interpolation of single views.

use std::fmt::Debug;

use ndarray::{Array3, ArrayView2};

use crate::Error;

/// An interpolation prepared for one lattice and one size; it serves every view and every capture of the camera.
pub trait ViewInterpolator: Debug + Send + Sync {
    /// One view (t, s, c) from its values (lenslets, c). Linear in the values; nothing is clamped.
    ///
    /// # Errors
    /// Another number of values than the lattice has lenslets.
    fn interpolate_view(&self, values: ArrayView2<'_, f32>) -> Result<Array3<f32>, Error>;
}
