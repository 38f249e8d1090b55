//! The trait of all predictors of residual patches.

use ndarray::Array2;

use super::super::error::Error;
use super::super::features::extract_features;
use super::super::patch_model::PatchModel;
use super::super::side_input::SideInput;

/// Predicts the residual patches (high − low) around places of a plane.
pub(crate) trait PredictPatches: std::fmt::Debug + Send + Sync {
    /// What was learned.
    fn patch_model(&self) -> &PatchModel;

    /// Side of the window that is read around each place (odd), pixels.
    fn support(&self) -> usize {
        self.patch_model().support
    }

    /// Side of the residual patch (odd), pixels.
    fn patch(&self) -> usize {
        self.patch_model().patch
    }

    /// The images of the view that are inputs besides the low one.
    fn side_inputs(&self) -> &[SideInput] {
        &[]
    }

    /// Residual patches (n×patch²) of the windows whose top left corners are `corners` (y, x) of padded planes: the low
    /// image, then for each side input its difference to the low image.
    fn predict(&self, padded: &[Array2<f32>], corners: &[(usize, usize)]) -> Result<Array2<f32>, Error>;
}

/// Features (n×m) of the windows of the low image, the first of `padded`, whose top left corners are `corners` (y, x).
pub(super) fn low_features(parts: &PatchModel, padded: &[Array2<f32>], corners: &[(usize, usize)]) -> Array2<f32> {
    extract_features(&padded[..1], parts.support, &parts.filters, &[parts.filters.nrows()], corners)
}
