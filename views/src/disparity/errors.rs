//! How an estimated disparity compares with the truth (the measures of the HCI benchmark).

use ndarray::Array2;

use super::estimate::Disparity;

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

/// Pixels of similar confidence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConfidenceBin {
    /// Their mean confidence.
    pub said: f64,
    /// Share of them within the threshold of the truth.
    pub within: f64,
    /// Their share of the pixels compared.
    pub share: f64,
}

/// Whether confidence is the share of pixels within `threshold` of the truth, in bins that end at 0.5, 0.7, 0.8, 0.9, 0.95,
/// 0.98 and 1; empty bins are left out, as are `border` pixels on each side. Nothing where the sizes differ.
#[must_use]
pub fn confidence_curve(found: &Disparity, truth: &Array2<f32>, border: usize, threshold: f32) -> Vec<ConfidenceBin> {
    const ENDS: [f32; 7] = [0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 1.0];
    let (height, width) = found.disparity.dim();
    if truth.dim() != (height, width) || found.confidence.dim() != (height, width) {
        return Vec::new();
    }
    let mut sums = [[0f64; 3]; ENDS.len()];
    let inside = |k: usize, n: usize| k >= border && k + border < n;
    for ((at, d), (c, g)) in found.disparity.indexed_iter().zip(found.confidence.iter().zip(truth)) {
        let e = (d - g).abs();
        if !inside(at.0, height) || !inside(at.1, width) || !e.is_finite() {
            continue;
        }
        let bin = ENDS.iter().position(|end| c < end).unwrap_or(ENDS.len() - 1);
        for (sum, x) in sums[bin].iter_mut().zip([1.0, f64::from(*c), f64::from(u8::from(e <= threshold))]) {
            *sum += x;
        }
    }
    let all: f64 = sums.iter().map(|s| s[0]).sum();
    let filled = sums.iter().filter(|s| s[0] > 0.0);
    filled.map(|s| ConfidenceBin { said: s[1] / s[0], within: s[2] / s[0], share: s[0] / all }).collect()
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
        let mut confidence = Array2::from_elem((10, 10), 0.75);
        confidence[[5, 5]] = 0.25;
        let found = Disparity { disparity: found.clone(), confidence, searched: None };
        let curve = confidence_curve(&found, &truth, 1, 0.07);
        let bin = |said, within, pixels: f64| ConfidenceBin { said, within, share: pixels / 64.0 };
        assert_eq!(curve, [bin(0.25, 0.0, 1.0), bin(0.75, 1.0, 63.0)]);
        assert!((e.bad - 1.0 / 64.0).abs() < 1e-9 && (e.mse100 - 100.0 * 0.01 / 64.0).abs() < 1e-3);
    }
}
