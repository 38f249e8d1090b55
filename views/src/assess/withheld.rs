//! Samples without those of some lenslets in all views but the middle one, as far as multi-view refinement goes.
//!
//! The joint fit and the triangulation do without them ([`without_foretold`]). For least squares, whose samples are points,
//! there stands in place of a withheld value what the refined middle view itself shows where its ray meets it, found in
//! turns: fill from a view interpolated from the middle view's own samples, refine, fill from the refined view, and so on.
//! At the fixed point these rays leave no residual, so the fit is that of the other rays alone (expectation and
//! maximisation of a least-squares fit with missing values).

use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::progress::Observer;
use lenslet_core::sampling::bicubic::bicubic_at;
use ndarray::{Array2, Array3};
use rayon::prelude::*;

use super::ray_places::{RayPlaces, sample_points, view_steps};
use crate::Error;
use crate::multiview::{self, Fit, RefinedViews, SampleSet};
use crate::renderer::InterpolatedViews;

/// Refinements after which withheld values stay.
///
/// Source: chosen; a third changes the measure by less than 0.02 dB.
const ROUNDS: usize = 2;

/// One lenslet in this many is withheld.
///
/// Source: chosen.
const ONE_IN: u64 = 10;

/// Whether the lenslet of lattice index (i, j) is withheld: the same ones whatever the calibration's order.
pub(super) fn is_withheld(index: [i32; 2]) -> bool {
    hash_of(index).is_multiple_of(ONE_IN)
}

/// A number that depends on the lattice index alone.
///
/// Source: S. Vigna, splitmix64.
pub(super) fn hash_of([i, j]: [i32; 2]) -> u64 {
    let mut z = ((i as u32 as u64) << 32 | j as u32 as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The samples of `samples` for views of `size`, those that are foretold kept from the refinement of the middle view.
///
/// # Errors
/// As [`SampleSet::hexagonal`].
pub(super) fn without_foretold<'a>(samples: &'a HexSamples, size: &Size) -> Result<SampleSet<'a>, Error> {
    let middle = samples.view_index(samples.views / 2, samples.views / 2);
    Ok(SampleSet::hexagonal(samples, size)?.withholding(|lenslet| is_withheld(samples.index[lenslet]), middle))
}

/// The middle view (t, s, c) that `set` gives with its disparity known.
///
/// # Errors
/// As the refinement; interruption.
pub(super) fn refined_middle(
    set: SampleSet<'_>,
    fit: Fit,
    disparity: Array2<f32>,
    observer: &dyn Observer,
) -> Result<Array3<f32>, Error> {
    observer.check()?;
    let middle = (set.views().0 / 2, set.views().1 / 2);
    let options = multiview::Options { fit, known: Some(disparity), ..multiview::Options::default() };
    RefinedViews::estimate(set, &options, observer)?.render_view(middle.0, middle.1)
}

/// The middle view refined by least squares without the values that are foretold.
///
/// # Errors
/// As the refinement; interruption.
pub(super) fn least_squares_without_foretold(
    samples: &HexSamples,
    size: &Size,
    disparity: &Array2<f32>,
    observer: &dyn Observer,
) -> Result<Array3<f32>, Error> {
    let middle = samples.views / 2;
    let cubic = InterpolatedViews::prepare(samples, Interpolation::Cubic, size, observer)?;
    let mut picture = cubic.render_view(middle, middle)?.into_pixels();
    let places = RayPlaces::new(samples, size, disparity);
    let points = sample_points(samples, size);
    let withheld: Vec<usize> = (0..points.len()).filter(|&k| is_withheld(samples.index[k])).collect();
    let mut rest = samples.clone();
    for _ in 0..=ROUNDS {
        fill(&mut rest, &withheld, &points, &places, &picture);
        let set = SampleSet::hexagonal(&rest, size)?;
        picture = refined_middle(set, Fit::LeastSquares, disparity.clone(), observer)?;
    }
    Ok(picture)
}

/// Replaces the withheld values of all views but the middle one by what `picture` shows at their rays.
fn fill(samples: &mut HexSamples, withheld: &[usize], points: &[[f64; 2]], places: &RayPlaces, picture: &Array3<f32>) {
    let middle = samples.view_index(samples.views / 2, samples.views / 2);
    let steps: Vec<[f64; 2]> = (0..samples.views * samples.views).map(|k| view_steps(samples, k)).collect();
    samples.values.outer_iter_mut().into_par_iter().zip(steps).enumerate().for_each(|(view, (mut values, steps))| {
        if view == middle {
            return;
        }
        for &lenslet in withheld {
            let place = places.place(points[lenslet], steps);
            if let Some(value) = values.row_mut(lenslet).as_slice_mut() {
                bicubic_at(picture.view(), place.x, place.y, value);
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tenth_is_withheld_and_neighbours_do_not_tell() {
        let grid = || (-60..60).flat_map(|j| (-60..60).map(move |i| [i, j]));
        let share = grid().filter(|&k| is_withheld(k)).count() as f64 / 14_400.0;
        assert!((share - 0.1).abs() < 0.01, "{share}");
        let pairs = grid().filter(|&[i, j]| is_withheld([i, j]) && is_withheld([i + 1, j])).count() as f64 / 14_400.0;
        assert!((pairs - 0.01).abs() < 0.004, "{pairs}");
    }
}
