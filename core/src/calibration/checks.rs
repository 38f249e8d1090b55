//! Checks before any calibration: images that are too small, damaged, or of different cameras are refused.

use std::borrow::Borrow;

use super::error::Error;
use crate::container::Capture;

/// Smallest side of an image that can be calibrated, pixels.
/// Source: chosen (a few lenslets of the largest pitch looked for)
const SMALLEST: usize = 64;

/// Refuses captures that cannot be calibrated together: of one camera and size, large enough, white level above black.
///
/// # Errors
/// The error of the first capture that cannot be calibrated.
pub fn check_same_camera<C: Borrow<Capture>>(captures: &[C]) -> Result<(), Error> {
    let first = captures.first().ok_or(Error::NoImages)?.borrow();
    for (n, capture) in captures.iter().enumerate() {
        let capture = capture.borrow();
        check_capture(capture, n + 1)?;
        check_like(first, capture, n + 1)?;
    }
    Ok(())
}

/// Refuses a capture that is too small, or whose pixels or levels contradict each other; `index` counts from 1.
///
/// # Errors
/// [`Error::BadImage`].
pub fn check_capture(capture: &Capture, index: usize) -> Result<(), Error> {
    let (width, height) = (capture.mosaic.width, capture.mosaic.height);
    let bad = |reason| Error::BadImage { index, width, height, reason };
    if width < SMALLEST || height < SMALLEST {
        return Err(bad("it is smaller than 64 pixels"));
    }
    if capture.mosaic.data.len() != width.saturating_mul(height) || u32::try_from(capture.mosaic.data.len()).is_err() {
        return Err(bad("its pixels do not fit its size"));
    }
    for p in 0..4 {
        let (black, white) = (capture.levels.black[p], capture.levels.white[p]);
        if !(black.is_finite() && white.is_finite() && white > black) {
            return Err(bad("its white level is not above its black level"));
        }
    }
    Ok(())
}

/// Refuses a capture (`index`, from 1) of another sensor size or serial number than `first`.
///
/// # Errors
/// [`Error::SizesDiffer`], [`Error::CamerasDiffer`].
pub fn check_like(first: &Capture, capture: &Capture, index: usize) -> Result<(), Error> {
    let (width, height) = (first.mosaic.width, first.mosaic.height);
    let (got_width, got_height) = (capture.mosaic.width, capture.mosaic.height);
    if (got_width, got_height) != (width, height) {
        return Err(Error::SizesDiffer { index, got_width, got_height, width, height });
    }
    match (&first.camera.serial, &capture.camera.serial) {
        (Some(expected), Some(got)) if expected != got => {
            Err(Error::CamerasDiffer { index, got: got.clone(), expected: expected.clone() })
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::container::{Cfa, Levels, RawMosaic};

    fn capture(width: usize, height: usize) -> Capture {
        let levels = Levels { black: [100.0; 4], white: [1100.0; 4] };
        Capture::bare(RawMosaic { width, height, data: vec![600; width * height] }, Cfa::Bggr, levels)
    }

    #[test]
    fn small_captures_and_wrong_levels_are_refused() {
        assert!(check_capture(&capture(64, 64), 1).is_ok());
        assert!(check_capture(&capture(63, 64), 1).is_err() && check_capture(&capture(64, 63), 1).is_err());
        let mut short = capture(64, 64);
        short.mosaic.data.pop();
        assert!(check_capture(&short, 1).is_err());
        for (black, white) in [(100.0, 100.0), (f32::NAN, 200.0), (0.0, f32::INFINITY), (200.0, 100.0)] {
            let mut bad = capture(64, 64);
            (bad.levels.black[3], bad.levels.white[3]) = (black, white);
            assert!(matches!(check_capture(&bad, 7), Err(Error::BadImage { index: 7, .. })));
        }
    }

    #[test]
    fn one_size_and_one_serial_number() {
        let first = capture(80, 64);
        assert!(check_like(&first, &capture(80, 64), 2).is_ok());
        assert!(matches!(check_like(&first, &capture(80, 66), 2), Err(Error::SizesDiffer { index: 2, .. })));
        assert!(matches!(check_like(&first, &capture(82, 64), 2), Err(Error::SizesDiffer { .. })));
        let serial = |s: &str| {
            let mut c = capture(80, 64);
            c.camera.serial = Some(s.into());
            c
        };
        assert!(check_like(&first, &serial("A"), 2).is_ok() && check_like(&serial("A"), &serial("A"), 2).is_ok());
        assert!(matches!(check_like(&serial("A"), &serial("B"), 3), Err(Error::CamerasDiffer { index: 3, .. })));
    }
}
