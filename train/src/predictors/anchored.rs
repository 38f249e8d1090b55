//! Anchored regression (A+, Timofte 2014): for each anchor a of the feature space the ridge regressor
//! min over M of Σ ‖yᵀM − t‖² + ρ‖M‖² on the pairs whose unit features correlate most with a, in either sign.

use lenslet_core::dictionary::{Anchored, nearest_anchors};
use lenslet_core::linalg::{Par, gram, product, solve_ridge};
use lenslet_core::progress::Observer;
use ndarray::{Array2, Array3, ArrayView2, Axis};
use rand::rngs::ChaCha8Rng;
use rayon::prelude::*;

use super::fitting::Fitting;
use crate::atoms::initial_atoms;
use crate::error::Error;
use crate::normalised_pairs::NormalisedPairs;
use lenslet_core::random::shuffled_indices;

/// Signals whose nearest anchors are found in one product.
/// Source: chosen; speed only.
const CHUNK: usize = 1024;

/// The random stream of the anchors.
const STREAM: u64 = 0x3000;

/// Rounds of spherical k-means that anchors are learned in.
/// Source: chosen.
const ROUNDS: usize = 6;

/// Signals that anchors are learned from at most.
/// Source: chosen; speed only.
const MOST_SIGNALS: usize = 60_000;

/// Learns the anchors of a model and their regressors; `None` where the parameters want none.
///
/// # Errors
/// As [`learn_anchors`] and [`fit_regressors`].
pub(super) fn fit_anchored(pairs: &NormalisedPairs, with: &Fitting<'_>) -> Result<Option<Anchored>, Error> {
    let a = &with.parameters.anchors;
    if a.count == 0 {
        return Ok(None);
    }
    with.observer.begin("anchored regressors", 0);
    let anchors = learn_anchors(&pairs.signals, a.count, ROUNDS, MOST_SIGNALS, &mut (with.random_stream)(STREAM))?;
    let (signals, targets) = (pairs.signals.view(), pairs.targets.view());
    fit_regressors(anchors, signals, targets, a.neighbours, a.ridge, with.observer).map(Some)
}

/// Anchors: means of the signals that are nearest to them, up to sign (spherical k-means), on at most `most` signals.
///
/// # Errors
/// Fewer signals than anchors.
pub fn learn_anchors(
    signals: &Array2<f32>,
    count: usize,
    rounds: usize,
    most: usize,
    rng: &mut ChaCha8Rng,
) -> Result<Array2<f32>, Error> {
    let mut anchors = initial_atoms(signals, count, rng)?;
    let some = signals.nrows().min(most);
    let chosen = shuffled_indices(signals.nrows(), rng);
    let subset = signals.select(Axis(0), &chosen[..some]);
    for _ in 0..rounds {
        let parts: Vec<Vec<(u32, f32)>> = subset
            .axis_chunks_iter(Axis(0), CHUNK)
            .into_par_iter()
            .map(|part| nearest_with_sign(part, &anchors))
            .collect();
        let mut sums = Array2::<f64>::zeros(anchors.dim());
        for ((k, sign), row) in parts.into_iter().flatten().zip(subset.rows()) {
            sums.row_mut(k as usize).zip_mut_with(&row, |s, v| *s += f64::from(sign * v));
        }
        for (mut anchor, sum) in anchors.rows_mut().into_iter().zip(sums.rows()) {
            let norm = sum.dot(&sum).sqrt();
            if norm > 1e-9 {
                anchor.zip_mut_with(&sum, |a, s| *a = (s / norm) as f32);
            }
        }
    }
    Ok(anchors)
}

fn nearest_with_sign(signals: ArrayView2<'_, f32>, anchors: &Array2<f32>) -> Vec<(u32, f32)> {
    let nearest = nearest_anchors(anchors.view(), signals);
    nearest.into_iter().map(|(k, correlation)| (k, if correlation < 0.0 { -1.0 } else { 1.0 })).collect()
}

/// Fits one regressor an anchor on its `neighbours` nearest pairs (unit signals, targets in their scale).
///
/// Memory: one column of N correlations an anchor in work.
///
/// # Errors
/// [`Error::TooLittle`] when there are no pairs; [`Error::Interrupted`].
pub fn fit_regressors(
    anchors: Array2<f32>,
    signals: ArrayView2<'_, f32>,
    targets: ArrayView2<'_, f32>,
    neighbours: usize,
    ridge: f32,
    observer: &dyn Observer,
) -> Result<Anchored, Error> {
    let ((k, m), p, n) = (anchors.dim(), targets.ncols(), signals.nrows());
    let count = neighbours.min(n);
    if count == 0 {
        return Err(Error::TooLittle("there are no training pairs for anchored regressors".into()));
    }
    let mut maps = Array3::<f32>::zeros((k, m, p));
    maps.outer_iter_mut().into_par_iter().zip(anchors.outer_iter().into_par_iter()).try_for_each(
        |(mut map, anchor)| {
            observer.check()?;
            let near = most_correlated(signals, anchor, count);
            let x = signals.select(Axis(0), &near);
            let t = targets.select(Axis(0), &near);
            let gram = gram(x.view(), Par::Seq).mapv(f64::from);
            let right = product(x.t(), t.view(), Par::Seq).mapv(f64::from);
            let solved = solve_ridge(gram.view(), right.view(), f64::from(ridge))
                .map_err(|_| Error::TooLittle("a regressor is not determined: raise the ridge".into()))?;
            map.assign(&solved.mapv(|v| v as f32));
            Ok::<(), Error>(())
        },
    )?;
    Ok(Anchored { anchors, maps })
}

/// Indices, ascending, of the `count` signals of largest |correlation| with the anchor.
fn most_correlated(signals: ArrayView2<'_, f32>, anchor: ndarray::ArrayView1<'_, f32>, count: usize) -> Vec<usize> {
    let mut ranked: Vec<(f32, u32)> =
        signals.dot(&anchor).iter().enumerate().map(|(i, v)| (v.abs(), i as u32)).collect();
    if count < ranked.len() {
        ranked.select_nth_unstable_by(count, |a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        ranked.truncate(count);
    }
    let mut near: Vec<usize> = ranked.into_iter().map(|(_, i)| i as usize).collect();
    near.sort_unstable();
    near
}

#[cfg(test)]
mod tests {
    use super::*;
    use lenslet_core::progress::Silent;
    use rand::{RngExt, SeedableRng};

    struct Cancelled;

    impl Observer for Cancelled {
        fn cancelled(&self) -> bool {
            true
        }
    }

    #[test]
    fn nearest_is_the_sorted_definition() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let signals = Array2::from_shape_fn((200, 4), |_| rng.random::<f32>() - 0.5);
        let anchor = ndarray::array![0.5f32, -0.5, 0.5, 0.5];
        let mut all: Vec<usize> = (0..200).collect();
        all.sort_by(|&a, &b| signals.row(b).dot(&anchor).abs().total_cmp(&signals.row(a).dot(&anchor).abs()));
        let mut plain = all[..30].to_vec();
        plain.sort_unstable();
        assert_eq!(most_correlated(signals.view(), anchor.view(), 30), plain);
        assert_eq!(most_correlated(signals.view(), anchor.view(), 500).len(), 200);
    }

    #[test]
    fn anchored_regressors_fit_a_nonlinear_map_better_than_one() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut x = Array2::from_shape_fn((4000, 3), |_| rng.random::<f32>() - 0.5);
        crate::atoms::normalise_atoms(&mut x);
        let t = Array2::from_shape_fn((4000, 1), |(i, _)| x[[i, 0]] * x[[i, 1]].abs());
        let a = learn_anchors(&x, 24, 4, 2000, &mut rng).unwrap();
        let fitted = fit_regressors(a, x.view(), t.view(), 200, 1e-3, &Silent).unwrap();
        let of = nearest_with_sign(x.view(), &fitted.anchors);
        let mut error = 0.0;
        for (i, (k, _)) in of.iter().enumerate() {
            let y = x.row(i).dot(&fitted.maps.index_axis(Axis(0), *k as usize).column(0));
            error += (y - t[[i, 0]]).powi(2);
        }
        let one = crate::regression::ridge_regressor(x.view(), t.view(), None).unwrap();
        let single: f32 = (&x.dot(&one) - &t).iter().map(|d| d * d).sum();
        assert!(error < 0.3 * single, "{error} {single}");
        assert!(matches!(
            fit_regressors(fitted.anchors, x.view(), t.view(), 200, 1e-3, &Cancelled),
            Err(Error::Interrupted(_))
        ));
    }
}
