//! Straight lines and parabolas through positions, by least squares.

use lenslet_core::linalg::gauss_with_back_substitution;

/// Coefficients c of c[0] + c[1]·t + c[2]·t².
pub(super) type Parabola = [f64; 3];

/// The value of a parabola.
#[inline]
pub(super) fn value_at(c: &Parabola, t: f64) -> f64 {
    c[0] + t * (c[1] + t * c[2])
}

/// The polynomial of `degree` 1 or 2 nearest to the places; `None` of fewer places than it needs.
pub(super) fn fit_polynomial(places: impl Iterator<Item = (f64, f64)>, degree: usize) -> Option<Parabola> {
    let n = degree + 1;
    let mut system = vec![0f64; n * (n + 1)];
    let mut count = 0;
    for (t, x) in places {
        let powers = [1.0, t, t * t];
        for i in 0..n {
            for j in 0..n {
                system[i * (n + 1) + j] += powers[i] * powers[j];
            }
            system[i * (n + 1) + n] += powers[i] * x;
        }
        count += 1;
    }
    if count <= n {
        return None;
    }
    gauss_with_back_substitution(&mut system, n, n + 1, 1e-12)?;
    let mut found = [0.0; 3];
    (0..n).for_each(|i| found[i] = system[i * (n + 1) + n]);
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parabolas_and_lines_come_back() {
        let wanted = [0.3, -0.2, 0.01];
        let at = |t: f64| (t, value_at(&wanted, t));
        let found = fit_polynomial((-20..20).map(|t| at(f64::from(t))), 2).unwrap();
        assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}");
        let line = fit_polynomial((0..9).map(|t| (f64::from(t), 2.0 - 0.5 * f64::from(t))), 1).unwrap();
        assert!((line[0] - 2.0).abs() < 1e-9 && (line[1] + 0.5).abs() < 1e-9 && line[2] == 0.0);
        assert!(fit_polynomial([(0.0, 1.0), (1.0, 2.0)].into_iter(), 1).is_none());
    }
}
