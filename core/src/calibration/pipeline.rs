//! The whole way from captures to a calibration: from white images, or from ordinary captures.

use super::average;
use super::captures::{agreement, pattern};
use super::error::Error;
use super::locate::{self, LocatedLenslets};
use super::model::{Calibration, CalibrationOrigin, CalibrationQuality, Vignetting};
use super::options::CalibrationOptions;
use super::paper::variants;
use super::photometric::{equalise, hot_pixels, vignetting};
use super::screening;
use crate::container::Capture;
use crate::progress::Observer;

/// Calibrates a camera from one or several white images (captures of an evenly lit white surface). Where there are several,
/// those that are of no use (black, saturated, damaged, of another camera than most) are left out, with a note.
///
/// # Errors
/// No usable image, images of two cameras and none of them with most, no lenslet pattern; [`Error::Interrupted`].
pub fn calibrate(
    whites: &[Capture],
    options: &CalibrationOptions,
    observer: &dyn Observer,
) -> Result<Calibration, Error> {
    observer.begin("average", 0);
    let kept: Vec<&Capture> = screening::screen_captures(whites, options, observer)?.into_iter().map(|k| k.1).collect();
    let mut plane = average::average_captures(&kept, |v| v)?;
    hot_pixels::check_hot_pixels(&options.hot_pixels, plane.data.len())?;
    hot_pixels::fill_hot_pixels(&mut plane, &options.hot_pixels);
    equalise::equalise_channels(&mut plane);
    let hint = kept.iter().find_map(|c| c.mla.as_ref());
    let located = locate::locate_lenslets(&mut plane, hint, &options.hot_pixels, observer)?;
    observer.begin("vignetting", 0);
    hot_pixels::fill_hot_pixels(&mut plane, &options.hot_pixels);
    let pattern = (!options.without_vignetting).then(|| {
        vignetting::vignetting_from_white(&plane, located.illumination.full_light() * located.profile.at(0.0))
    });
    drop(plane);
    let mut found = assemble(located, pattern, &kept, "white", options);
    variants::apply_variant(&mut found, &kept, options.variant, observer)?;
    Ok(found)
}

/// Calibrates a camera from ordinary captures: the scenes average away, the lenslets stay. Five captures are typical, one gives
/// the lattice without any lenslet's own place. The vignetting pattern is the mean micro-image; the main lens' broad light
/// cannot be told from the scenes' and is left out. Captures of no use are left out as by [`calibrate`], and so are those whose
/// pattern is not where that of the others is.
///
/// # Errors
/// As [`calibrate`].
pub fn calibrate_from_captures(
    captures: &[Capture],
    options: &CalibrationOptions,
    observer: &dyn Observer,
) -> Result<Calibration, Error> {
    let mut kept = screening::screen_captures(captures, options, observer)?;
    let size = kept.first().map_or((0, 0), |(_, c)| (c.mosaic.width, c.mosaic.height));
    hot_pixels::check_hot_pixels(&options.hot_pixels, size.0 * size.1)?;
    let (plane, mut located) = pattern::locate_in_captures(&mut kept, options, observer)?;
    observer.begin("agreement", kept.len() as u64);
    agreement::weigh_by_agreement(&kept, &options.hot_pixels, size, &mut located, observer)?;
    observer.begin("vignetting", 0);
    let pattern = (!options.without_vignetting).then(|| vignetting::vignetting_from_captures(&plane, &located.lattice));
    drop(plane);
    let kept: Vec<&Capture> = kept.into_iter().map(|k| k.1).collect();
    let mut found = assemble(located, pattern, &kept, "captures", options);
    variants::apply_variant(&mut found, &kept, options.variant, observer)?;
    Ok(found)
}

fn assemble(
    located: LocatedLenslets,
    vignetting: Option<Vignetting>,
    from: &[&Capture],
    method: &str,
    options: &CalibrationOptions,
) -> Calibration {
    let first = from[0];
    let accepted = 1.0 - located.shrunk.rejected;
    Calibration {
        width: first.mosaic.width,
        height: first.mosaic.height,
        lattice: located.lattice,
        lenslets: located.lenslets,
        quality: CalibrationQuality {
            residual_rms: located.shrunk.residual_rms,
            scatter: located.shrunk.scatter,
            noise: located.shrunk.noise,
            rejected: located.shrunk.rejected,
            confidence: CalibrationQuality::confidence_of(located.coherence, located.prominence, accepted),
        },
        vignetting,
        hot_pixels: options.hot_pixels.clone(),
        origin: CalibrationOrigin {
            method: method.into(),
            model: first.camera.model.clone(),
            serial: first.camera.serial.clone(),
            zoom_step: first.camera.zoom_step,
            focus_step: first.camera.focus_step,
            sources: from.iter().map(|c| c.source_sha256.clone()).collect(),
        },
    }
}
