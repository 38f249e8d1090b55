//! Regular lattice fitted over all measured centres, robustly: min over origin, a, b of Σ ρ(|c_ij − origin − i·a − j·b|
//! / s) with Tukey's ρ (paper section 3.2: "fit a regular triangle grid to the estimated center points"). Row stretch
//! comes with it, since a and b are free. Solved by iteratively reweighted least squares.

use super::measured::MeasuredLenslet;
use crate::calibration::model::Lattice;
use crate::linalg::solve_small;

/// Tukey's constant, in standard deviations: 95 % efficiency on Gaussian errors.
/// Source: Holland and Welsch 1977, "Robust regression using iteratively reweighted least-squares"
const TUKEY: f64 = 4.685;
/// Rounds of reweighting.
/// Source: chosen
const ROUNDS: usize = 6;

/// Robust fit over the usable measured centres. `start` gives the packing and the first residuals; it is returned
/// unchanged when fewer than ten centres are usable.
pub fn fit_lattice(start: &Lattice, measured: &[MeasuredLenslet]) -> Lattice {
    let usable: Vec<&MeasuredLenslet> = measured.iter().filter(|m| m.usable).collect();
    if usable.len() < 10 {
        return *start;
    }
    let mut lattice = *start;
    for round in 0..ROUNDS {
        // Scale s from the median residual (1.1774 σ for Rayleigh-distributed distances), doubled in the first round.
        let mut distances: Vec<f64> = usable
            .iter()
            .map(|m| {
                let c = lattice.centre(m.i, m.j);
                (m.x - c[0]).hypot(m.y - c[1])
            })
            .collect();
        let half = distances.len() / 2;
        let median = *distances.select_nth_unstable_by(half, f64::total_cmp).1;
        let scale = (median / 1.1774 * TUKEY * if round == 0 { 2.0 } else { 1.0 }).max(1e-6);
        let mut normal = [[0f64; 3]; 3];
        let mut right = [[0f64; 3]; 2];
        for m in &usable {
            let c = lattice.centre(m.i, m.j);
            let (rx, ry) = (m.x - c[0], m.y - c[1]);
            let u = (rx * rx + ry * ry) / (scale * scale);
            if u >= 1.0 {
                continue;
            }
            let w = (1.0 - u) * (1.0 - u);
            let row = [1.0, f64::from(m.i), f64::from(m.j)];
            for r in 0..3 {
                for c in 0..3 {
                    normal[r][c] += w * row[r] * row[c];
                }
                right[0][r] += w * row[r] * rx;
                right[1][r] += w * row[r] * ry;
            }
        }
        let (Some(fx), Some(fy)) = (solve_small(normal, right[0]), solve_small(normal, right[1])) else {
            return lattice;
        };
        for (k, f) in [fx, fy].into_iter().enumerate() {
            lattice.origin[k] += f[0];
            lattice.a[k] += f[1];
            lattice.b[k] += f[2];
        }
    }
    lattice
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_do_not_move_the_lattice() {
        let truth = Lattice::hexagonal(10.0, 0.02, 1.001, [100.3, 90.7]);
        let mut measured: Vec<MeasuredLenslet> = (-6..=6)
            .flat_map(|j| (-6..=6).map(move |i| (i, j)))
            .map(|(i, j)| {
                let [x, y] = truth.centre(i, j);
                MeasuredLenslet::from_position(i, j, x, y)
            })
            .collect();
        for (k, m) in measured.iter_mut().enumerate() {
            if k % 9 == 0 {
                (m.x, m.y) = (m.x + 2.5, m.y - 3.0);
            }
            // Not usable, and far away.
            if k % 13 == 1 {
                (m.x, m.usable) = (m.x + 50.0, false);
            }
        }
        let start = Lattice { origin: [100.5, 90.4], a: [9.99, 0.18], ..truth };
        let found = fit_lattice(&start, &measured);
        for (p, q) in [(found.origin, truth.origin), (found.a, truth.a), (found.b, truth.b)] {
            assert!((p[0] - q[0]).hypot(p[1] - q[1]) < 1e-6, "{found:?} {truth:?}");
        }
        assert_eq!(fit_lattice(&start, &measured[..9]), start);
    }
}
