//! Conjugate gradients with a diagonal preconditioner, for A x = b, A symmetric and positive definite.

/// Improves `x` by at most `steps` steps; stops when the residual has fallen below `tolerance` times that of x = 0.
/// `multiply(p, out)` writes A p. Sums run over fixed blocks, so results do not depend on threads.
#[inline(always)]
pub(super) fn conjugate_gradients(
    mut multiply: impl FnMut(&[f32], &mut [f32]),
    inverse_diagonal: &[f32],
    right: &[f32],
    x: &mut [f32],
    steps: usize,
    tolerance: f64,
) {
    let n = x.len();
    let mut product = vec![0f32; n];
    multiply(x, &mut product);
    let mut residual: Vec<f32> = right.iter().zip(&product).map(|(b, a)| b - a).collect();
    let start = weighted_square(right, inverse_diagonal);
    let mut direction: Vec<f32> = residual.iter().zip(inverse_diagonal).map(|(r, d)| r * d).collect();
    let mut energy = weighted_square(&residual, inverse_diagonal);
    for _ in 0..steps {
        if energy <= tolerance * tolerance * start {
            break;
        }
        multiply(&direction, &mut product);
        let curvature = dot(&direction, &product);
        if curvature <= 0.0 {
            break;
        }
        let step = (energy / curvature) as f32;
        for (((x, d), r), p) in x.iter_mut().zip(&direction).zip(&mut residual).zip(&product) {
            *x += step * d;
            *r -= step * p;
        }
        let new = weighted_square(&residual, inverse_diagonal);
        let keep = (new / energy) as f32;
        for ((d, r), m) in direction.iter_mut().zip(&residual).zip(inverse_diagonal) {
            *d = r * m + keep * *d;
        }
        energy = new;
    }
}

/// Values whose products are added in f32 before they enter a sum in f64.
///
/// Source: chosen; the error of such a block is below 1e-5 of it.
const BLOCK: usize = 256;

#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let lanes = |a: &[f32], b: &[f32]| -> f32 {
        let mut sums = [0f32; 8];
        let (whole, rest) = (a.chunks_exact(8).zip(b.chunks_exact(8)), a.len() - a.len() % 8);
        for (a, b) in whole {
            for l in 0..8 {
                sums[l] += a[l] * b[l];
            }
        }
        sums.iter().sum::<f32>() + a[rest..].iter().zip(&b[rest..]).map(|(a, b)| a * b).sum::<f32>()
    };
    a.chunks(BLOCK).zip(b.chunks(BLOCK)).map(|(a, b)| f64::from(lanes(a, b))).sum()
}

#[inline(always)]
fn weighted_square(r: &[f32], weights: &[f32]) -> f64 {
    let lanes = |r: &[f32], w: &[f32]| -> f32 {
        let mut sums = [0f32; 8];
        let (whole, rest) = (r.chunks_exact(8).zip(w.chunks_exact(8)), r.len() - r.len() % 8);
        for (r, w) in whole {
            for l in 0..8 {
                sums[l] += r[l] * r[l] * w[l];
            }
        }
        sums.iter().sum::<f32>() + r[rest..].iter().zip(&w[rest..]).map(|(r, w)| r * r * w).sum::<f32>()
    };
    r.chunks(BLOCK).zip(weights.chunks(BLOCK)).map(|(r, w)| f64::from(lanes(r, w))).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_system_is_solved() {
        // A tridiagonal matrix whose solution is known.
        let n = 40;
        let truth: Vec<f32> = (0..n).map(|k| (k as f32 * 0.3).sin()).collect();
        let apply = |x: &[f32], out: &mut [f32]| {
            for k in 0..n {
                let side = |j: Option<usize>| j.filter(|&j| j < n).map_or(0.0, |j| x[j]);
                out[k] = (3.0 + k as f32 * 0.1) * x[k] - side(k.checked_sub(1)) - side(Some(k + 1));
            }
        };
        let mut right = vec![0f32; n];
        apply(&truth, &mut right);
        let inverse: Vec<f32> = (0..n).map(|k| 1.0 / (3.0 + k as f32 * 0.1)).collect();
        let mut x = vec![0f32; n];
        conjugate_gradients(apply, &inverse, &right, &mut x, 30, 1e-7);
        for (a, b) in x.iter().zip(&truth) {
            assert!((a - b).abs() < 1e-5, "{a} {b}");
        }
    }
}
