//! Whether a calibration belongs to a capture: the lattice of another camera gives wrong views, so it is refused.

use super::error::Error;
use super::model::Calibration;
use crate::container::{Capture, same_model};

/// Refuses a calibration of another sensor size, serial number or model than the capture's. Serial number and model are
/// compared only where both sides state them; models of one camera profile (`models` and `aliases` in its TOML file)
/// count as the same.
///
/// ```
/// # mod drawn { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/common/drawn.rs")); }
/// # use drawn::*;
/// # use lenslet_core::calibration::{CalibrationOptions, Error, calibrate, check_compatible};
/// let mut capture = drawn_white();
/// capture.camera.model = Some("ILLUM".into());
/// let camera = calibrate(&[capture.clone()], &CalibrationOptions::default(), &lenslet_core::progress::Silent)?;
/// check_compatible(&camera, &capture)?;
///
/// capture.camera.model = Some("B01".into()); // what an Illum's white images are called
/// check_compatible(&camera, &capture)?;
///
/// capture.camera.model = Some("F01".into());
/// assert!(matches!(check_compatible(&camera, &capture), Err(Error::WrongCamera(_))));
/// # Ok::<(), Error>(())
/// ```
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
        && !same_model(ours, theirs)
    {
        return Err(Error::WrongCamera(format!("it is of a camera {ours}, the capture of a camera {theirs}")));
    }
    Ok(())
}

/// Zoom and focus steps that differ between calibration and capture, a line each. They move the micro-images a little
/// but do not forbid decoding.
///
/// ```
/// # mod drawn { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/common/drawn.rs")); }
/// # use drawn::*;
/// # use lenslet_core::calibration::{CalibrationOptions, calibrate, lens_setting_differences};
/// let mut capture = drawn_white();
/// capture.camera.zoom_step = Some(600);
/// let camera = calibrate(&[capture.clone()], &CalibrationOptions::default(), &lenslet_core::progress::Silent)?;
/// assert!(lens_setting_differences(&camera, &capture).is_empty());
///
/// capture.camera.zoom_step = Some(900);
/// assert!(lens_setting_differences(&camera, &capture)[0].contains("zoom step 600"));
/// # Ok::<(), lenslet_core::calibration::Error>(())
/// ```
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::model::Lattice;
    use crate::container::{Cfa, Levels, RawMosaic};
    use crate::geometry::Size;

    fn capture(width: usize, height: usize) -> Capture {
        let levels = Levels { black: [0.0; 4], white: [1023.0; 4] };
        Capture::bare(RawMosaic { width, height, data: vec![0; width * height] }, Cfa::Bggr, levels)
    }

    #[test]
    fn size_serial_number_and_model_must_agree_where_both_state_them() {
        let lattice = Lattice::hexagonal(10.0, 0.003, 1.0, [20.0, 15.0]);
        let mut calibration = Calibration::of_lattice(lattice, Size::new(40, 30));
        assert!(check_compatible(&calibration, &capture(40, 30)).is_ok());
        assert!(check_compatible(&calibration, &capture(30, 40)).is_err());
        calibration.origin.model = Some("ILLUM".into());
        calibration.origin.serial = Some("A1".into());
        let with = |model: &str, serial: &str| {
            let mut capture = capture(40, 30);
            capture.camera.model = Some(model.into());
            capture.camera.serial = Some(serial.into());
            check_compatible(&calibration, &capture)
        };
        assert!(with("ILLUM", "A1").is_ok() && with("B01", "A1").is_ok());
        assert!(with("ILLUM", "A2").unwrap_err().to_string().contains("A2"));
        assert!(with("F01", "A1").unwrap_err().to_string().contains("F01"));
        assert!(check_compatible(&calibration, &capture(40, 30)).is_ok());
    }

    #[test]
    fn steps_are_compared_where_both_state_them() {
        let lattice = Lattice::hexagonal(10.0, 0.003, 1.0, [20.0, 15.0]);
        let mut calibration = Calibration::of_lattice(lattice, Size::new(40, 30));
        let mut taken = capture(40, 30);
        (calibration.origin.zoom_step, calibration.origin.focus_step) = (Some(600), Some(40));
        assert!(lens_setting_differences(&calibration, &taken).is_empty());
        (taken.camera.zoom_step, taken.camera.focus_step) = (Some(600), Some(41));
        let lines = lens_setting_differences(&calibration, &taken);
        assert!(lines.len() == 1 && lines[0].contains("focus step 40") && lines[0].contains("41"), "{lines:?}");
    }
}
