//! Stacked pairs of eq. (3), and atoms of Dl and Dh out of stacked ones.

use ndarray::{Array2, Axis, concatenate, s};

use crate::atoms::normalise_atoms;
use crate::normalised_pairs::NormalisedPairs;
use crate::parameters::Coupling;

/// The weight of the targets in a stacked pair: both halves get the same mean energy.
fn target_weight(pairs: &NormalisedPairs) -> f32 {
    let energy = |a: &Array2<f32>| a.rows().into_iter().map(|r| f64::from(r.dot(&r))).sum::<f64>();
    (energy(&pairs.signals) / energy(&pairs.targets).max(1e-30)).sqrt() as f32
}

/// Stacked pairs of eq. (3), [y, b·t]/√2: mean energy as that of y.
pub fn stack_pairs(pairs: &NormalisedPairs) -> Array2<f32> {
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let b = target_weight(pairs) * half;
    let (low, high) = (pairs.signals.mapv(|v| v * half), pairs.targets.mapv(|v| v * b));
    concatenate(Axis(1), &[low.view(), high.view()]).unwrap_or_else(|_| pairs.signals.clone())
}

/// Dl (unit rows) and Dh of stacked atoms; an atom with hardly any low part becomes the first feature axis.
pub fn split_atoms(
    stacked: &Array2<f32>,
    pairs: &NormalisedPairs,
    coupling: Coupling,
) -> (Array2<f32>, Option<Array2<f32>>) {
    if coupling == Coupling::Low {
        return (stacked.clone(), None);
    }
    let m = pairs.signals.ncols();
    let b = target_weight(pairs);
    let mut low = stacked.slice(s![.., ..m]).to_owned();
    let mut high = stacked.slice(s![.., m..]).to_owned();
    for (l, mut h) in low.rows().into_iter().zip(high.rows_mut()) {
        let norm = l.dot(&l).sqrt();
        h /= b * norm.max(1e-3);
    }
    normalise_atoms(&mut low);
    (low, Some(high))
}
