//! Features of the low image (paper section 4.4 after its ref. [22], and Zeyde 2010): f = F·w, with F the principal
//! components of the first and second order gradients over a window, folded into one matrix on the window's values.

use ndarray::{Array2, ArrayView2, s};

use super::error::Error;
use crate::linalg::{Eigen, Par, product_into_columns, symmetric_eigen};

/// Pixels that the widest gradient filter reaches beyond its centre.
///
/// Source: the second-order filter [½ 0 −1 0 ½] of Zeyde 2010.
const REACH: usize = 2;

fn reflect(i: isize, n: usize) -> usize {
    // Mirrored with the border value repeated: … 1 0 | 0 1 2 … n-1 | n-1 n-2 …
    let period = 2 * n as isize;
    let r = i.rem_euclid(period) as usize;
    if r < n { r } else { period as usize - 1 - r }
}

/// A plane (t, s) with `margin` pixels around it, mirrored at its borders (the border value repeated). A plane without
/// pixels is returned as a copy.
///
/// ```
/// use lenslet_core::dictionary::pad_mirrored;
/// use ndarray::array;
///
/// let padded = pad_mirrored(array![[1.0, 2.0, 3.0]].view(), 2);
/// assert_eq!(padded.dim(), (5, 7));
/// assert_eq!(padded.row(0).to_vec(), [2.0, 1.0, 1.0, 2.0, 3.0, 3.0, 2.0]);
/// ```
#[must_use]
pub fn pad_mirrored(plane: ArrayView2<'_, f32>, margin: usize) -> Array2<f32> {
    let (h, w) = plane.dim();
    if h == 0 || w == 0 {
        return Array2::zeros((h, w));
    }
    let columns: Vec<usize> = (0..w + 2 * margin).map(|x| reflect(x as isize - margin as isize, w)).collect();
    let mut out = Array2::zeros((h + 2 * margin, w + 2 * margin));
    for (y, mut row) in out.rows_mut().into_iter().enumerate() {
        let source = plane.row(reflect(y as isize - margin as isize, h));
        for (value, &x) in row.iter_mut().zip(&columns) {
            *value = source[x];
        }
    }
    out
}

/// Copies the windows (support² values each, one after the other) of a padded plane whose top left corners are
/// `corners` (y, x) into `out`, whose contents are replaced.
///
/// # Panics
/// When a window leaves the plane.
pub fn copy_windows(padded: &Array2<f32>, support: usize, corners: &[(usize, usize)], out: &mut Vec<f32>) {
    out.clear();
    out.reserve(corners.len() * support * support);
    let width = padded.ncols();
    let Some(values) = padded.as_slice() else { return };
    for &(y, x) in corners {
        for r in 0..support {
            let start = (y + r) * width + x;
            out.extend_from_slice(&values[start..start + support]);
        }
    }
}

/// Features (n×m) of the windows of `support`² pixels whose top left corners are `corners` (y, x): f = F·w, one matrix
/// product per input. `padded` are the inputs, all of one size; the first `filters_per_input[0]` rows of `filters`
/// (m × support²) are applied to the first, and so on.
///
/// Runs on the calling thread. Memory: the windows of one input.
///
/// # Panics
/// When a window leaves its plane, or `filters` has fewer rows than `filters_per_input` says.
///
/// ```
/// use lenslet_core::dictionary::extract_features;
/// use ndarray::{Array2, array};
///
/// // One filter, the horizontal difference of a window's middle row, on a ramp of slope 3.
/// let plane = Array2::from_shape_fn((5, 6), |(y, x)| (y + 3 * x) as f32);
/// let filters = array![[0.0, 0.0, 0.0, -0.5, 0.0, 0.5, 0.0, 0.0, 0.0]];
/// let features = extract_features(&[plane], 3, &filters, &[1], &[(0, 0), (2, 3)]);
/// assert_eq!(features, array![[3.0], [3.0]]);
/// ```
#[must_use]
pub fn extract_features(
    padded: &[Array2<f32>],
    support: usize,
    filters: &Array2<f32>,
    filters_per_input: &[usize],
    corners: &[(usize, usize)],
) -> Array2<f32> {
    let mut out = Array2::<f32>::zeros((corners.len(), filters.nrows()));
    let mut windows = Vec::new();
    let mut first = 0;
    for (plane, &count) in padded.iter().zip(filters_per_input) {
        copy_windows(plane, support, corners, &mut windows);
        let Ok(windows) = ArrayView2::from_shape((corners.len(), support * support), &windows) else { continue };
        let rows = filters.slice(s![first..first + count, ..]);
        product_into_columns(&mut out, first, windows, rows.t(), Par::Seq);
        first += count;
    }
    out
}

/// Euclidean norms of the rows.
pub(super) fn row_norms(features: &Array2<f32>) -> Vec<f32> {
    features.rows().into_iter().map(|f| f.dot(&f).sqrt()).collect()
}

/// The gradients as one matrix, 4·window² × support² with support = window + 4: for every place of the window the
/// horizontal and vertical [−1 0 1] and [½ 0 −1 0 ½], applied to the values of the support.
///
/// ```
/// use lenslet_core::dictionary::gradient_operator;
/// use ndarray::Array1;
///
/// let ramp = Array1::from_shape_fn(25, |i| (3 * (i % 5)) as f64); // slope 3 from left to right
/// assert_eq!(gradient_operator(1).dot(&ramp).to_vec(), [6.0, 0.0, 0.0, 0.0]);
/// ```
#[must_use]
pub fn gradient_operator(window: usize) -> Array2<f64> {
    let support = window + 2 * REACH;
    let mut operator = Array2::zeros((4 * window * window, support * support));
    for y in 0..window {
        for x in 0..window {
            let (place, at) = (y * window + x, |dy: usize, dx: usize| (y + dy) * support + x + dx);
            let n = window * window;
            for (filter, taps) in
                [vec![(1, -1.0), (3, 1.0)], vec![(0, 0.5), (2, -1.0), (4, 0.5)]].into_iter().enumerate()
            {
                for (d, tap) in taps {
                    operator[[2 * filter * n + place, at(REACH, d)]] += tap;
                    operator[[(2 * filter + 1) * n + place, at(d, REACH)]] += tap;
                }
            }
        }
    }
    operator
}

/// Feature filters F (m × support²): the m strongest principal components of the gradients, given the second moments
/// of the windows, `moments` = Σ w·wᵀ (support² × support², support = window + 4). Also returns the part of the
/// gradients' energy that they keep (0..1). Signs are fixed so that each row's largest entry is positive.
///
/// # Errors
/// [`Error::Parameter`] when shapes do not fit, `features` is out of range, or the moments have no energy.
///
/// ```
/// use lenslet_core::dictionary::learn_filters;
/// use ndarray::Array2;
///
/// // Windows of 7×7 pixels that hold one grating each: sine and cosine span what their gradients are.
/// let windows = Array2::from_shape_fn((40, 49), |(n, i)| (0.9 * (i % 7) as f64 + n as f64).sin());
/// let (filters, kept) = learn_filters(windows.t().dot(&windows).view(), 3, 2)?;
/// assert_eq!(filters.dim(), (2, 49));
/// assert!(kept > 0.999);
/// assert!(filters.rows().into_iter().all(|filter| filter.sum().abs() < 1e-5));
/// # Ok::<(), lenslet_core::dictionary::Error>(())
/// ```
pub fn learn_filters(
    moments: ArrayView2<'_, f64>,
    window: usize,
    features: usize,
) -> Result<(Array2<f32>, f64), Error> {
    let support = window + 2 * REACH;
    let operator = gradient_operator(window);
    if moments.dim() != (support * support, support * support) {
        return Err(Error::Parameter(format!("moments of shape {:?} for a window of {window}", moments.dim())));
    }
    if features == 0 || features > operator.nrows() {
        return Err(Error::Parameter(format!(
            "{features} features of a window of {window} pixels: it has 1 to {}",
            operator.nrows()
        )));
    }
    let (components, kept) = components(&operator.dot(&moments).dot(&operator.t()), features)?;
    let mut filters = components.dot(&operator);
    filters.rows_mut().into_iter().for_each(upright);
    Ok((filters.mapv(|v| v as f32), kept))
}

/// Filters that are the `features` strongest principal components of the windows themselves (second moments as in
/// [`learn_filters`]), and the part of their energy that these keep.
///
/// # Errors
/// As [`learn_filters`].
pub fn learn_components(moments: ArrayView2<'_, f64>, features: usize) -> Result<(Array2<f32>, f64), Error> {
    if features == 0 || features > moments.nrows() || !moments.is_square() {
        return Err(Error::Parameter(format!("{features} components of moments of shape {:?}", moments.dim())));
    }
    let (mut filters, kept) = components(&moments.to_owned(), features)?;
    filters.rows_mut().into_iter().for_each(upright);
    Ok((filters.mapv(|v| v as f32), kept))
}

/// The strongest principal components as rows, and the part of the energy that they keep.
fn components(moments: &Array2<f64>, count: usize) -> Result<(Array2<f64>, f64), Error> {
    let n = moments.nrows();
    let symmetric = (moments + &moments.t()) * 0.5;
    let Eigen { values, vectors } =
        symmetric_eigen(symmetric.view()).map_err(|e| Error::Parameter(format!("no principal components: {e}")))?;
    let total: f64 = values.iter().filter(|v| v.is_finite() && **v > 0.0).sum();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
    let kept: f64 = order[..count].iter().map(|&i| values[i]).sum();
    if !(total > 0.0 && kept.is_finite()) {
        return Err(Error::Parameter("the training windows have no gradients: photos of one colour?".into()));
    }
    Ok((Array2::from_shape_fn((count, n), |(i, j)| vectors[[j, order[i]]]), kept / total))
}

/// Turns a filter so that its largest entry is positive.
fn upright(mut row: ndarray::ArrayViewMut1<'_, f64>) {
    let peak = row.iter().fold(0.0f64, |a: f64, &b: &f64| if b.abs() > a.abs() { b } else { a });
    if peak < 0.0 {
        row.mapv_inplace(|v| -v);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn padding_mirrors() {
        let plane = Array2::from_shape_fn((2, 3), |(y, x)| (3 * y + x) as f32);
        let padded = pad_mirrored(plane.view(), 3);
        assert_eq!(padded.row(3).to_vec(), [2.0, 1.0, 0.0, 0.0, 1.0, 2.0, 2.0, 1.0, 0.0]);
        assert_eq!(padded.column(3).to_vec(), [3.0, 3.0, 0.0, 0.0, 3.0, 3.0, 0.0, 0.0]);
    }

    #[test]
    fn gradients_of_a_ramp() {
        let operator = gradient_operator(3);
        let ramp = ndarray::Array1::from_shape_fn(49, |i| (2 * (i % 7) + 5 * (i / 7)) as f64);
        let g = operator.dot(&ramp);
        assert!(g.iter().take(9).all(|v| *v == 4.0) && g.iter().skip(9).take(9).all(|v| *v == 10.0));
        assert!(g.iter().skip(18).all(|v| *v == 0.0));
    }

    #[test]
    fn folded_features_equal_gradients_then_components() {
        // The plain way: gradients of each window, then projection on the eigenvectors of their moments.
        use rand::{RngExt, SeedableRng};
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(3);
        let windows = Array2::from_shape_fn((400, 49), |_| rng.random::<f64>());
        let moments = windows.t().dot(&windows);
        let (filters, kept) = learn_filters(moments.view(), 3, 10).unwrap();
        assert!(kept > 0.3 && kept < 1.0);
        let gradients = windows.dot(&gradient_operator(3).t());
        let folded = windows.dot(&filters.mapv(f64::from).t());
        // Components are orthogonal over the data and their energy equals the eigenvalues.
        let energy = folded.iter().map(|v| v * v).sum::<f64>() / gradients.iter().map(|v| v * v).sum::<f64>();
        assert!((energy - kept).abs() < 1e-5);
        let gram = folded.t().dot(&folded);
        for i in 0..10 {
            for j in 0..i {
                assert!(gram[[i, j]].abs() < 1e-4 * gram[[0, 0]]);
            }
        }
    }

    #[test]
    fn flat_data_is_refused() {
        let moments = Array2::from_elem((49, 49), 1.0);
        assert!(learn_filters(moments.view(), 3, 5).is_err());
        assert!(learn_filters(Array2::zeros((4, 4)).view(), 3, 5).is_err());
    }

    #[test]
    fn components_are_the_axes_of_largest_energy() {
        // Energies 2, −1 (rounding gives such) and 5: the sum of what is positive is 7.
        let moments = ndarray::arr2(&[[2.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 5.0]]);
        let (filters, kept) = learn_components(moments.view(), 1).unwrap();
        assert_eq!(filters, ndarray::arr2(&[[0.0, 0.0, 1.0]]));
        assert!((kept - 5.0 / 7.0).abs() < 1e-12, "{kept}");
        let (filters, kept) = learn_components(moments.view(), 2).unwrap();
        assert_eq!(filters, ndarray::arr2(&[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]));
        assert!((kept - 1.0).abs() < 1e-12, "{kept}");
        assert!(learn_components(moments.view(), 3).is_ok());
        for bad in [0, 4] {
            assert!(learn_components(moments.view(), bad).is_err());
        }
        assert!(learn_components(moments.slice(s![..2, ..]), 1).is_err());
    }

    #[test]
    fn every_number_of_features_that_the_gradients_have() {
        let windows = Array2::from_shape_fn((60, 25), |(n, i)| (1.3 * i as f64 + 0.7 * n as f64 * i as f64).sin());
        let moments = windows.t().dot(&windows);
        let (filters, _) = learn_filters(moments.view(), 1, 1).unwrap();
        assert_eq!(filters.dim(), (1, 25));
        let peak = filters.iter().fold(0.0f32, |a, &b| if b.abs() > a.abs() { b } else { a });
        assert!(peak > 0.0, "{peak}");
        assert!(learn_filters(moments.view(), 1, 4).is_ok());
        assert!(learn_filters(moments.view(), 1, 0).is_err() && learn_filters(moments.view(), 1, 5).is_err());
    }

    #[test]
    fn the_first_of_the_largest_entries_becomes_positive() {
        for (row, turned) in [([1.0, -2.0], [-1.0, 2.0]), ([-1.0, 1.0], [1.0, -1.0]), ([0.5, -0.2], [0.5, -0.2])] {
            let mut row = ndarray::arr1(&row);
            upright(row.view_mut());
            assert_eq!(row.to_vec(), turned);
        }
    }

    #[test]
    fn components_are_upright_whatever_their_decomposition_gives() {
        for k in 0..12 {
            let (s, c) = (0.3 + 0.5 * f64::from(k)).sin_cos();
            // Energy 4 along (c, s), 1 across.
            let moments = ndarray::arr2(&[[4.0 * c * c + s * s, 3.0 * c * s], [3.0 * c * s, 4.0 * s * s + c * c]]);
            let (filters, _) = learn_components(moments.view(), 2).unwrap();
            for row in filters.rows() {
                assert!(if row[0].abs() > row[1].abs() { row[0] > 0.0 } else { row[1] > 0.0 }, "{filters}");
            }
        }
    }

    proptest! {
        #[test]
        fn extraction_is_a_dot_product(h in 1usize..12, w in 1usize..12, seed in 0u32..1000) {
            let plane = Array2::from_shape_fn((h, w), |(y, x)| ((y * 31 + x * 17 + seed as usize) % 23) as f32 / 23.0);
            let padded = pad_mirrored(plane.view(), 3);
            let filters = Array2::from_shape_fn((4, 49), |(i, j)| ((i * 7 + j * 3) % 11) as f32 - 5.0);
            let corners: Vec<_> = (0..h).flat_map(|y| (0..w).map(move |x| (y, x))).collect();
            let f = extract_features(std::slice::from_ref(&padded), 7, &filters, &[4], &corners);
            for (n, &(y, x)) in corners.iter().enumerate() {
                for i in 0..4 {
                    let plain: f32 = (0..49).map(|j| filters[[i, j]] * padded[[y + j / 7, x + j % 7]]).sum();
                    prop_assert!((f[[n, i]] - plain).abs() < 1e-3);
                }
            }
        }
    }
}
