//! How an estimated disparity compares with the truth (the measures of the HCI benchmark).

use ndarray::Array2;

/// How an estimate compares with the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DisparityErrors {
    /// Share of pixels off by more than the threshold.
    pub bad: f64,
    /// Mean squared error times 100, (pixels per view step)².
    pub mse100: f64,
    /// Median absolute error, pixels per view step.
    pub median: f64,
    /// Pixels compared.
    pub pixels: usize,
}

/// Compares pixels where `counts` is true and the truth is a number, leaving out `border` pixels on each side.
pub fn compare_with_truth(
    found: &Array2<f32>,
    truth: &Array2<f32>,
    border: usize,
    threshold: f32,
    counts: impl Fn(usize, usize) -> bool,
) -> Option<DisparityErrors> {
    let (height, width) = found.dim();
    if truth.dim() != (height, width) || 2 * border >= height.min(width) {
        return None;
    }
    let mut list = Vec::new();
    for t in border..height - border {
        for s in border..width - border {
            let e = (found[[t, s]] - truth[[t, s]]).abs();
            if e.is_finite() && counts(t, s) {
                list.push(e);
            }
        }
    }
    if list.is_empty() {
        return None;
    }
    list.sort_unstable_by(f32::total_cmp);
    let n = list.len() as f64;
    let bad = list.iter().filter(|e| **e > threshold).count() as f64 / n;
    let mse = list.iter().map(|e| f64::from(*e).powi(2)).sum::<f64>() / n;
    Some(DisparityErrors { bad, mse100: 100.0 * mse, median: f64::from(list[list.len() / 2]), pixels: list.len() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_follow_their_definitions() {
        let truth = Array2::from_elem((10, 10), 1.0f32);
        let mut found = truth.clone();
        found[[5, 5]] = 1.1;
        found[[0, 0]] = 9.0;
        let e = compare_with_truth(&found, &truth, 1, 0.07, |_, _| true).unwrap();
        assert_eq!(e.pixels, 64);
        assert!((e.bad - 1.0 / 64.0).abs() < 1e-9 && (e.mse100 - 100.0 * 0.01 / 64.0).abs() < 1e-3);
    }
}
