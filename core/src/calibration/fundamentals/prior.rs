//! The prior lattice of metadata or camera profile (pitch, rotation, row stretch). If the spectrum peaks where the
//! prior predicts, the prior's lattice wins, even where something else in the image repeats more strongly. A prior that
//! contradicts the image changes nothing.

use super::phase::{self, PhaseFit};
use super::rotation::{self, Fundamentals};
use super::spectrum::{Spectrum, spectral_peaks};
use crate::calibration::error::Error;
use crate::calibration::sensor_image::SensorImage;
use crate::container::MlaHint;

/// Minimum coherence of the prior's lattice, relative to that of the blind estimate.
/// Source: chosen
const LEAST_SHARE: f64 = 0.8;
/// Least prominence of a predicted peak; lower than that of peaks found without a prior, which may be chance.
/// Source: chosen
const LEAST_PROMINENCE: f64 = 4.0;

/// Largest distance of a frequency from an integer combination of two others to count as one, in multiples of them.
/// Source: chosen
const COMBINATION: f64 = 0.08;

/// Fits the lattice from the prior where the spectrum confirms it, else from the spectrum alone (the blind estimate).
///
/// # Errors
/// [`Error::NoPattern`].
pub fn fit_with_prior(
    image: &SensorImage,
    spectrum: &Spectrum,
    prior: Option<&MlaHint>,
) -> Result<(Fundamentals, PhaseFit), Error> {
    let blind = rotation::find_fundamentals(spectrum).and_then(|start| Ok((start, phase::fit_phases(image, &start)?)));
    let from_prior = prior
        .and_then(|g| predicted_fundamentals(spectrum, g))
        // A wrong prior may predict harmonics of the pattern: then the blind estimate is kept.
        .filter(|g| blind.as_ref().map_or(true, |(b, _)| !is_combination_of(g, b)))
        .and_then(|g| Some((g, phase::fit_phases(image, &g).ok()?)));
    match (from_prior, blind) {
        (Some(found), Ok(blind)) if found.1.coherence < LEAST_SHARE * blind.1.coherence => Ok(blind),
        (Some(found), _) => Ok(found),
        (None, blind) => blind,
    }
}

/// Whether the frequencies of `a` are integer combinations of those of `b`.
fn is_combination_of(a: &Fundamentals, b: &Fundamentals) -> bool {
    let det = b.f1[0] * b.f2[1] - b.f1[1] * b.f2[0];
    [a.f1, a.f2].iter().all(|f| {
        let along = [(f[0] * b.f2[1] - f[1] * b.f2[0]) / det, (b.f1[0] * f[1] - b.f1[1] * f[0]) / det];
        along.iter().all(|v| (v - v.round()).abs() < COMBINATION)
    })
}

/// The peaks of the spectrum at the fundamentals that a prior predicts: three, 60 degrees apart. Both signs of the
/// rotation are tried, since cameras differ in it.
fn predicted_fundamentals(spectrum: &Spectrum, prior: &MlaHint) -> Option<Fundamentals> {
    let (lowest, highest) = rotation::frequency_range();
    let list = spectral_peaks(spectrum, lowest, highest, 2000);
    let along = |rotation: f64| {
        let row = 0.5 * 3f64.sqrt() * prior.row_stretch;
        let (s, c) = rotation.sin_cos();
        let turn = |v: [f64; 2]| [prior.pitch * (c * v[0] - s * v[1]), prior.pitch * (s * v[0] + c * v[1])];
        let (a, b) = (turn([1.0, 0.0]), turn([0.5, row]));
        let det = a[0] * b[1] - a[1] * b[0];
        let (f1, f2) = ([b[1] / det, -b[0] / det], [-a[1] / det, a[0] / det]);
        let found =
            [f1, f2, [f1[0] + f2[0], f1[1] + f2[1]]].map(|f| rotation::strongest_peak_near(&list, f, spectrum.side));
        let [Some((p, f1)), Some((q, f2)), Some((r, f3))] = found else { return None };
        let prominence = p.prominence.min(q.prominence).min(r.prominence);
        // The third must be the sum of the other two.
        let bin = 1.5 / spectrum.side as f64;
        let closed = (f1[0] + f2[0] - f3[0]).hypot(f1[1] + f2[1] - f3[1]) < bin;
        let power = (p.power * q.power * r.power).cbrt();
        (prominence >= LEAST_PROMINENCE && closed).then_some(Fundamentals { square: false, f1, f2, prominence, power })
    };
    let both = [along(prior.rotation), along(-prior.rotation)];
    both.into_iter().flatten().max_by(|a, b| a.power.total_cmp(&b.power))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fundamentals(f1: [f64; 2], f2: [f64; 2]) -> Fundamentals {
        Fundamentals { square: false, f1, f2, prominence: 10.0, power: 1.0 }
    }

    #[test]
    fn combinations_are_whole_numbers_of_both_waves() {
        let b = fundamentals([0.1, 0.02], [-0.03, 0.11]);
        let sum = |m: f64, n: f64| [m * b.f1[0] + n * b.f2[0], m * b.f1[1] + n * b.f2[1]];
        assert!(is_combination_of(&b, &b));
        assert!(is_combination_of(&fundamentals(sum(2.0, 0.0), sum(1.0, 1.0)), &b));
        assert!(is_combination_of(&fundamentals(sum(1.05, -1.05), sum(0.0, 3.0)), &b));
        assert!(!is_combination_of(&fundamentals(sum(1.5, 0.0), sum(0.0, 1.0)), &b));
        assert!(!is_combination_of(&fundamentals(sum(1.0, 0.0), sum(0.0, 0.5)), &b));
        assert!(!is_combination_of(&fundamentals(sum(1.0, 0.2), sum(0.0, 1.0)), &b));
    }

    #[test]
    fn the_predicted_peaks_are_found_with_either_sign_of_the_rotation() {
        let (width, height) = (512usize, 512usize);
        let truth = crate::geometry::Lattice::hexagonal(10.0, 0.05, 1.002, [250.0, 260.0]);
        let (a, b) = (truth.a, truth.b);
        let det = a[0] * b[1] - a[1] * b[0];
        let (f1, f2) = ([b[1] / det, -b[0] / det], [-a[1] / det, a[0] / det]);
        let data = (0..width * height)
            .map(|k| {
                let (x, y) = ((k % width) as f64 - 250.0, (k / width) as f64 - 260.0);
                let wave = |f: [f64; 2]| (2.0 * std::f64::consts::PI * (f[0] * x + f[1] * y)).cos();
                (0.5 + 0.1 * (wave(f1) + wave(f2) + wave([f1[0] + f2[0], f1[1] + f2[1]]))) as f32
            })
            .collect();
        let image = SensorImage { width, height, data, limit: [f32::INFINITY; 4] };
        let spectrum = super::super::spectrum::power_spectrum(&image);
        for rotation in [0.05, -0.05] {
            let prior = MlaHint { pitch: 10.0, rotation, row_stretch: 1.002 };
            let found = predicted_fundamentals(&spectrum, &prior).unwrap();
            for (p, q) in [(found.f1, f1), (found.f2, f2)] {
                assert!((p[0] - q[0]).hypot(p[1] - q[1]) < 1e-3, "{found:?} {f1:?} {f2:?}");
            }
            let (chosen, fit) = fit_with_prior(&image, &spectrum, Some(&prior)).unwrap();
            assert!(fit.coherence > 0.99 && (fit.lattice.pitch() - 10.0).abs() < 1e-2, "{chosen:?}");
        }
        let wrong = MlaHint { pitch: 13.0, rotation: 0.05, row_stretch: 1.0 };
        assert!(predicted_fundamentals(&spectrum, &wrong).is_none());
        let (_, fit) = fit_with_prior(&image, &spectrum, Some(&wrong)).unwrap();
        assert!((fit.lattice.pitch() - 10.0).abs() < 1e-2);
    }
}
