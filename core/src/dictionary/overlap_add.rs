//! Overlapping patches on a plane: where they lie, the weighted mean where they overlap, and mirrored copies of the
//! plane.
//!
//! result = low + Σ w·r / Σ w over the patches that cover a pixel; r is a patch's residual there, w its weight there.

use ndarray::{Array2, ArrayView2, Axis, Zip, s};
use rayon::prelude::*;

use super::error::Error;

/// Rows of patches whose residuals are predicted together. Fixed, because it sets the order in which floats are summed
/// and so the last bits of the result.
///
/// Source: chosen.
const BAND: usize = 8;

/// Predicts the residual patches (n×patch²) centred at places (y, x) of a plane.
pub(super) type Predict<'a> = &'a (dyn Fn(&[(usize, usize)]) -> Result<Array2<f32>, Error> + Sync);

/// Adds to a plane the weighted mean of the residual patches of side `patch` that overlap `step` pixels apart.
///
/// Bands of rows are predicted on all threads and added in order, so the result does not depend on how many there are.
///
/// # Errors
/// What `predict` reports.
pub(super) fn add_residuals(
    low: &Array2<f32>,
    patch: usize,
    step: usize,
    spread: f32,
    predict: Predict<'_>,
) -> Result<Array2<f32>, Error> {
    let (h, w) = low.dim();
    let reach = patch / 2;
    let (ys, xs) = (patch_centres(h, step), patch_centres(w, step));
    let weights = patch_weights(patch, spread);
    let bands: Vec<&[usize]> = ys.chunks(BAND).collect();
    let mut sums = Array2::<f32>::zeros(low.dim());
    let mut totals = sums.clone();
    // Bands in groups, so that only a few partial planes exist at a time; added in order.
    for group in bands.chunks(2 * rayon::current_num_threads().max(1)) {
        let parts: Vec<Result<PartialSum, Error>> = group
            .par_iter()
            .map(|rows| {
                let centres: Vec<(usize, usize)> = rows.iter().flat_map(|&y| xs.iter().map(move |&x| (y, x))).collect();
                let patches = predict(&centres)?;
                let first = rows[0].saturating_sub(reach);
                let last = (rows[rows.len() - 1] + reach + 1).min(h);
                let mut part = PartialSum {
                    first,
                    sums: Array2::zeros((last - first, w)),
                    totals: Array2::zeros((last - first, w)),
                };
                part.add(patch, &weights, &patches, &centres);
                Ok(part)
            })
            .collect();
        for part in parts {
            let part = part?;
            let rows = part.first..part.first + part.sums.nrows();
            let mut target = sums.slice_mut(s![rows.clone(), ..]);
            target += &part.sums;
            let mut target = totals.slice_mut(s![rows, ..]);
            target += &part.totals;
        }
    }
    // Every pixel is covered: patches lie on every row and column that is a multiple of the step, and on the last ones.
    Zip::from(&mut sums).and(&totals).and(low).for_each(|s, &t, &l| *s = l + *s / t);
    Ok(sums)
}

/// The rows (or columns) of patch centres: every `step`-th of `length`, and the last.
fn patch_centres(length: usize, step: usize) -> Vec<usize> {
    let mut centres: Vec<usize> = (0..length).step_by(step).collect();
    if length > 0 && centres.last() != Some(&(length - 1)) {
        centres.push(length - 1);
    }
    centres
}

/// The weights of a patch's pixels: a Gaussian of `spread` sides around the centre, all 1 where it is infinite.
fn patch_weights(patch: usize, spread: f32) -> Vec<f32> {
    let r = (patch / 2) as f32;
    let scale = if spread.is_finite() { 0.5 / (spread * patch as f32).powi(2) } else { 0.0 };
    let square = |i: usize| (i as f32 - r).powi(2);
    (0..patch * patch).map(|i| (-(square(i / patch) + square(i % patch)) * scale).exp().max(1e-6)).collect()
}

/// Copy 0 to 3 of a plane: as it is, turned by half, mirrored top to bottom, mirrored left to right. Each undoes
/// itself. The lattice maps to itself under these (but for its small rotation), so the training fits the copies too.
pub(super) fn mirrored_copy(mut plane: ArrayView2<'_, f32>, copy: usize) -> ArrayView2<'_, f32> {
    if matches!(copy, 1 | 2) {
        plane.invert_axis(Axis(0));
    }
    if matches!(copy, 1 | 3) {
        plane.invert_axis(Axis(1));
    }
    plane
}

/// The rows of the result that one band of patches touches.
struct PartialSum {
    /// Row of the plane that is row 0 here.
    first: usize,
    /// Σ w·r of each pixel.
    sums: Array2<f32>,
    /// Σ w of each pixel.
    totals: Array2<f32>,
}

impl PartialSum {
    /// Adds patches centred at `centres` (y, x), cut off at the plane's borders.
    fn add(&mut self, patch: usize, weights: &[f32], patches: &Array2<f32>, centres: &[(usize, usize)]) {
        let (rows, w) = self.sums.dim();
        let r = patch / 2;
        let (Some(sums), Some(totals)) = (self.sums.as_slice_mut(), self.totals.as_slice_mut()) else { return };
        let Some(values) = patches.as_slice() else { return };
        for (values, &(y, x)) in values.chunks_exact(patch * patch).zip(centres) {
            let (left, right) = (r.saturating_sub(x), patch.min(w + r - x));
            for dy in 0..patch {
                let Some(row) = (y + dy).checked_sub(r + self.first).filter(|&row| row < rows) else { continue };
                let start = row * w + x + left - r;
                let n = right - left;
                let from = dy * patch + left;
                let target = sums[start..start + n].iter_mut().zip(&mut totals[start..start + n]);
                for ((s, t), (v, k)) in target.zip(values[from..from + n].iter().zip(&weights[from..from + n])) {
                    *s += k * v;
                    *t += k;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_a_gaussian_around_the_centre() {
        assert_eq!(patch_weights(3, f32::INFINITY), [1.0; 9]);
        let found = patch_weights(5, 0.4);
        for (i, w) in found.iter().enumerate() {
            let (dy, dx) = ((i / 5) as f64 - 2.0, (i % 5) as f64 - 2.0);
            // A standard deviation of 0.4·5 pixels.
            let truth = (-(dy * dy + dx * dx) / 8.0).exp();
            assert!((f64::from(*w) - truth).abs() < 1e-6, "{i}: {w} against {truth}");
        }
        assert_eq!(patch_weights(5, 0.02)[0], 1e-6);
    }

    #[test]
    fn overlapping_residuals_are_averaged_with_their_weights() {
        // One row: patches of side 3 at 0, 2, 4 and 5 whose residuals are their number at every pixel.
        let low = Array2::from_shape_fn((1, 6), |(_, x)| 10.0 * x as f32);
        let predict = |centres: &[(usize, usize)]| {
            assert_eq!(centres, [(0, 0), (0, 2), (0, 4), (0, 5)]);
            Ok(Array2::from_shape_fn((4, 9), |(n, _)| n as f32))
        };
        let flat = add_residuals(&low, 3, 2, f32::INFINITY, &predict).unwrap();
        assert_eq!(flat.row(0).to_vec(), [0.0, 10.5, 21.0, 31.5, 42.5, 52.5]);
        let w = (-1.0f32 / (2.0 * (0.5f32 * 3.0).powi(2))).exp();
        let weighted = add_residuals(&low, 3, 2, 0.5, &predict).unwrap();
        let truth = [0.0, 10.5, 21.0, 31.5, 40.0 + (2.0 + 3.0 * w) / (1.0 + w), 50.0 + (2.0 * w + 3.0) / (1.0 + w)];
        assert!(weighted.iter().zip(truth).all(|(a, b)| (a - b).abs() < 1e-5), "{weighted} {truth:?}");
    }
}
