//! Patches by anchored regression (A+, Timofte 2014): residual = fᵀ·M of the anchor of largest |correlation| with f.

use std::sync::Arc;

use ndarray::{Array2, ArrayView2, Axis};

use super::super::error::Error;
use super::super::features::row_norms;
use super::super::limits;
use super::super::model::Model;
use super::super::patch_model::{Anchored, PatchModel};
use super::predictor::{PredictPatches, low_features};
use crate::linalg::{Par, product_into_columns};

/// Features whose correlations with all anchors are held at once.
///
/// Source: chosen, so that they fit the second-level cache with 1024 anchors.
const CHUNK: usize = 256;

/// The model's anchors and their regressors.
#[derive(Debug)]
pub(super) struct AnchoredRegressors {
    model: Arc<Model>,
    flat: f32,
}

impl AnchoredRegressors {
    /// Patches whose features have a smaller norm than `flat` have no residual.
    pub(super) fn new(model: &Arc<Model>, flat: f32) -> Self {
        AnchoredRegressors { model: Arc::clone(model), flat }
    }
}

/// Checks the shapes of a model's anchored regressors, that their anchors have unit norm (to 1e-3) and their numbers are
/// finite; `features` and `values` are the lengths of a feature vector and of a residual patch.
///
/// # Errors
/// [`Error::Parameter`] that says what is wrong.
pub(super) fn check_anchored(a: &Anchored, features: usize, values: usize) -> Result<(), Error> {
    let wrong = |what: String| Err(Error::Parameter(what));
    let n = a.anchors.nrows();
    if n == 0 || n > limits::ATOMS || a.anchors.ncols() != features || a.maps.dim() != (n, features, values) {
        return wrong(format!("anchors have shapes {:?} and {:?}", a.anchors.dim(), a.maps.dim()));
    }
    let unit = a.anchors.rows().into_iter().all(|r| (r.dot(&r).sqrt() - 1.0).abs() < 1e-3);
    if !unit || !a.maps.iter().chain(&a.anchors).all(|v| v.is_finite()) {
        return wrong("an anchor is not a finite unit vector, or a map is not finite".into());
    }
    Ok(())
}

impl PredictPatches for AnchoredRegressors {
    fn patch_model(&self) -> &PatchModel {
        &self.model.patch_model
    }

    fn predict(&self, padded: &[Array2<f32>], corners: &[(usize, usize)]) -> Result<Array2<f32>, Error> {
        let parts = &self.model.patch_model;
        let features = low_features(parts, padded, corners);
        match &parts.anchored {
            Some(anchored) => Ok(regress(anchored, &features, self.flat)),
            None => Err(Error::Parameter("the model has no anchored regressors".into())),
        }
    }
}

/// Residuals (n×patch²) of features (n×m); zero where a feature vector is shorter than `flat`.
fn regress(anchored: &Anchored, features: &Array2<f32>, flat: f32) -> Array2<f32> {
    let (n, m) = features.dim();
    let p2 = anchored.maps.dim().2;
    let mut patches = Array2::zeros((n, p2));
    let nearest = nearest_anchors(anchored.anchors.view(), features.view());
    // By anchor, so that a regressor is read once for all its patches.
    let mut order: Vec<u32> = (0..n as u32).collect();
    order.sort_by_key(|&i| nearest[i as usize].0);
    let norms = if flat > 0.0 { row_norms(features) } else { Vec::new() };
    let maps = anchored.maps.as_standard_layout();
    let (Some(maps), Some(f), Some(out)) = (maps.as_slice(), features.as_slice(), patches.as_slice_mut()) else {
        return patches;
    };
    for i in order {
        let i = i as usize;
        if norms.get(i).is_some_and(|&n| n < flat) {
            continue;
        }
        let map = &maps[nearest[i].0 as usize * m * p2..][..m * p2];
        let row = &mut out[i * p2..(i + 1) * p2];
        for (value, weights) in f[i * m..(i + 1) * m].iter().zip(map.chunks_exact(p2)) {
            for (o, w) in row.iter_mut().zip(weights) {
                *o += value * w;
            }
        }
    }
    patches
}

/// For each signal (n×m) the anchor (rows of K'×m) of largest |correlation|, the first of equals, and that correlation.
///
/// Runs on the calling thread. Memory: 256 rows of K' correlations.
///
/// # Panics
/// When signals and anchors have different lengths.
///
/// ```
/// use lenslet_core::dictionary::nearest_anchors;
/// use ndarray::array;
///
/// let anchors = array![[1.0f32, 0.0], [0.0, 1.0]];
/// let signals = array![[0.1f32, -2.0], [3.0, 1.0]];
/// assert_eq!(nearest_anchors(anchors.view(), signals.view()), [(1, -2.0), (0, 3.0)]);
/// ```
#[must_use]
pub fn nearest_anchors(anchors: ArrayView2<'_, f32>, signals: ArrayView2<'_, f32>) -> Vec<(u32, f32)> {
    assert_eq!(signals.ncols(), anchors.ncols(), "signals and anchors have different lengths");
    let mut nearest = Vec::with_capacity(signals.nrows());
    let mut correlations = Array2::<f32>::zeros((CHUNK.min(signals.nrows()), anchors.nrows()));
    for chunk in signals.axis_chunks_iter(Axis(0), CHUNK) {
        if chunk.nrows() < correlations.nrows() {
            correlations = Array2::zeros((chunk.nrows(), anchors.nrows()));
        }
        product_into_columns(&mut correlations, 0, chunk, anchors.t(), Par::Seq);
        let Some(rows) = correlations.as_slice() else { continue };
        for row in rows.chunks_exact(anchors.nrows().max(1)) {
            let mut best = (0, -1.0f32);
            for (j, v) in row.iter().enumerate() {
                if v.abs() > best.1 {
                    best = (j, v.abs());
                }
            }
            nearest.push((best.0 as u32, row[best.0]));
        }
    }
    nearest
}
