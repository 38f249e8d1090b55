//! Regular lattice fitted over all measured centres, robustly: min over origin, a, b of Σ ρ(|c_ij − origin − i·a − j·b| / s)
//! with Tukey's ρ (paper section 3.2: "fit a regular triangle grid to the estimated center points"). Row stretch comes with it,
//! since a and b are free.

use super::measure::Measured;
use super::{Lattice, linear};

/// Tukey's constant: 95 % as efficient as least squares on Gaussian errors.
const TUKEY: f64 = 4.685;
/// Rounds of reweighting.
const ROUNDS: usize = 6;

/// The same lattice with (0, 0) at the lenslet nearest the sensor's middle.
pub fn centred(lattice: Lattice, width: usize, height: usize) -> Lattice {
    let middle = [(width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0];
    let [i, j] = lattice.coordinates(middle[0], middle[1]).map(f64::round);
    let mut best = lattice.origin;
    let mut least = f64::INFINITY;
    for di in -1..=1 {
        for dj in -1..=1 {
            let (i, j) = (i + f64::from(di), j + f64::from(dj));
            let c = [
                lattice.origin[0] + i * lattice.a[0] + j * lattice.b[0],
                lattice.origin[1] + i * lattice.a[1] + j * lattice.b[1],
            ];
            let distance = (c[0] - middle[0]).hypot(c[1] - middle[1]);
            if distance < least {
                (least, best) = (distance, c);
            }
        }
    }
    Lattice { origin: best, ..lattice }
}

/// Indices (i, j) of every lenslet whose predicted centre lies on the sensor or at most `margin` pixels outside, by (j, i).
pub fn indices(lattice: &Lattice, width: usize, height: usize, margin: f64) -> Vec<[i32; 2]> {
    let (right, bottom) = (width as f64 - 1.0 + margin, height as f64 - 1.0 + margin);
    let corners = [[-margin, -margin], [right, -margin], [-margin, bottom], [right, bottom]];
    let coordinates = corners.map(|c| lattice.coordinates(c[0], c[1]));
    let bound = |k: usize| {
        let low = coordinates.iter().map(|c| c[k]).fold(f64::INFINITY, f64::min);
        let high = coordinates.iter().map(|c| c[k]).fold(f64::NEG_INFINITY, f64::max);
        (low.floor() as i32 - 1, high.ceil() as i32 + 1)
    };
    let ((i0, i1), (j0, j1)) = (bound(0), bound(1));
    let mut all = Vec::new();
    for j in j0..=j1 {
        for i in i0..=i1 {
            let [x, y] = lattice.centre(i, j);
            if x >= -margin && x <= right && y >= -margin && y <= bottom {
                all.push([i, j]);
            }
        }
    }
    all
}

/// Robust fit over the measured centres that are usable; `start` gives the packing, and is returned when fewer than ten are.
pub fn fit(start: &Lattice, measured: &[Measured]) -> Lattice {
    let usable: Vec<&Measured> = measured.iter().filter(|m| m.usable).collect();
    if usable.len() < 10 {
        return *start;
    }
    let mut lattice = *start;
    for round in 0..ROUNDS {
        // Scale from the median of the residuals; the first round trusts the start only roughly.
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
        let (Some(fx), Some(fy)) = (linear::solve(normal, right[0]), linear::solve(normal, right[1])) else {
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
