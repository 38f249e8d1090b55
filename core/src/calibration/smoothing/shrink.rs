//! Empirical-Bayes shrinkage: centre = lattice prediction + trust · residual, with trust = (τ² − s²) / (τ² + σ²). τ² is
//! the variance of lenslets about the lattice plus a smooth distortion (cubic in x and y), σ² the variance of a
//! lenslet's measurement, s² the covariance of neighbours' residuals. All are estimated from the image: σ² from the
//! misfit of lenslets of similar brightness, τ² by maximum likelihood over all residuals. (Beyond paper section 3.2.)

use crate::calibration::centres::measured::MeasuredLenslet;
use crate::calibration::model::Lattice;
use crate::geometry::Size;
use crate::linalg::solve_small;

/// Outlier threshold for residuals (dust, dead lenslets, reflections), in standard deviations √(τ² + σ²).
/// Source: chosen
const OUTLIER: f64 = 6.0;
/// A misfit this many times the median of lenslets of similar brightness rejects the measurement.
/// Source: chosen
const BAD_FIT: f64 = 5.0;
/// Terms of the smooth distortion: polynomials of degree 3 in x and y.
/// Source: chosen
const TERMS: usize = 10;

/// Shrunk centres, and the variances they were shrunk by.
#[derive(Debug, Clone)]
pub struct ShrunkCentres {
    /// Centre (x, y) in pixels and trust (0 to 1) of each measured lenslet, in the order given.
    pub centres: Vec<([f64; 2], f32)>,
    /// Share of lenslets whose measurement was rejected, 0 to 1.
    pub rejected: f64,
    /// RMS distance of accepted measured centres from the lattice, pixels.
    pub residual_rms: f64,
    /// Scatter of the lenslets themselves, √(τ² − s²), per axis, pixels.
    pub scatter: f64,
    /// Typical standard deviation of a measurement, √(s² + σ²), per axis, pixels.
    pub noise: f64,
}

/// Median misfit of lenslets of similar brightness, as a table over brightness ranks.
struct MisfitTable {
    edges: Vec<f64>,
    levels: Vec<f64>,
}

impl MisfitTable {
    fn new(measured: &[MeasuredLenslet]) -> Self {
        let mut order: Vec<(f64, f64)> = measured.iter().filter(|m| m.usable).map(|m| (m.gain, m.misfit)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let bins = (order.len() / 200).clamp(1, 32);
        let (mut edges, mut levels) = (Vec::new(), Vec::new());
        for k in 0..bins {
            let (from, to) = (k * order.len() / bins, (k + 1) * order.len() / bins);
            let part = &mut order[from..to];
            let Some(last) = part.last() else { continue };
            edges.push(last.0);
            let half = part.len() / 2;
            part.sort_by(|a, b| a.1.total_cmp(&b.1));
            levels.push(part[half].1);
        }
        MisfitTable { edges, levels }
    }

    fn misfit_at(&self, gain: f64) -> f64 {
        let k = self.edges.partition_point(|&e| e < gain).min(self.levels.len().saturating_sub(1));
        self.levels.get(k).copied().unwrap_or(f64::INFINITY)
    }
}

/// Shrinks measured centres towards the lattice plus a smooth distortion, each by the variance of its measurement;
/// `width` and `height` are the sensor's, pixels.
pub fn shrink_centres(lattice: &Lattice, measured: &[MeasuredLenslet], size: Size) -> ShrunkCentres {
    let Size { width, height } = size;
    let table = MisfitTable::new(measured);
    let variances: Vec<[f64; 2]> = measured
        .iter()
        .map(|m| {
            let level = table.misfit_at(m.gain).max(1e-12);
            let own = if m.misfit > BAD_FIT * level || !m.usable { f64::INFINITY } else { level };
            m.unit.map(|u| u * own)
        })
        .collect();
    let mut rests: Vec<[f64; 2]> = measured
        .iter()
        .map(|m| {
            let c = lattice.centre(m.i, m.j);
            [m.x - c[0], m.y - c[1]]
        })
        .collect();
    let mut accepted: Vec<bool> = variances.iter().map(|v| v.iter().all(|v| v.is_finite())).collect();
    let (mut tau, mut smooth) = (0.0, [[0f64; TERMS]; 2]);
    let raw = rests.clone();
    for _ in 0..3 {
        tau = estimate_scatter(&rests, &variances, &accepted);
        for ((ok, r), v) in accepted.iter_mut().zip(&rests).zip(&variances) {
            *ok = (0..2).all(|k| v[k].is_finite() && r[k] * r[k] <= OUTLIER * OUTLIER * (tau + v[k]).max(1e-8));
        }
        smooth = fit_distortion(measured, &raw, &variances, &accepted, tau, width, height);
        for ((rest, m), raw) in rests.iter_mut().zip(measured).zip(&raw) {
            let d = evaluate_distortion(&smooth, lattice.centre(m.i, m.j), width, height);
            *rest = [raw[0] - d[0], raw[1] - d[1]];
        }
    }
    // Position errors of lenslets are independent: what neighbours in a row share beyond the smooth distortion comes
    // from a scene, a reflection or a film of dust, and counts as noise.
    let shared = tau * shared_scatter(measured, &rests, &accepted, tau);
    let mut sum = 0.0;
    let mut noise_sum = 0.0;
    let count = accepted.iter().filter(|&&ok| ok).count();
    let centres = measured
        .iter()
        .zip(&rests)
        .zip(&variances)
        .zip(&accepted)
        .zip(&raw)
        .map(|((((m, rest), v), &ok), raw)| {
            let c = lattice.centre(m.i, m.j);
            let d = evaluate_distortion(&smooth, c, width, height);
            let trust = if ok { [0, 1].map(|k| (tau - shared) / (tau + v[k])) } else { [0.0; 2] };
            if ok {
                sum += raw[0] * raw[0] + raw[1] * raw[1];
                noise_sum += shared + 0.5 * (v[0] + v[1]);
            }
            let at = [c[0] + d[0] + trust[0] * rest[0], c[1] + d[1] + trust[1] * rest[1]];
            (at, (0.5 * (trust[0] + trust[1])) as f32)
        })
        .collect();
    let n = count.max(1) as f64;
    ShrunkCentres {
        centres,
        rejected: 1.0 - count as f64 / measured.len().max(1) as f64,
        residual_rms: (sum / n).sqrt(),
        scatter: (tau - shared).max(0.0).sqrt(),
        noise: (noise_sum / n).sqrt(),
    }
}

/// Share of the variance that neighbours in a row have in common, s²/τ², 0 to 1: mean product of their residuals over
/// τ².
fn shared_scatter(measured: &[MeasuredLenslet], rests: &[[f64; 2]], accepted: &[bool], tau: f64) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    for k in 1..measured.len() {
        let (m, n) = (&measured[k - 1], &measured[k]);
        if accepted[k - 1] && accepted[k] && (m.j, m.i + 1) == (n.j, n.i) {
            sum += 0.5 * (rests[k - 1][0] * rests[k][0] + rests[k - 1][1] * rests[k][1]);
            count += 1;
        }
    }
    // With fewer pairs the standard error of the estimate is about a tenth or more.
    if count < 100 || tau <= 0.0 { 0.0 } else { (sum / count as f64 / tau).clamp(0.0, 1.0) }
}

/// Maximum-likelihood τ²: the root of Σ (r² − τ² − σ²)/(τ² + σ²)² = 0, by bisection; 0 with fewer than 20 residuals.
fn estimate_scatter(rests: &[[f64; 2]], variances: &[[f64; 2]], accepted: &[bool]) -> f64 {
    let mut squares: Vec<f64> = Vec::with_capacity(rests.len());
    for (r, &ok) in rests.iter().zip(accepted) {
        if ok {
            squares.push(r[0] * r[0] + r[1] * r[1]);
        }
    }
    if squares.len() < 20 {
        return 0.0;
    }
    let half = squares.len() / 2;
    let median = *squares.select_nth_unstable_by(half, f64::total_cmp).1;
    // Outliers must not raise τ²: residuals beyond four robust standard deviations are left out (median of r² is 1.386
    // σ²).
    let far = 16.0 * median / 1.386;
    let score = |t: f64| {
        let mut sum = 0.0;
        for ((r, v), &ok) in rests.iter().zip(variances).zip(accepted) {
            if ok && r[0] * r[0] + r[1] * r[1] <= far {
                for k in 0..2 {
                    let total = t + v[k] + 1e-12;
                    sum += (r[k] * r[k] - total) / (total * total);
                }
            }
        }
        sum
    };
    if score(0.0) <= 0.0 {
        return 0.0;
    }
    let (mut low, mut high) = (0.0, median.max(1e-12));
    for _ in 0..60 {
        if score(high) > 0.0 {
            (low, high) = (high, 2.0 * high);
        } else {
            break;
        }
    }
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if score(middle) > 0.0 { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

fn cubic_terms(c: [f64; 2], width: usize, height: usize) -> [f64; TERMS] {
    let half = 0.5 * width.max(height) as f64;
    let (x, y) = (c[0] / half - width as f64 / (2.0 * half), c[1] / half - height as f64 / (2.0 * half));
    [1.0, x, y, x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y]
}

fn evaluate_distortion(smooth: &[[f64; TERMS]; 2], c: [f64; 2], width: usize, height: usize) -> [f64; 2] {
    let p = cubic_terms(c, width, height);
    [0, 1].map(|k| smooth[k].iter().zip(&p).map(|(a, b)| a * b).sum())
}

/// Smooth distortion beyond the lattice, weighted least squares; 0 with fewer than 2000 lenslets.
fn fit_distortion(
    measured: &[MeasuredLenslet],
    rests: &[[f64; 2]],
    variances: &[[f64; 2]],
    accepted: &[bool],
    tau: f64,
    width: usize,
    height: usize,
) -> [[f64; TERMS]; 2] {
    let mut normal = [[[0f64; TERMS]; TERMS]; 2];
    let mut right = [[0f64; TERMS]; 2];
    let mut count = 0usize;
    for (((m, r), v), &ok) in measured.iter().zip(rests).zip(variances).zip(accepted) {
        if !ok {
            continue;
        }
        count += 1;
        let p = cubic_terms([m.x, m.y], width, height);
        for k in 0..2 {
            let w = 1.0 / (tau + v[k] + 1e-12);
            for a in 0..TERMS {
                for b in 0..TERMS {
                    normal[k][a][b] += w * p[a] * p[b];
                }
                right[k][a] += w * p[a] * r[k];
            }
        }
    }
    if count < 2000 {
        return [[0.0; TERMS]; 2];
    }
    [0, 1].map(|k| solve_small(normal[k], right[k]).unwrap_or([0.0; TERMS]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::standard_normal;
    use rand::SeedableRng;
    use rand::rngs::ChaCha8Rng;

    const SIZE: Size = Size { width: 600, height: 500 };

    fn lattice() -> Lattice {
        Lattice::hexagonal(9.0, 0.01, 1.0, [300.0, 250.0])
    }

    /// Every lenslet of the sensor at its place plus what `off` says.
    fn measured(mut off: impl FnMut([f64; 2]) -> [f64; 2], misfit: f64) -> Vec<MeasuredLenslet> {
        let points = lattice().points_within(SIZE, 0.0);
        points
            .index
            .iter()
            .zip(&points.centres)
            .map(|(&[i, j], &c)| {
                let d = off(c);
                MeasuredLenslet { misfit, ..MeasuredLenslet::from_position(i, j, c[0] + d[0], c[1] + d[1]) }
            })
            .collect()
    }

    #[test]
    fn scatter_and_noise_are_told_apart() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        // Lenslets scattered by 0.08, measured with an error of 0.06.
        let mut normal = |s: f64| s * standard_normal(&mut rng);
        let all = measured(|_| [normal(0.1), normal(0.1)], 0.0036);
        assert!(all.len() > 3000, "{}", all.len());
        let found = shrink_centres(&lattice(), &all, SIZE);
        assert!((found.scatter - 0.08).abs() < 0.004, "{}", found.scatter);
        assert!((found.noise - 0.06).abs() < 0.003, "{}", found.noise);
        assert!((found.residual_rms - 0.1 * 2f64.sqrt()).abs() < 0.004, "{}", found.residual_rms);
        assert!(found.rejected < 1e-3);
        let trust = 0.0064 / 0.01;
        for (m, (centre, t)) in all.iter().zip(&found.centres) {
            let c = lattice().centre(m.i, m.j);
            let expected = [c[0] + trust * (m.x - c[0]), c[1] + trust * (m.y - c[1])];
            assert!((centre[0] - expected[0]).hypot(centre[1] - expected[1]) < 0.04, "{centre:?} {expected:?}");
            assert!((f64::from(*t) - trust).abs() < 0.04, "{t}");
        }
    }

    #[test]
    fn a_smooth_distortion_is_kept_and_outliers_are_not() {
        let bend = |c: [f64; 2]| {
            let (x, y) = ((c[0] - 300.0) / 300.0, (c[1] - 250.0) / 300.0);
            [0.3 * x * x * x - 0.2 * x * y + 0.1, 0.25 * x * x * y + 0.15 * y * y]
        };
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut all = measured(|c| bend(c).map(|d| d + 0.01 * standard_normal(&mut rng)), 1e-4);
        let n = all.len();
        for k in [700, 1500] {
            all[k].x += 2.0;
        }
        all[900].usable = false;
        all[1100].misfit = 6e-4; // six times the median: a bad fit
        let found = shrink_centres(&lattice(), &all, SIZE);
        assert!((found.rejected - 4.0 / n as f64).abs() < 1e-6, "{}", found.rejected * n as f64);
        for (k, (m, (centre, trust))) in all.iter().zip(&found.centres).enumerate() {
            let c = lattice().centre(m.i, m.j);
            let d = bend(c);
            assert!((centre[0] - c[0] - d[0]).hypot(centre[1] - c[1] - d[1]) < 0.02, "{k}: {centre:?}");
            assert!(![700, 900, 1100, 1500].contains(&k) || *trust == 0.0);
        }
    }

    #[test]
    fn what_neighbours_share_counts_as_noise() {
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        let mut all = measured(|_| [0.0; 2], 1e-6);
        let mut row = (i32::MIN, [0.0; 2]);
        for m in &mut all {
            // Each row is displaced as a whole by 0.06, each lenslet by 0.08 of its own.
            if row.0 != m.j {
                row = (m.j, [0, 1].map(|_| 0.06 * standard_normal(&mut rng)));
            }
            m.x += row.1[0] + 0.08 * standard_normal(&mut rng);
            m.y += row.1[1] + 0.08 * standard_normal(&mut rng);
        }
        let found = shrink_centres(&lattice(), &all, SIZE);
        assert!((found.scatter - 0.08).abs() < 0.008, "{}", found.scatter);
        assert!((found.noise - 0.06).abs() < 0.02, "{}", found.noise);
        let rests: Vec<[f64; 2]> =
            (0..all.len()).map(|k| if all[k].i % 2 == 0 { [0.2, 0.1] } else { [0.1, -0.2] }).collect();
        let accepted = vec![true; all.len()];
        // Products of neighbours: 0.02 − 0.02.
        assert!(shared_scatter(&all, &rests, &accepted, 0.05).abs() < 1e-12);
        let equal = vec![[0.1, 0.1]; all.len()];
        assert!((shared_scatter(&all, &equal, &accepted, 0.04) - 0.25).abs() < 1e-9);
        assert_eq!(shared_scatter(&all[..100], &equal, &accepted, 0.04), 0.0);
        let mut one_way = equal.clone();
        one_way.iter_mut().for_each(|r| r[1] = 0.0);
        assert!((shared_scatter(&all, &one_way, &accepted, 0.04) - 0.125).abs() < 1e-9);
    }

    #[test]
    fn misfits_are_compared_with_those_of_similar_brightness() {
        let of =
            |gain: f64, misfit: f64| MeasuredLenslet { gain, misfit, ..MeasuredLenslet::from_position(0, 0, 0.0, 0.0) };
        let all: Vec<MeasuredLenslet> = (0..800).map(|k| of(f64::from(k), if k < 400 { 4.0 } else { 1.0 })).collect();
        let table = MisfitTable::new(&all);
        assert_eq!(table.levels, [4.0, 4.0, 1.0, 1.0]);
        assert_eq!(
            (table.misfit_at(-1.0), table.misfit_at(399.0), table.misfit_at(400.0), table.misfit_at(1e9)),
            (4.0, 4.0, 1.0, 1.0)
        );
        assert_eq!(MisfitTable::new(&[]).misfit_at(1.0), f64::INFINITY);
    }

    #[test]
    fn few_residuals_have_no_scatter() {
        let (rests, variances) = (vec![[0.3, -0.2]; 20], vec![[1e-4; 2]; 20]);
        assert_eq!(estimate_scatter(&rests[..19], &variances[..19], &[true; 19]), 0.0);
        let found = estimate_scatter(&rests, &variances, &[true; 20]);
        // The root of (0.09 − v)/v² + (0.04 − v)/v² = 0, v = τ² + 10⁻⁴.
        assert!((found - (0.065 - 1e-4)).abs() < 1e-6, "{found}");
        assert_eq!(estimate_scatter(&rests, &[[1.0; 2]; 20], &[true; 20]), 0.0);
    }
}
