//! Checks of the capture, the calibration and the options before decoding begins.

use super::error::Error;
use super::options::{Options, WhiteBalance};
use super::steps::{Demosaic, ViewStep};
use crate::calibration::{Calibration, Lenslet};
use crate::container::Capture;

/// Refuses inconsistent inputs and options out of range. The sensor sizes have been compared before.
pub(super) fn check_inputs(capture: &Capture, calibration: &Calibration, options: &Options) -> Result<(), Error> {
    check_capture(capture)?;
    check_calibration(calibration)?;
    check_options(options)
}

fn check_capture(capture: &Capture) -> Result<(), Error> {
    let (width, height) = (capture.mosaic.width, capture.mosaic.height);
    let pixels = width.checked_mul(height).filter(|&n| n > 0 && n <= 1 << 28);
    if pixels != Some(capture.mosaic.data.len()) || width < 8 || height < 8 {
        return Err(Error::Capture(format!("{} values for {width}x{height} pixels", capture.mosaic.data.len())));
    }
    for k in 0..4 {
        let (black, white) = (capture.levels.black[k], capture.levels.white[k]);
        if !(black.is_finite() && white.is_finite() && white > black) {
            return Err(Error::Capture(format!("black level {black} and white level {white} leave no range")));
        }
    }
    let finite = |v: &[f32]| v.iter().all(|v| v.abs() < 1e6);
    if !finite(&capture.colour.ccm) || !capture.colour.white_balance.iter().all(|&g| g > 0.0 && g < 1e3) {
        return Err(Error::Capture("its white balance or colour matrix is out of range".into()));
    }
    Ok(())
}

fn check_calibration(calibration: &Calibration) -> Result<(), Error> {
    let (width, height) = (calibration.width, calibration.height);
    let pixels = width.checked_mul(height);
    if let Some(v) = &calibration.vignetting
        && ((v.width, v.height) != (width, height) || Some(v.white.len()) != pixels)
    {
        return Err(Error::Calibration(format!(
            "its white image is {}x{}, its sensor {width}x{height}",
            v.width, v.height
        )));
    }
    let hot = &calibration.hot_pixels;
    if !hot.windows(2).all(|w| w[0] < w[1]) || hot.last().is_some_and(|&k| Some(k as usize) >= pixels) {
        return Err(Error::Calibration("its hot pixels are not on its sensor, or not in order".into()));
    }
    if calibration.lenslets.is_empty() || u32::try_from(calibration.lenslets.len()).is_err() {
        return Err(Error::Calibration(format!("it has {} lenslets", calibration.lenslets.len())));
    }
    let near =
        |l: &Lenslet| (-64.0..width as f64 + 64.0).contains(&l.x) && (-64.0..height as f64 + 64.0).contains(&l.y);
    if !calibration.lenslets.iter().all(near) {
        return Err(Error::Calibration("it has a lenslet far off the sensor".into()));
    }
    Ok(())
}

fn check_options(options: &Options) -> Result<(), Error> {
    if options.views.is_multiple_of(2) || options.views > 15 {
        return Err(Error::Parameter(format!("{0}x{0} views: the number must be odd, 1 to 15", options.views)));
    }
    if !(options.view_step > 0.0 && options.view_step <= 4.0) {
        return Err(Error::Parameter(format!(
            "a view step of {} pixels: it must be above 0, up to 4",
            options.view_step
        )));
    }
    if options.steps.view.iter().any(|s| matches!(s, ViewStep::Exposure(ev) if !(-32.0..=32.0).contains(ev))) {
        return Err(Error::Parameter("the exposure must be within 32 EV".into()));
    }
    if options.rotate_raw && options.steps.demosaic == Demosaic::CoKriging {
        return Err(Error::Parameter(
            "rotating the raw needs a demosaic of the whole raw: malvar or bilinear, not lenslet".into(),
        ));
    }
    if let WhiteBalance::Gains(gains) = options.white_balance
        && !gains.iter().all(|&g| g > 0.0 && g < 1e3)
    {
        return Err(Error::Parameter(format!("white balance {gains:?}: each gain must be above 0, below 1000")));
    }
    Ok(())
}
