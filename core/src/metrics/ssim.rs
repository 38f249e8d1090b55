//! SSIM (Wang, Bovik, Sheikh, Simoncelli, IEEE TIP 13(4), 2004): mean of
//! `(2 μx μy + C1)(2 σxy + C2) / ((μx² + μy² + C1)(σx² + σy² + C2))` over all windows that lie inside the picture,
//! `C1 = 0.01²`, `C2 = 0.03²` for values 0..1.
//!
//! The same as scikit-image's `structural_similarity(x, y, data_range=1, …)`; [`SsimWindow`] lists the other arguments.

use ndarray::{Array2, ArrayView2};
use rayon::prelude::*;

use super::error::Error;

/// Stabilises the luminance term, for values 0..1.
/// Source: the paper, (K₁L)² with K₁ = 0.01.
const C1: f64 = 0.01 * 0.01;
/// Stabilises the contrast term, for values 0..1.
/// Source: the paper, (K₂L)² with K₂ = 0.03.
const C2: f64 = 0.03 * 0.03;
/// Rows per job; fixed, so that sums do not depend on the number of threads.
/// Source: chosen.
const BAND: usize = 32;

/// The window whose statistics are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SsimWindow {
    /// Gaussian, σ 1.5, 11x11, population covariance: the original paper's, and scikit-image's
    /// `gaussian_weights=True, sigma=1.5, use_sample_covariance=False`.
    #[default]
    Gaussian,
    /// Equal weights, 7x7, sample covariance: scikit-image's default.
    Uniform,
}

impl SsimWindow {
    /// Weights along one axis, and the factor that makes a covariance of the window's mean products.
    fn weights(self) -> (Vec<f64>, f64) {
        match self {
            SsimWindow::Gaussian => {
                let weights: Vec<f64> = (-5..=5).map(|i| (-0.5 * f64::from(i * i) / 2.25).exp()).collect();
                let sum: f64 = weights.iter().sum();
                (weights.iter().map(|w| w / sum).collect(), 1.0)
            }
            SsimWindow::Uniform => (vec![1.0 / 7.0; 7], 49.0 / 48.0),
        }
    }
}

fn finite(picture: &ArrayView2<f32>) -> bool {
    picture.iter().all(|x| x.is_finite())
}

fn check(result: &ArrayView2<f32>, reference: &ArrayView2<f32>, side: usize) -> Result<(), Error> {
    if result.dim() != reference.dim() {
        return Err(Error::Shape { result: result.shape().to_vec(), reference: reference.shape().to_vec() });
    }
    let (height, width) = result.dim();
    if height < side || width < side {
        return Err(Error::Small { height, width, least: side });
    }
    if finite(result) && finite(reference) { Ok(()) } else { Err(Error::NotFinite) }
}

/// SSIM from the window's five means: of x, y, x², y² and xy.
fn similarity([x, y, xx, yy, xy]: [f64; 5], norm: f64) -> f64 {
    let (vx, vy, vxy) = (norm * (xx - x * x), norm * (yy - y * y), norm * (xy - x * y));
    ((2.0 * x * y + C1) * (2.0 * vxy + C2)) / ((x * x + y * y + C1) * (vx + vy + C2))
}

/// Mean SSIM of two pictures (t, s) with values 0..1. Window sums run in f64, rows before columns; parallel over
/// bands of rows on the caller's pool.
///
/// # Errors
/// When the shapes differ, a side is shorter than the window (11 or 7), or a value is not finite.
///
/// ```
/// use lenslet_core::metrics::{SsimWindow, ssim};
/// use ndarray::Array2;
///
/// let truth = Array2::from_shape_fn((24, 24), |(t, s)| ((3 * t + s) % 8) as f32 / 8.0);
/// assert!((ssim(truth.view(), truth.view(), SsimWindow::Gaussian)? - 1.0).abs() < 1e-9);
/// let flat = Array2::from_elem((24, 24), truth.mean().unwrap());
/// assert!(ssim(flat.view(), truth.view(), SsimWindow::Gaussian)? < 0.1);
/// # Ok::<(), lenslet_core::metrics::Error>(())
/// ```
pub fn ssim(result: ArrayView2<f32>, reference: ArrayView2<f32>, window: SsimWindow) -> Result<f64, Error> {
    let (weights, norm) = window.weights();
    let side = weights.len();
    check(&result, &reference, side)?;
    let (height, width) = result.dim();
    let (rows, columns) = (height - side + 1, width - side + 1);
    let bands: Vec<f64> = (0..rows.div_ceil(BAND))
        .into_par_iter()
        .map(|band| {
            let first = band * BAND;
            let last = (first + BAND).min(rows);
            band_sum(&result, &reference, &weights, norm, first..last, columns)
        })
        .collect();
    Ok(bands.iter().sum::<f64>() / (rows * columns) as f64)
}

/// Sum of the map over a band of its rows.
fn band_sum(
    x: &ArrayView2<f32>,
    y: &ArrayView2<f32>,
    weights: &[f64],
    norm: f64,
    rows: std::ops::Range<usize>,
    columns: usize,
) -> f64 {
    let side = weights.len();
    let width = x.dim().1;
    // The last `side` rows, summed along the row, as a ring of five planes each.
    let mut ring = vec![0.0; side * 5 * columns];
    let mut products = vec![0.0; 5 * width];
    let mut means = vec![0.0; 5 * columns];
    let mut sum = 0.0;
    for row in rows.start..rows.end + side - 1 {
        {
            let (px, rest) = products.split_at_mut(width);
            let (py, rest) = rest.split_at_mut(width);
            let (pxx, rest) = rest.split_at_mut(width);
            let (pyy, pxy) = rest.split_at_mut(width);
            for (i, (&a, &b)) in x.row(row).iter().zip(y.row(row)).enumerate() {
                let (a, b) = (f64::from(a), f64::from(b));
                px[i] = a;
                py[i] = b;
                pxx[i] = a * a;
                pyy[i] = b * b;
                pxy[i] = a * b;
            }
        }
        let slot = &mut ring[(row % side) * 5 * columns..][..5 * columns];
        slot.fill(0.0);
        for (out, product) in slot.chunks_exact_mut(columns).zip(products.chunks_exact(width)) {
            for (k, &weight) in weights.iter().enumerate() {
                for (o, p) in out.iter_mut().zip(&product[k..]) {
                    *o += weight * p;
                }
            }
        }
        if row + 1 < rows.start + side {
            continue;
        }
        means.fill(0.0);
        for (k, &weight) in weights.iter().enumerate() {
            let slot = &ring[((row + 1 + k) % side) * 5 * columns..][..5 * columns];
            for (m, s) in means.iter_mut().zip(slot) {
                *m += weight * s;
            }
        }
        let mut line = 0.0;
        for i in 0..columns {
            let at = |plane: usize| means[plane * columns + i];
            line += similarity([at(0), at(1), at(2), at(3), at(4)], norm);
        }
        sum += line;
    }
    sum
}

/// The SSIM of every window, each summed over its pixels one by one: the reference for tests, and for maps.
///
/// # Errors
/// As [`ssim`].
pub fn ssim_map_plain(
    result: ArrayView2<f32>,
    reference: ArrayView2<f32>,
    window: SsimWindow,
) -> Result<Array2<f64>, Error> {
    let (weights, norm) = window.weights();
    let side = weights.len();
    check(&result, &reference, side)?;
    let (height, width) = result.dim();
    Ok(Array2::from_shape_fn((height - side + 1, width - side + 1), |(t, s)| {
        let mut means = [0.0; 5];
        for (i, wi) in weights.iter().enumerate() {
            for (j, wj) in weights.iter().enumerate() {
                let (a, b) = (f64::from(result[[t + i, s + j]]), f64::from(reference[[t + i, s + j]]));
                for (mean, value) in means.iter_mut().zip([a, b, a * a, b * b, a * b]) {
                    *mean += wi * wj * value;
                }
            }
        }
        similarity(means, norm)
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;
    use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};

    fn pair(height: usize, width: usize, seed: u64) -> (Array2<f32>, Array2<f32>) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let x = Array2::from_shape_fn((height, width), |(t, s)| {
            (0.5 + 0.4 * (0.3 * t as f32 + 0.2 * s as f32).sin()) + rng.random_range(-0.05..0.05)
        });
        let y = x.mapv(|v| (0.9 * v + 0.03 + rng.random_range(-0.1..0.1f32)).clamp(0.0, 1.0));
        (x, y)
    }

    #[test]
    fn fast_equals_plain() {
        for (height, width) in [(11, 11), (11, 40), (77, 23), (64, 13), (43, 43)] {
            let (x, y) = pair(height, width, height as u64);
            for window in [SsimWindow::Gaussian, SsimWindow::Uniform] {
                let fast = ssim(x.view(), y.view(), window).unwrap();
                let plain = ssim_map_plain(x.view(), y.view(), window).unwrap().mean().unwrap();
                assert!((fast - plain).abs() < 1e-12, "{height}x{width} {window:?}: {fast} {plain}");
            }
        }
    }

    #[test]
    fn equal_pictures_score_one_and_scores_are_symmetric_on_any_pool() {
        let (x, y) = pair(150, 90, 1);
        let one = ssim(x.view(), x.view(), SsimWindow::Gaussian).unwrap();
        assert!((one - 1.0).abs() < 1e-12);
        let a = ssim(x.view(), y.view(), SsimWindow::Gaussian).unwrap();
        assert_eq!(a, ssim(y.view(), x.view(), SsimWindow::Gaussian).unwrap());
        assert!(a < 0.99);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        assert_eq!(a, pool.install(|| ssim(x.view(), y.view(), SsimWindow::Gaussian)).unwrap());
    }

    #[test]
    fn bad_pictures_are_refused() {
        let (x, y) = pair(10, 30, 1);
        assert!(matches!(ssim(x.view(), y.view(), SsimWindow::Gaussian), Err(Error::Small { least: 11, .. })));
        assert!(matches!(ssim(x.view(), y.t(), SsimWindow::Uniform), Err(Error::Shape { .. })));
        let bad = x.mapv(|_| f32::NAN);
        assert_eq!(ssim(bad.view(), y.view(), SsimWindow::Uniform), Err(Error::NotFinite));
    }
}
