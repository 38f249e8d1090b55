//! The duality gap in f64: P(φ) = ½‖r‖² + λ‖φ‖₁ against the dual max over θ of ½‖y‖² − ½‖y − θ‖², |Dθ| ≤ λ, at θ = s·r.
//!
//! r = y − Dᵀφ and s is the best factor that keeps θ feasible. A gap of g proves the objective within g of its minimum.

use super::simd::{Chunk, Lanes};

/// Gap from y·r, ‖r‖², ‖φ‖₁ and the largest correlation max |D r| (max D r with non-negative codes).
#[inline(always)]
pub(crate) fn duality_gap(yr: f64, rr: f64, norm1: f64, lambda: f64, largest: f64) -> f64 {
    let primal = 0.5 * rr + lambda * norm1;
    let most = if largest > lambda { lambda / largest } else { 1.0 };
    // The dual value s·y·r − ½s²‖r‖² grows up to s = y·r/‖r‖².
    let s = if rr > 0.0 { (yr / rr).clamp(0.0, most) } else { 0.0 };
    let dual = s * yr - 0.5 * s * s * rr;
    let gap = primal - dual;
    // What is not a number proves nothing.
    if gap.is_nan() { f64::INFINITY } else { gap.max(0.0) }
}

/// Inner product in f64 of an f32 row and an f64 vector, in sixteen fixed lanes.
#[inline(always)]
pub(crate) fn inner_product<S: Lanes>(lanes: S, a: &[Chunk], b: &[[f64; 16]]) -> f64 {
    let mut sum = lanes.wide_splat(0.0);
    for (a, b) in a.iter().zip(b) {
        sum = lanes.wide_fma(lanes.wide(a), lanes.wide_load(b), sum);
    }
    lanes.wide_sum(sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gap_is_primal_minus_dual() {
        // ‖r‖² = 4, ‖φ‖₁ = 3, λ = 0.5: primal 2 + 1.5. Below λ the factor is at most 1: dual 4 − 2.
        assert!((duality_gap(4.0, 4.0, 3.0, 0.5, 0.4) - (3.5 - 2.0)).abs() < 1e-12);
        // Largest 1: the factor is at most a half, dual 3 − 0.5.
        assert!((duality_gap(6.0, 4.0, 3.0, 0.5, 1.0) - (3.5 - 2.5)).abs() < 1e-12);
        // y·r/‖r‖² = 0.25 is below it: dual 0.25 − 0.125.
        assert!((duality_gap(1.0, 4.0, 3.0, 0.5, 1.0) - (3.5 - 0.125)).abs() < 1e-12);
        assert!((duality_gap(-1.0, 4.0, 3.0, 0.5, 1.0) - 3.5).abs() < 1e-12);
        assert_eq!(duality_gap(0.0, 0.0, 2.0, 0.25, 0.0), 0.5);
        assert_eq!(duality_gap(f64::NAN, 4.0, 3.0, 0.5, 1.0), f64::INFINITY);
    }
}
