//! Calibration without white images: several ordinary captures, each divided by the local mean of each colour, average to the
//! lenslet pattern. What a lenslet's own centre is worth is told by how well the captures agree on it.

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

/// A capture whose pattern agrees less than this with that of all is of another camera, turned, or none.
const STRANGE: f64 = 0.3;

/// The pattern of the captures that show it, and what was found in it. Captures that do not show it are left out of `kept`, with
/// a note.
///
/// # Errors
/// As [`super::calibrate_from_captures`].
pub fn locate_in_captures(
    kept: &mut Vec<Screened>,
    options: &CalibrationOptions,
    observer: &dyn Observer,
) -> Result<(SensorImage, LocatedLenslets), Error> {
    let strange = || Error::NoPattern { reason: "its pattern is not that of the others".into() };
    loop {
        observer.begin("pattern", kept.len() as u64);
        let mut plane = average_pattern(kept, &options.hot_pixels, observer)?;
        let hint = kept.iter().find_map(|(_, c)| c.mla.as_ref());
        let refined = match locate::locate_lenslets(&mut plane, hint, &options.hot_pixels, observer) {
            Err(e @ Error::NoPattern { .. }) if kept.len() > 1 => {
                let before = kept.len();
                leave_out_unless(kept, &e, options, observer, |plane, capture| {
                    prior::fit_with_prior(plane, &spectrum::power_spectrum(plane), capture.mla.as_ref()).is_ok()
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
            let lattice = refined.lattice;
            leave_out_unless(kept, &strange(), options, observer, |plane, _| {
                phase::phase_agreement(plane, &lattice) >= STRANGE
            })?;
            if kept.is_empty() {
                return Err(Error::NoPattern { reason: "the captures do not agree on one".into() });
            }
            if kept.len() < before {
                continue;
            }
        }
        return Ok((plane, refined));
    }
}

/// Keeps the captures of which `shows` holds; `why` is noted of the others.
fn leave_out_unless(
    kept: &mut Vec<Screened>,
    why: &Error,
    options: &CalibrationOptions,
    observer: &dyn Observer,
    shows: impl Fn(&SensorImage, &Capture) -> bool,
) -> Result<(), Error> {
    let mut stay = Vec::with_capacity(kept.len());
    for &(n, capture) in kept.iter() {
        let (plane, _) = flatten_capture(capture, &options.hot_pixels)?;
        if shows(&plane, capture) {
            stay.push((n, capture));
        } else {
            screening::note_left_out(n, why, options, observer);
        }
        if observer.cancelled() {
            return Err(Error::Interrupted);
        }
    }
    *kept = stay;
    Ok(())
}

/// The pattern of all captures together: local mean 1, scene averaged away as far as there are captures.
fn average_pattern(captures: &[Screened], hot_pixels: &[u32], observer: &dyn Observer) -> Result<SensorImage, Error> {
    let mut sum: Option<(SensorImage, Vec<f32>)> = None;
    for (_, capture) in captures {
        let (plane, weight) = flatten_capture(capture, hot_pixels)?;
        let (total, weights) = sum.get_or_insert_with(|| {
            let zeros = vec![0f32; plane.data.len()];
            (SensorImage { data: zeros.clone(), ..plane.clone() }, zeros)
        });
        total.data.par_iter_mut().zip(weights.par_iter_mut()).zip(plane.data.par_iter().zip(&weight)).for_each(
            |((t, s), (&v, &w))| {
                *t += w * v;
                *s += w;
            },
        );
        observer.advance(1);
        if observer.cancelled() {
            return Err(Error::Interrupted);
        }
    }
    let (mut plane, weights) = sum.ok_or(Error::NoImages)?;
    plane.data.par_iter_mut().zip(&weights).for_each(|(v, &w)| *v = if w > 1e-4 { *v / w } else { 1.0 });
    Ok(plane)
}
