//! The lenslet pattern of several ordinary captures: each is divided by the local mean of each colour, so that in their
//! weighted mean the scenes average out and the pattern stays.

use rayon::prelude::*;

use super::flatten::flatten_capture;
use crate::calibration::error::Error;
use crate::calibration::fundamentals::{phase, prior, spectrum};
use crate::calibration::locate::{self, LocatedLenslets};
use crate::calibration::options::CalibrationOptions;
use crate::calibration::screening::{self, Screened};
use crate::calibration::sensor_image::SensorImage;
use crate::container::Capture;
use crate::progress::Observer;

/// Least agreement of a capture's pattern with the common lattice (1 = in phase everywhere); below it the capture is of
/// another camera, rotated, or shows no pattern.
/// Source: chosen
const LEAST_AGREEMENT: f64 = 0.3;

/// The common pattern of the captures, and the lenslets located in it. Captures that do not show the pattern are
/// removed from `kept`, with a note.
///
/// # Errors
/// As [`super::calibrate_from_captures`].
pub fn locate_in_captures(
    kept: &mut Vec<Screened>,
    options: &CalibrationOptions,
    observer: &dyn Observer,
) -> Result<(SensorImage, LocatedLenslets), Error> {
    let disagrees = || Error::NoPattern { reason: "its pattern is not that of the others".into() };
    loop {
        observer.begin("pattern", kept.len() as u64);
        let mut image = average_pattern(kept, &options.hot_pixels, observer)?;
        let prior_lattice = kept.iter().find_map(|(_, c)| c.mla.as_ref());
        let located = match locate::locate_lenslets(&mut image, prior_lattice, &options.hot_pixels, observer) {
            Err(e @ Error::NoPattern { .. }) if kept.len() > 1 => {
                let before = kept.len();
                leave_out_unless(kept, &e, options, observer, |image, capture| {
                    prior::fit_with_prior(image, &spectrum::power_spectrum(image), capture.mla.as_ref()).is_ok()
                })?;
                if kept.is_empty() || kept.len() == before {
                    return Err(e);
                }
                continue;
            }
            other => other?,
        };
        if kept.len() > 1 {
            let before = kept.len();
            let lattice = located.lattice;
            leave_out_unless(kept, &disagrees(), options, observer, |image, _| {
                phase::phase_agreement(image, &lattice) >= LEAST_AGREEMENT
            })?;
            if kept.is_empty() {
                return Err(Error::NoPattern { reason: "the captures do not agree on one".into() });
            }
            if kept.len() < before {
                continue;
            }
        }
        return Ok((image, located));
    }
}

/// Keeps the captures for which `shows` is true; the others are noted as left out because of `why`.
fn leave_out_unless(
    kept: &mut Vec<Screened>,
    why: &Error,
    options: &CalibrationOptions,
    observer: &dyn Observer,
    shows: impl Fn(&SensorImage, &Capture) -> bool,
) -> Result<(), Error> {
    let mut stay = Vec::with_capacity(kept.len());
    for &(n, capture) in kept.iter() {
        let (image, _) = flatten_capture(capture, &options.hot_pixels)?;
        if shows(&image, capture) {
            stay.push((n, capture));
        } else {
            screening::note_left_out(n, why, options, observer);
        }
        observer.check()?;
    }
    *kept = stay;
    Ok(())
}

/// The weighted mean of the flattened captures; its local mean is 1.
fn average_pattern(captures: &[Screened], hot_pixels: &[u32], observer: &dyn Observer) -> Result<SensorImage, Error> {
    let mut sum: Option<(SensorImage, Vec<f32>)> = None;
    for (_, capture) in captures {
        let (image, weight) = flatten_capture(capture, hot_pixels)?;
        let (total, weights) = sum.get_or_insert_with(|| {
            let zeros = vec![0f32; image.data.len()];
            (SensorImage { data: zeros.clone(), ..image.clone() }, zeros)
        });
        total.data.par_iter_mut().zip(weights.par_iter_mut()).zip(image.data.par_iter().zip(&weight)).for_each(
            |((t, s), (&v, &w))| {
                *t += w * v;
                *s += w;
            },
        );
        observer.advance(1);
        observer.check()?;
    }
    let (mut image, weights) = sum.ok_or(Error::NoImages)?;
    image.data.par_iter_mut().zip(&weights).for_each(|(v, &w)| *v = if w > 1e-4 { *v / w } else { 1.0 });
    Ok(image)
}
