//! Whether a calibration belongs to a capture: a lattice of another camera decodes to rubbish, so it is refused.

use super::error::Error;
use super::model::Calibration;
use crate::container::Capture;

/// Refuses a calibration of another sensor size, model or body than the capture's, as far as both say.
///
/// # Errors
/// [`Error::WrongCamera`], with both sides named.
pub fn check_compatible(calibration: &Calibration, capture: &Capture) -> Result<(), Error> {
    let (width, height) = (capture.mosaic.width, capture.mosaic.height);
    if (width, height) != (calibration.width, calibration.height) {
        return Err(Error::WrongCamera(format!(
            "it is of a {}x{} sensor, the capture is {width}x{height}",
            calibration.width, calibration.height
        )));
    }
    if let (Some(ours), Some(theirs)) = (&calibration.origin.serial, &capture.camera.serial)
        && ours != theirs
    {
        return Err(Error::WrongCamera(format!("it is of camera {ours}, the capture of camera {theirs}")));
    }
    if let (Some(ours), Some(theirs)) = (&calibration.origin.model, &capture.camera.model)
        && family(ours) != family(theirs)
    {
        return Err(Error::WrongCamera(format!("it is of a camera {ours}, the capture of a camera {theirs}")));
    }
    Ok(())
}

/// White images of an Illum call it B01.
fn family(model: &str) -> String {
    match model.trim().to_ascii_uppercase().as_str() {
        "B01" => "ILLUM".into(),
        other => other.into(),
    }
}

/// What differs but does not forbid decoding: zoom and focus move the micro-images a little. One line each.
pub fn lens_setting_differences(calibration: &Calibration, capture: &Capture) -> Vec<String> {
    let mut lines = Vec::new();
    let pairs = [
        ("zoom", calibration.origin.zoom_step, capture.camera.zoom_step),
        ("focus", calibration.origin.focus_step, capture.camera.focus_step),
    ];
    for (what, ours, theirs) in pairs {
        if let (Some(ours), Some(theirs)) = (ours, theirs)
            && ours != theirs
        {
            lines.push(format!("the calibration was made at {what} step {ours}, the capture taken at {theirs}"));
        }
    }
    lines
}
