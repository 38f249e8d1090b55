//! The pairs of a training set, normalised: unit features, residuals divided by the same norm, weights.

use lenslet_core::progress::Observer;
use lenslet_data_gen::pairs::{self, Crop, PatchOptions};
use ndarray::Array2;
use rayon::prelude::*;

use crate::error::Error;
use crate::parameters::Parameters;
use crate::regression::ridge_regressor;

/// Pairs that any dictionary needs.
/// Source: chosen.
const LEAST_PAIRS: usize = 100;

/// Pairs ready for learning.
pub struct NormalisedPairs {
    /// Filters of the features, m×(window+4)².
    pub filters: Array2<f32>,
    /// Smallest norm that features are divided by.
    pub floor: f32,
    /// Ridge regressor from features to residuals, m×patch².
    pub ridge: Array2<f32>,
    /// Features divided by their norm, N×m.
    pub signals: Array2<f32>,
    /// Residuals divided by the norm of the features, N×patch².
    pub targets: Array2<f32>,
    /// Weights of the pairs, mean 1: the norm of the features to the power of `emphasis`.
    pub weights: Vec<f32>,
}

/// Cuts pairs out of crops, as many as `memory` allows, and normalises them.
///
/// # Errors
/// [`Error::TooLittle`] where there are fewer textured patches than atoms or anchors, interruption.
pub fn prepare_pairs(
    crops: &[Crop],
    parameters: &Parameters,
    observer: &dyn Observer,
) -> Result<NormalisedPairs, Error> {
    let (d, anchors) = (&parameters.dictionary, parameters.anchors.count);
    observer.begin("pairs", 0);
    let (filters, _) = pairs::learn_filters(crops, d.window, d.features)?;
    let most = parameters.pairs_within(crop_bytes(crops));
    let (wanted, memory) = (parameters.pairs.count, parameters.pairs.memory);
    if most < wanted {
        observer.note(&format!("{most} pairs instead of {wanted}: more do not fit into {memory} GiB"));
    }
    let options = PatchOptions {
        patch: d.patch,
        window: d.window,
        per_crop: most.div_ceil(crops.len()),
        seed: parameters.seed,
        ..PatchOptions::default()
    };
    let pairs = pairs::extract_pairs(crops, &filters, &[filters.nrows()], &options)?;
    let found = pairs.features.nrows();
    for (needed, what, fewer) in [
        (d.atoms, format!("{} atoms", d.atoms), ", or fewer --atoms"),
        (anchors, format!("{anchors} anchors"), ", or fewer --anchors"),
        (LEAST_PAIRS, format!("any dictionary ({LEAST_PAIRS} are needed)"), ""),
    ] {
        if found < needed {
            return Err(Error::TooLittle(format!(
                "{found} textured patches are too few for {what}: give more or larger photos, more --pairs{fewer}"
            )));
        }
    }
    let floor = options.min_norm;
    let ridge = ridge_regressor(pairs.features.view(), pairs.residuals.view(), None)?;
    let (mut signals, mut targets) = (pairs.features, pairs.residuals);
    let mut weights = vec![0.0f32; signals.nrows()];
    let rows = signals.outer_iter_mut().into_par_iter().zip(targets.outer_iter_mut().into_par_iter());
    rows.zip(weights.par_iter_mut()).for_each(|((mut y, mut t), w)| {
        let norm = y.dot(&y).sqrt().max(floor);
        y /= norm;
        t /= norm;
        *w = norm.powf(parameters.refinement.emphasis);
    });
    let mean = weights.iter().map(|w| f64::from(*w)).sum::<f64>() / weights.len() as f64;
    weights.iter_mut().for_each(|w| *w /= mean as f32);
    observer.check()?;
    Ok(NormalisedPairs { filters, floor, ridge, signals, targets, weights })
}

/// Bytes of the planes of crops.
pub fn crop_bytes(crops: &[Crop]) -> usize {
    crops.iter().map(|c| 4 * c.high.len() * (2 + c.side_inputs.len())).sum()
}
