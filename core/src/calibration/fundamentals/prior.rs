//! The first guess of metadata or profile (pitch, rotation, row stretch of the lenslets): where the spectrum has peaks at the places it
//! foretells, the lattice is theirs, even where something else in the image repeats more strongly.
//! A guess that contradicts the image changes nothing.

use super::phase::{self, PhaseFit};
use super::rotation::{self, Fundamentals};
use super::spectrum::{Spectrum, spectral_peaks};
use crate::calibration::error::Error;
use crate::calibration::sensor_image::SensorImage;
use crate::container::MlaHint;

/// Share of the blind lattice's coherence over the sensor that the predicted_fundamentals one must have.
const LEAST_SHARE: f64 = 0.8;
/// A predicted_fundamentals peak counts when it stands this far above the median power at its distance (one met by chance must stand
/// out more).
const LEAST_PROMINENCE: f64 = 4.0;

/// Locks the lattice from the guess where the image bears it out, else from the spectrum alone.
///
/// # Errors
/// [`Error::NoPattern`].
pub fn fit_with_prior(
    plane: &SensorImage,
    spectrum: &Spectrum,
    guess: Option<&MlaHint>,
) -> Result<(Fundamentals, PhaseFit), Error> {
    let blind = rotation::find_fundamentals(spectrum).and_then(|start| Ok((start, phase::fit_phases(plane, &start)?)));
    let guessed = guess
        .and_then(|g| predicted_fundamentals(spectrum, g))
        // A wrong guess may meet the pattern's own overtones; the pattern itself is as well taken as it was found.
        .filter(|g| blind.as_ref().map_or(true, |(b, _)| !is_combination_of(g, b)))
        .and_then(|g| Some((g, phase::fit_phases(plane, &g).ok()?)));
    match (guessed, blind) {
        (Some(found), Ok(blind)) if found.1.coherence < LEAST_SHARE * blind.1.coherence => Ok(blind),
        (Some(found), _) => Ok(found),
        (None, blind) => blind,
    }
}

/// Whether the frequencies of `a` are sums of those of `b`.
fn is_combination_of(a: &Fundamentals, b: &Fundamentals) -> bool {
    let det = b.f1[0] * b.f2[1] - b.f1[1] * b.f2[0];
    [a.f1, a.f2].iter().all(|f| {
        let along = [(f[0] * b.f2[1] - f[1] * b.f2[0]) / det, (b.f1[0] * f[1] - b.f1[1] * f[0]) / det];
        along.iter().all(|v| (v - v.round()).abs() < 0.08)
    })
}

/// The fundamentals a guess foretells, as the spectrum has them: three peaks 60 degrees apart. Cameras do not agree on the sign of
/// the rotation.
fn predicted_fundamentals(spectrum: &Spectrum, guess: &MlaHint) -> Option<Fundamentals> {
    let (lowest, highest) = rotation::frequency_range();
    let list = spectral_peaks(spectrum, lowest, highest, 2000);
    let along = |rotation: f64| {
        let row = 0.5 * 3f64.sqrt() * guess.row_stretch;
        let (s, c) = rotation.sin_cos();
        let turn = |v: [f64; 2]| [guess.pitch * (c * v[0] - s * v[1]), guess.pitch * (s * v[0] + c * v[1])];
        let (a, b) = (turn([1.0, 0.0]), turn([0.5, row]));
        let det = a[0] * b[1] - a[1] * b[0];
        let (f1, f2) = ([b[1] / det, -b[0] / det], [-a[1] / det, a[0] / det]);
        let found =
            [f1, f2, [f1[0] + f2[0], f1[1] + f2[1]]].map(|f| rotation::strongest_peak_near(&list, f, spectrum.side));
        let [Some((p, f1)), Some((q, f2)), Some((r, f3))] = found else { return None };
        let prominence = p.prominence.min(q.prominence).min(r.prominence);
        // The third must be where the other two put it.
        let bin = 1.5 / spectrum.side as f64;
        let closed = (f1[0] + f2[0] - f3[0]).hypot(f1[1] + f2[1] - f3[1]) < bin;
        let power = (p.power * q.power * r.power).cbrt();
        (prominence >= LEAST_PROMINENCE && closed).then_some(Fundamentals { square: false, f1, f2, prominence, power })
    };
    let both = [along(guess.rotation), along(-guess.rotation)];
    both.into_iter().flatten().max_by(|a, b| a.power.total_cmp(&b.power))
}
