//! Algorithm 1, procedure 1, "rotation estimation": which spectral peaks are the fundamentals, and the lattice they
//! imply. In the paper the local maximum closest to zero frequency gives the direction of the lenslet rows.

use super::spectrum::{Peak, Spectrum, spectral_peaks};
use crate::calibration::error::Error;
use crate::calibration::model::Grid;

/// Shortest and longest lattice period looked for, pixels (row distance of pitch 6 and above, pitch up to 40).
/// Source: chosen; Lytro F01 9.9, Illum 14.3
const PERIODS: [f64; 2] = [5.0, 42.0];
/// How far a companion peak may be from its ideal position, as a share of the frequency.
/// Source: chosen
const SLACK: f64 = 0.04;
/// Least prominence of a peak: power over the median power at its distance from zero frequency.
/// Source: chosen
const LEAST_PROMINENCE: f64 = 12.0;

/// Least power of a set of peaks, relative to the strongest set, to be the fundamentals.
/// Source: chosen
const LEAST_POWER: f64 = 0.2;

/// Two fundamental frequencies of the lattice, (x, y) in cycles per pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fundamentals {
    /// Square or hexagonal (rows or columns is decided by the directions).
    pub square: bool,
    /// First fundamental.
    pub f1: [f64; 2],
    /// Second, 60 degrees (hexagonal) or 90 (square) from the first.
    pub f2: [f64; 2],
    /// Smallest prominence among the peaks used.
    pub prominence: f64,
    /// Geometric mean of the peaks' power.
    pub power: f64,
}

/// Lowest and highest frequency of the lattices looked for, cycles per pixel.
pub fn frequency_range() -> (f64, f64) {
    (1.0 / PERIODS[1], 1.0 / PERIODS[0])
}

/// How far a peak may be from its ideal position at the frequency `f`, cycles per pixel; at least 1.2 bins.
fn tolerance(f: [f64; 2], side: usize) -> f64 {
    (SLACK * f[0].hypot(f[1])).max(1.2 / side as f64)
}

/// The strongest peak near the frequency `at` in a spectrum of `side` bins a side, and its frequency with the sign of
/// `at`.
pub fn strongest_peak_near(list: &[Peak], at: [f64; 2], side: usize) -> Option<(Peak, [f64; 2])> {
    strongest_within(list, at, tolerance(at, side))
}

fn rotate_degrees(f: [f64; 2], degrees: f64) -> [f64; 2] {
    let (s, c) = degrees.to_radians().sin_cos();
    [c * f[0] - s * f[1], s * f[0] + c * f[1]]
}

fn strongest_within(list: &[Peak], at: [f64; 2], slack: f64) -> Option<(Peak, [f64; 2])> {
    list.iter()
        .filter_map(|p| {
            let plus = (p.frequency[0] - at[0]).hypot(p.frequency[1] - at[1]);
            let minus = (p.frequency[0] + at[0]).hypot(p.frequency[1] + at[1]);
            let signed = if plus <= minus { p.frequency } else { [-p.frequency[0], -p.frequency[1]] };
            (plus.min(minus) < slack).then_some((*p, signed))
        })
        .max_by(|a, b| a.0.power.total_cmp(&b.0.power))
}

/// Finds the fundamentals: sets of peaks at equal distance from zero frequency, 60 or 90 degrees apart; among sets of
/// comparable power the one closest to zero.
///
/// # Errors
/// [`Error::NoPattern`] when no such set stands out.
pub fn find_fundamentals(spectrum: &Spectrum) -> Result<Fundamentals, Error> {
    let (lowest, highest) = frequency_range();
    let list: Vec<Peak> = spectral_peaks(spectrum, lowest, highest, 400)
        .into_iter()
        .filter(|p| p.prominence >= LEAST_PROMINENCE)
        .collect();
    let mut best: Option<(f64, Fundamentals)> = None;
    let mut sets = Vec::new();
    for p in list.iter().take(60) {
        let f1 = p.frequency;
        let length = f1[0].hypot(f1[1]);
        let slack = tolerance(f1, spectrum.side);
        let six = strongest_within(&list, rotate_degrees(f1, 60.0), slack).zip(strongest_within(
            &list,
            rotate_degrees(f1, -60.0),
            slack,
        ));
        if let Some(((b, f2), (c, _))) = six {
            let power = (p.power * b.power * c.power).cbrt();
            let prominence = p.prominence.min(b.prominence).min(c.prominence);
            sets.push((length, Fundamentals { square: false, f1, f2, prominence, power }));
        } else if let Some((b, f2)) = strongest_within(&list, rotate_degrees(f1, 90.0), slack) {
            // A hexagonal lattice also has peaks at right angles, but of unequal lengths (1 : √3).
            let power = (p.power * b.power).sqrt();
            let prominence = p.prominence.min(b.prominence);
            sets.push((length, Fundamentals { square: true, f1, f2, prominence, power }));
        }
    }
    let strongest = sets.iter().map(|s| s.1.power).fold(0.0, f64::max);
    for set in sets {
        // Harmonics are weaker than their fundamentals, and farther from zero.
        if set.1.power >= LEAST_POWER * strongest && best.as_ref().is_none_or(|b| set.0 < b.0 * 0.97) {
            best = Some(set);
        }
    }
    best.map(|b| b.1).ok_or_else(|| Error::NoPattern {
        reason: "the spectrum has no set of peaks at equal distances and 60 or 90 degrees apart".into(),
    })
}

/// Lattice vectors a, b (pixels) and packing of two fundamental frequencies: a along the direction of nearest
/// neighbours that lies closest to a pixel axis, b the next 60 (square: 90) degrees clockwise on screen.
pub fn lattice_vectors(square: bool, f1: [f64; 2], f2: [f64; 2]) -> (Grid, [f64; 2], [f64; 2]) {
    let det = f1[0] * f2[1] - f1[1] * f2[0];
    // Columns of the inverse transpose: f1·p = 1, f2·p = 0 and the other way round.
    let p = [f2[1] / det, -f2[0] / det];
    let q = [-f1[1] / det, f1[0] / det];
    let mut all = Vec::new();
    for m in -2i32..=2 {
        for n in -2i32..=2 {
            if (m, n) != (0, 0) {
                let (m, n) = (f64::from(m), f64::from(n));
                all.push([m * p[0] + n * q[0], m * p[1] + n * q[1]]);
            }
        }
    }
    let length = |v: &[f64; 2]| v[0].hypot(v[1]);
    all.sort_by(|a, b| length(a).total_cmp(&length(b)));
    all.truncate(if square { 4 } else { 6 });
    let angle = |v: &[f64; 2]| v[1].atan2(v[0]);
    let closest = |target: f64| {
        let gap = |v: &[f64; 2]| {
            let d = (angle(v) - target).rem_euclid(2.0 * std::f64::consts::PI);
            d.min(2.0 * std::f64::consts::PI - d)
        };
        let v = all.iter().min_by(|u, v| gap(u).total_cmp(&gap(v))).copied().unwrap_or([1.0, 0.0]);
        (v, gap(&v))
    };
    let right = closest(0.0);
    let down = closest(std::f64::consts::FRAC_PI_2);
    let (grid, a) = if square {
        (Grid::Square, right.0)
    } else if right.1 <= down.1 {
        (Grid::HexRows, right.0)
    } else {
        (Grid::HexColumns, down.0)
    };
    let step = if square { 90f64 } else { 60f64 };
    let b = closest(angle(&a) + step.to_radians()).0;
    (grid, a, b)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reciprocal vectors of (a, b).
    fn dual(a: [f64; 2], b: [f64; 2]) -> ([f64; 2], [f64; 2]) {
        let det = a[0] * b[1] - a[1] * b[0];
        ([b[1] / det, -b[0] / det], [-a[1] / det, a[0] / det])
    }

    #[test]
    fn vectors_come_back_from_any_pair_of_frequencies() {
        for degrees in [-14.0f64, -3.0, 0.0, 0.3, 5.0, 14.0] {
            let (s, c) = degrees.to_radians().sin_cos();
            let a = [10.0 * c, 10.0 * s];
            let b = rotate_degrees(a, 60.0);
            let (f1, f2) = dual(a, b);
            let f3 = [f1[0] + f2[0], f1[1] + f2[1]];
            for (u, v) in [(f1, f2), (f2, f1), (f3, f1), (f2, f3)] {
                let (grid, a2, b2) = lattice_vectors(false, u, v);
                assert_eq!(grid, Grid::HexRows);
                assert!((a2[0] - a[0]).hypot(a2[1] - a[1]) < 1e-9 && (b2[0] - b[0]).hypot(b2[1] - b[1]) < 1e-9);
            }
            let a = [-10.0 * s, 10.0 * c];
            let b = rotate_degrees(a, 60.0);
            let (f1, f2) = dual(a, b);
            let (grid, a2, b2) = lattice_vectors(false, f1, f2);
            assert_eq!(grid, Grid::HexColumns);
            assert!((a2[0] - a[0]).hypot(a2[1] - a[1]) < 1e-9 && (b2[0] - b[0]).hypot(b2[1] - b[1]) < 1e-9);
            let a = [10.0 * c, 10.0 * s];
            let b = rotate_degrees(a, 90.0);
            let (f1, f2) = dual(a, b);
            let (grid, a2, b2) = lattice_vectors(true, f2, f1);
            assert_eq!(grid, Grid::Square);
            assert!((a2[0] - a[0]).hypot(a2[1] - a[1]) < 1e-9 && (b2[0] - b[0]).hypot(b2[1] - b[1]) < 1e-9);
        }
    }
}
