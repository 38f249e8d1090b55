//! Section 4.3 as in the paper: all samples at their exact places are triangulated, and the remaining pixels
//! interpolated barycentrically. Samples closer than half a pixel are joined to their mean first.

use lenslet_core::sampling::Weights;
use ndarray::{Array2, Array3};

use super::rays::for_each_ray;
use super::sample_set::SampleSet;
use super::view_disparities::ViewDisparities;
use crate::Error;

/// Renders the view `at` (row, column).
pub(super) fn render_view(
    set: &SampleSet,
    disparities: &ViewDisparities,
    at: (usize, usize),
) -> Result<Array3<f32>, Error> {
    let size = set.target;
    let c = set.channels();
    if size.width < 2 || size.height < 2 {
        return set.single(at.0, at.1);
    }
    // Means of position and value in cells of half a pixel.
    let (w, h) = (2 * size.width, 2 * size.height);
    let mut sums = vec![[0f64; 6]; w * h];
    for_each_ray(set, disparities, at, size, |x, y, weight: f32, value: &[f32]| {
        let cell = &mut sums[(2.0 * y) as usize * w + (2.0 * x) as usize];
        let weight = f64::from(weight);
        cell[0] += weight;
        cell[1] += weight * f64::from(x);
        cell[2] += weight * f64::from(y);
        for (s, v) in cell[3..].iter_mut().zip(value) {
            *s += weight * f64::from(*v);
        }
    });
    let kept: Vec<&[f64; 6]> = sums.iter().filter(|s| s[0] > 0.25).collect();
    // Sizes are those of the view itself: the centres are in its pixels already.
    let places: Vec<[f64; 2]> = kept.iter().map(|s| [s[1] / s[0], s[2] / s[0]]).collect();
    let values = Array2::from_shape_fn((kept.len(), c), |(k, l)| (kept[k][3 + l] / kept[k][0]) as f32);
    Ok(Weights::new(&places, size, size)?.apply(values.view())?)
}
