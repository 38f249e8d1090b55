//! Small dense linear systems, solved by elimination with row pivoting.

/// Solves `matrix · x = right`; `None` when the matrix is singular to working precision.
pub fn solve<const N: usize>(mut matrix: [[f64; N]; N], mut right: [f64; N]) -> Option<[f64; N]> {
    let scale = matrix.iter().flatten().fold(0f64, |m, v| m.max(v.abs()));
    for k in 0..N {
        let pivot = (k..N).max_by(|&a, &b| matrix[a][k].abs().total_cmp(&matrix[b][k].abs()))?;
        let size = matrix[pivot][k].abs();
        if size.is_nan() || size <= 1e-14 * scale {
            return None;
        }
        matrix.swap(k, pivot);
        right.swap(k, pivot);
        for row in k + 1..N {
            let factor = matrix[row][k] / matrix[k][k];
            let above = matrix[k];
            for (value, above) in matrix[row].iter_mut().zip(above).skip(k) {
                *value -= factor * above;
            }
            right[row] -= factor * right[k];
        }
    }
    let mut x = [0f64; N];
    for k in (0..N).rev() {
        let rest: f64 = (k + 1..N).map(|c| matrix[k][c] * x[c]).sum();
        x[k] = (right[k] - rest) / matrix[k][k];
    }
    x.iter().all(|v| v.is_finite()).then_some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solves_and_refuses() {
        let x = solve([[0.0, 2.0, 1.0], [1.0, -1.0, 0.5], [3.0, 0.0, -2.0]], [7.0, 0.5, -3.0]).unwrap();
        for (row, right) in [([0.0, 2.0, 1.0], 7.0), ([1.0, -1.0, 0.5], 0.5), ([3.0, 0.0, -2.0], -3.0)] {
            assert!((row[0] * x[0] + row[1] * x[1] + row[2] * x[2] - right).abs() < 1e-12);
        }
        assert!(solve([[1.0, 2.0], [2.0, 4.0]], [1.0, 2.0]).is_none());
        assert!(solve([[f64::NAN, 2.0], [2.0, 4.0]], [1.0, 2.0]).is_none());
    }
}
