//! The duality gap in f64: P(φ) = ½‖r‖² + λ‖φ‖₁ against the dual max over θ of ½‖y‖² − ½‖y − θ‖², |Dθ| ≤ λ, at θ = s·r.
//!
//! r = y − Dᵀφ and s is the best factor that keeps θ feasible. A gap of g proves the objective within g of its minimum.

/// What [`certify`] finds.
#[derive(Debug, Clone, Copy)]
pub(super) struct Certificate {
    /// P − dual ≥ P − P*.
    pub gap: f64,
}

/// Gap from the f64 residual, ‖φ‖₁ and the largest correlation max |D r| (max D r with non-negative codes).
pub(super) fn certify(
    signal: impl Iterator<Item = f64>,
    residual: &[f64],
    norm1: f64,
    lambda: f64,
    largest: f64,
) -> Certificate {
    let (mut rr, mut yr) = (0.0, 0.0);
    for (y, &r) in signal.zip(residual) {
        rr += r * r;
        yr += y * r;
    }
    let primal = 0.5 * rr + lambda * norm1;
    let most = if largest > lambda { lambda / largest } else { 1.0 };
    // The dual value s·y·r − ½s²‖r‖² grows up to s = y·r/‖r‖².
    let s = if rr > 0.0 { (yr / rr).clamp(0.0, most) } else { 0.0 };
    let dual = s * yr - 0.5 * s * s * rr;
    Certificate { gap: (primal - dual).max(0.0) }
}

/// Inner product in f64 of an f32 row and an f64 vector, in eight fixed lanes.
pub(super) fn dot(a: &[f32], b: &[f64]) -> f64 {
    let mut lanes = [0.0f64; 8];
    let (a8, a_rest) = a.as_chunks::<8>();
    let (b8, b_rest) = b.as_chunks::<8>();
    for (x, y) in a8.iter().zip(b8) {
        for i in 0..8 {
            lanes[i] += f64::from(x[i]) * y[i];
        }
    }
    let tail: f64 = a_rest.iter().zip(b_rest).map(|(&x, &y)| f64::from(x) * y).sum();
    lanes.iter().sum::<f64>() + tail
}
