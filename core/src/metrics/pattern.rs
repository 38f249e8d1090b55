//! Contrast of a known pattern, and the spurious rest. With means removed, the result r over a window is split
//! along the truth t into `r = c·t + e`, `c = ⟨r, t⟩/⟨t, t⟩`: c is the contrast, e (aliasing, zigzag, noise) is
//! spurious.

use ndarray::{ArrayView2, Zip};

/// What [`pattern_contrast`] measures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pattern {
    /// Contrast of the result as a share of the truth's: 1 is perfect, 0 is grey, negative is inverted.
    pub contrast: f64,
    /// RMS of what is not the truth's pattern, as a share of the truth's RMS contrast.
    pub spurious: f64,
}

/// Splits `result` along `reference`, both (t, s). `None` for a reference without contrast, shapes that differ, or
/// values that are not finite.
///
/// ```
/// use lenslet_core::metrics::pattern_contrast;
/// use ndarray::Array2;
///
/// let stripes = Array2::from_shape_fn((8, 16), |(_, s)| if s % 4 < 2 { 0.2 } else { 0.8 });
/// let flatter = stripes.mapv(|x| 0.5 * x + 0.1);
/// let measured = pattern_contrast(flatter.view(), stripes.view()).unwrap();
/// assert!((measured.contrast - 0.5).abs() < 1e-6 && measured.spurious < 1e-3);
/// ```
pub fn pattern_contrast(result: ArrayView2<f32>, reference: ArrayView2<f32>) -> Option<Pattern> {
    if result.dim() != reference.dim() || result.is_empty() {
        return None;
    }
    let n = result.len() as f64;
    let mean = |a: &ArrayView2<f32>| a.iter().map(|&x| f64::from(x)).sum::<f64>() / n;
    let (mr, mt) = (mean(&result), mean(&reference));
    let (mut rr, mut rt, mut tt) = (0.0, 0.0, 0.0);
    Zip::from(&result).and(&reference).for_each(|&r, &t| {
        let (r, t) = (f64::from(r) - mr, f64::from(t) - mt);
        rr += r * r;
        rt += r * t;
        tt += t * t;
    });
    if !(rr.is_finite() && tt.is_finite()) || tt / n < 1e-8 {
        return None;
    }
    let contrast = rt / tt;
    Some(Pattern { contrast, spurious: ((rr - contrast * rt).max(0.0) / tt).sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    #[test]
    fn parts_come_back() {
        let truth =
            Array2::from_shape_fn((30, 30), |(_, s)| 0.5 + 0.4 * (s as f32 * 2.0 * std::f32::consts::PI / 6.0).sin());
        // A pattern of another direction with half the truth's strength is all spurious.
        let other = Array2::from_shape_fn((30, 30), |(t, _)| 0.2 * (t as f32 * 2.0 * std::f32::consts::PI / 5.0).sin());
        let result = truth.mapv(|x| 0.3 + 0.7 * x) + other;
        let got = pattern_contrast(result.view(), truth.view()).unwrap();
        assert!((got.contrast - 0.7).abs() < 1e-4 && (got.spurious - 0.5).abs() < 1e-4, "{got:?}");
        assert_eq!(pattern_contrast(truth.view(), Array2::from_elem((30, 30), 0.5).view()), None);
        assert_eq!(pattern_contrast(truth.view(), truth.slice(ndarray::s![1.., ..])), None);
    }
}
