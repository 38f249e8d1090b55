//! Small systems without structure, by Gaussian elimination with row pivoting: cheaper here than a call of a library,
//! and equal bit for bit on every processor.
//!
//! Three functions for one task, since their rounding differs and the results of each have been published:
//! [`solve_small`] for one right-hand side on the stack, [`gauss_jordan`] and [`gauss_with_back_substitution`] for
//! several, in place.

/// Below this share of the largest entry a pivot of [`solve_small`] counts as zero.
/// Source: chosen, some fifty times the rounding of f64.
const SINGULAR: f64 = 1e-14;

/// x of `matrix`·x = `right` (N up to about 8); `None` when the matrix is singular to working precision.
///
/// ```
/// use lenslet_core::linalg::solve_small;
/// assert_eq!(solve_small([[0.0, 2.0], [4.0, 0.0]], [6.0, 4.0]), Some([1.0, 3.0]));
/// assert_eq!(solve_small([[1.0, 2.0], [2.0, 4.0]], [1.0, 2.0]), None);
/// ```
#[must_use]
pub fn solve_small<const N: usize>(mut matrix: [[f64; N]; N], mut right: [f64; N]) -> Option<[f64; N]> {
    let scale = matrix.iter().flatten().fold(0f64, |m, v| m.max(v.abs()));
    for k in 0..N {
        let pivot = (k..N).max_by(|&a, &b| matrix[a][k].abs().total_cmp(&matrix[b][k].abs()))?;
        let size = matrix[pivot][k].abs();
        if size.is_nan() || size <= SINGULAR * scale {
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

/// Reduces the rows of `system` = [A | B], A being n×n with n the number of rows, so that their entries from n on
/// become A⁻¹B; the first n are scratch. `None` when the magnitude of a pivot is below `least` or not a number.
///
/// ```
/// use lenslet_core::linalg::gauss_jordan;
/// let mut system = [[0.0, 2.0, 6.0], [4.0, 0.0, 4.0]];
/// gauss_jordan(&mut system, 1e-12).ok_or("singular")?;
/// assert_eq!(system.map(|row| row[2]), [1.0, 3.0]);
/// # Ok::<(), &str>(())
/// ```
#[must_use]
pub fn gauss_jordan<R: AsRef<[f64]> + AsMut<[f64]>>(system: &mut [R], least: f64) -> Option<()> {
    let n = system.len();
    for k in 0..n {
        let size = |row: usize| system[row].as_ref()[k].abs();
        let pivot = (k..n).max_by(|&a, &b| size(a).total_cmp(&size(b)))?;
        system.swap(k, pivot);
        let (head, rest) = system.split_at_mut(k);
        let (row, tail) = rest.split_first_mut()?;
        let row = row.as_ref();
        if !(row[k].abs() >= least) {
            return None;
        }
        for other in head.iter_mut().chain(tail) {
            let other = other.as_mut();
            let factor = other[k] / row[k];
            for (o, r) in other.iter_mut().zip(row) {
                *o -= factor * r;
            }
        }
    }
    for (k, row) in system.iter_mut().enumerate() {
        let (left, right) = row.as_mut().split_at_mut(n);
        right.iter_mut().for_each(|v| *v /= left[k]);
    }
    Some(())
}

/// Reduces `system` = [A | B], n rows of `columns` values, so that its columns from n on become A⁻¹B; the first n are
/// scratch. `None` when the magnitude of a pivot is below `least`.
///
/// ```
/// use lenslet_core::linalg::gauss_with_back_substitution;
/// let mut system = [0.0, 2.0, 6.0, 4.0, 0.0, 4.0];
/// gauss_with_back_substitution(&mut system, 2, 3, 1e-9).ok_or("singular")?;
/// assert_eq!((system[2], system[5]), (1.0, 3.0));
/// # Ok::<(), &str>(())
/// ```
#[must_use]
pub fn gauss_with_back_substitution(system: &mut [f64], n: usize, columns: usize, least: f64) -> Option<()> {
    for k in 0..n {
        let mut pivot = k;
        for i in k + 1..n {
            if system[i * columns + k].abs() > system[pivot * columns + k].abs() {
                pivot = i;
            }
        }
        if system[pivot * columns + k].abs() < least {
            return None;
        }
        if pivot != k {
            for c in k..columns {
                system.swap(k * columns + c, pivot * columns + c);
            }
        }
        let (head, tail) = system.split_at_mut((k + 1) * columns);
        let row = &head[k * columns..];
        for other in tail.chunks_exact_mut(columns) {
            let f = other[k] / row[k];
            if f != 0.0 {
                for (o, r) in other[k..].iter_mut().zip(&row[k..]) {
                    *o -= f * r;
                }
            }
        }
    }
    for k in (0..n).rev() {
        for c in n..columns {
            let mut v = system[k * columns + c];
            for j in k + 1..n {
                v -= system[k * columns + j] * system[j * columns + c];
            }
            system[k * columns + c] = v / system[k * columns + k];
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn regular_systems_are_solved_and_singular_ones_refused() {
        let x = solve_small([[0.0, 2.0, 1.0], [1.0, -1.0, 0.5], [3.0, 0.0, -2.0]], [7.0, 0.5, -3.0]).unwrap();
        for (row, right) in [([0.0, 2.0, 1.0], 7.0), ([1.0, -1.0, 0.5], 0.5), ([3.0, 0.0, -2.0], -3.0)] {
            assert!((row[0] * x[0] + row[1] * x[1] + row[2] * x[2] - right).abs() < 1e-12);
        }
        assert!(solve_small([[1.0, 2.0], [2.0, 4.0]], [1.0, 2.0]).is_none());
        assert!(solve_small([[f64::NAN, 2.0], [2.0, 4.0]], [1.0, 2.0]).is_none());
        assert!(gauss_jordan(&mut [[1.0, 2.0, 1.0], [2.0, 4.0, 2.0]], 1e-12).is_none());
        assert!(gauss_jordan(&mut [[f64::NAN, 2.0, 1.0], [2.0, 4.0, 2.0]], 1e-12).is_none());
        assert!(gauss_with_back_substitution(&mut [1.0, 2.0, 1.0, 2.0, 4.0, 2.0], 2, 3, 1e-12).is_none());
    }

    #[test]
    fn the_three_agree_and_give_the_right_side_back() {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(11);
        for _ in 0..50 {
            let matrix: [[f64; 6]; 6] = std::array::from_fn(|_| std::array::from_fn(|_| rng.random::<f64>() - 0.5));
            let right: [f64; 6] = std::array::from_fn(|_| rng.random::<f64>());
            let x = solve_small(matrix, right).unwrap();
            for (row, r) in matrix.iter().zip(right) {
                assert!((row.iter().zip(x).map(|(a, b)| a * b).sum::<f64>() - r).abs() < 1e-9);
            }
            let mut rows: Vec<Vec<f64>> = matrix.iter().zip(right).map(|(m, r)| [&m[..], &[r]].concat()).collect();
            let mut flat = rows.concat();
            gauss_jordan(&mut rows, 1e-12).unwrap();
            gauss_with_back_substitution(&mut flat, 6, 7, 1e-12).unwrap();
            for k in 0..6 {
                let tolerance = 1e-9 * (1.0 + x[k].abs());
                assert!((rows[k][6] - x[k]).abs() < tolerance && (flat[7 * k + 6] - x[k]).abs() < tolerance);
            }
        }
    }
}
