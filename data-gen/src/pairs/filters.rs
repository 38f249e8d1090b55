//! Filters of the features: principal components of windows of the crops, by way of their second moments.

use lenslet_core::dictionary::{self, copy_windows, pad_mirrored};
use ndarray::Array2;
use rayon::prelude::*;

use super::crop::Crop;
use super::error::Error;
use super::options::PatchOptions;

/// Distance in pixels, across and down, of the windows that moments are gathered from.
/// Source: chosen; hundreds of thousands of windows are left of any training set.
const STRIDE: usize = 9;

/// Windows a crop at most.
/// Source: chosen.
const MOST_WINDOWS: usize = 4096;

/// Feature filters learned from windows of all crops (m×(window+4)², m = `features`), and the part of the gradients'
/// energy that they keep.
///
/// # Errors
/// No crops, parameters out of range, or crops without any gradient.
///
/// ```
/// use lenslet_data_gen::pairs::{Crop, PatchOptions, extract_pairs, learn_filters};
/// use ndarray::Array2;
/// let high = Array2::from_shape_fn((40, 40), |(y, x)| ((x * x + 3 * y) % 17) as f32 / 17.0);
/// let low = Array2::from_shape_fn((40, 40), |(y, x)| 0.5 + 0.2 * (0.4 * x as f32).sin() * (0.3 * y as f32).cos());
/// let crops = [Crop { photo: 0, high, low, side_inputs: Vec::new() }];
/// let (filters, kept) = learn_filters(&crops, 5, 6)?;
/// assert!(filters.dim() == (6, 81) && kept > 0.5 && kept <= 1.0);
/// let options = PatchOptions { patch: 3, window: 5, per_crop: 50, ..PatchOptions::default() };
/// let pairs = extract_pairs(&crops, &filters, &[6], &options)?;
/// assert_eq!((pairs.features.ncols(), pairs.residuals.ncols()), (6, 9));
/// assert!(pairs.features.nrows() <= 50);
/// # Ok::<(), lenslet_data_gen::pairs::Error>(())
/// ```
pub fn learn_filters(crops: &[Crop], window: usize, features: usize) -> Result<(Array2<f32>, f64), Error> {
    PatchOptions { window, patch: 1, ..PatchOptions::default() }.check()?;
    let moments = moments(crops, window + 4, &|crop| crop.low.clone(), true);
    Ok(dictionary::learn_filters(moments.view(), window, features)?)
}

/// Filters of windows of `support` pixels for the difference between side input `which` and the low image: its
/// `features` strongest principal components, one a row, and the part of its energy that they keep.
///
/// # Errors
/// Parameters out of range, crops without that image, or without a difference.
pub fn learn_difference_filters(
    crops: &[Crop],
    which: usize,
    support: usize,
    features: usize,
) -> Result<(Array2<f32>, f64), Error> {
    PatchOptions { window: support.saturating_sub(4), patch: 1, ..PatchOptions::default() }.check()?;
    if crops.iter().any(|c| c.side_inputs.len() <= which) {
        return Err(Error::Parameter(format!("the crops have no side input {which}")));
    }
    let moments = moments(crops, support, &|crop| &crop.side_inputs[which] - &crop.low, false);
    Ok(dictionary::learn_components(moments.view(), features)?)
}

/// Second moments of windows of the planes that `of` takes from the crops, each window less its mean where `centred`.
fn moments(crops: &[Crop], support: usize, of: &(dyn Fn(&Crop) -> Array2<f32> + Sync), centred: bool) -> Array2<f64> {
    let n = support * support;
    let parts: Vec<Array2<f64>> = crops
        .par_iter()
        .map(|crop| {
            let padded = pad_mirrored(of(crop).view(), support / 2);
            let (h, w) = crop.low.dim();
            let corners: Vec<_> = (0..h)
                .step_by(STRIDE)
                .flat_map(|y| (0..w).step_by(STRIDE).map(move |x| (y, x)))
                .take(MOST_WINDOWS)
                .collect();
            let mut values = Vec::new();
            copy_windows(&padded, support, &corners, &mut values);
            // Gradients do not depend on the mean; without it the sums lose less to rounding.
            for w in values.chunks_exact_mut(if centred { n } else { usize::MAX }) {
                let mean = w.iter().sum::<f32>() / n as f32;
                w.iter_mut().for_each(|v| *v -= mean);
            }
            let values = Array2::from_shape_vec((corners.len(), n), values).unwrap_or_default();
            values.t().dot(&values).mapv(f64::from)
        })
        .collect();
    let mut moments = Array2::<f64>::zeros((n, n));
    parts.iter().for_each(|p| moments += p);
    moments
}
