//! Screening: of several images the bad ones (black, saturated, damaged, of another camera) are left out with a note,
//! so that one bad capture does not make the others useless.

use super::error::Error;
use super::options::CalibrationOptions;
use super::{average, checks};
use crate::container::Capture;
use crate::progress::Observer;

/// An image that passed the screening, and its index in the list given, from 0.
pub type Screened<'a> = (usize, &'a Capture);

/// The images that are undamaged, lit, and of the same camera as more than half of them. The observer receives a note
/// for each of the others, with the reason.
///
/// # Errors
/// Where none is left, the error of the first bad one; where no camera has more than half of the images,
/// [`Error::CamerasDiffer`] or [`Error::SizesDiffer`] of the first that differs.
pub fn screen_captures<'a>(
    captures: &'a [Capture],
    options: &CalibrationOptions,
    observer: &dyn Observer,
) -> Result<Vec<Screened<'a>>, Error> {
    let (mut kept, mut first_error): (Vec<Screened<'a>>, _) = (Vec::new(), None);
    for (n, capture) in captures.iter().enumerate() {
        // A single image is checked where it is averaged.
        let judged = checks::check_capture(capture, n + 1).and_then(|()| match captures.len() {
            1 => Ok(()),
            _ => average::average_captures(std::slice::from_ref(capture), |v| v).map(drop),
        });
        match judged {
            Ok(()) => kept.push((n, capture)),
            Err(e) => {
                if captures.len() > 1 {
                    note_left_out(n, &e, options, observer);
                }
                first_error.get_or_insert(e);
            }
        }
    }
    let camera = |a: &Capture, b: &Capture| checks::check_like(a, b, 0).is_ok();
    let like = |c: &Capture| kept.iter().filter(|(_, other)| camera(c, other)).count();
    let Some(&(_, model)) = kept.iter().max_by_key(|(n, c)| (like(c), std::cmp::Reverse(*n))) else {
        return Err(first_error.unwrap_or(Error::NoImages));
    };
    if 2 * like(model) <= kept.len() {
        checks::check_same_camera(&kept.iter().map(|k| k.1).collect::<Vec<_>>())?;
    }
    kept.retain(|(n, c)| match checks::check_like(model, c, n + 1) {
        Ok(()) => true,
        Err(e) => {
            note_left_out(*n, &e, options, observer);
            false
        }
    });
    Ok(kept)
}

/// The name of an image, where the options give one.
pub fn name_of(n: usize, options: &CalibrationOptions) -> String {
    options.names.get(n).cloned().unwrap_or_else(|| format!("image {}", n + 1))
}

/// Notes which image was left out and why, by its name where the options give one.
pub fn note_left_out(n: usize, why: &Error, options: &CalibrationOptions, observer: &dyn Observer) {
    let name = name_of(n, options);
    observer.note(&format!("{name}: left out: {why}"));
}
