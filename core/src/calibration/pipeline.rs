//! The pipeline from captures to a calibration: white images (Algorithm 1 of the paper, section 3.2), or ordinary
//! captures.

use super::average;
use super::captures::{agreement, pattern};
use super::error::Error;
use super::locate::{self, LocatedLenslets};
use super::model::{Calibration, CalibrationOrigin, CalibrationQuality, Vignetting};
use super::options::CalibrationOptions;
use super::paper::variants;
use super::photometric::{equalise, hot_pixels, texture, vignetting};
use super::screening::{self, Screened};
use crate::container::Capture;
use crate::geometry::Size;
use crate::progress::Observer;

/// Relative difference of neighbouring lenslets above which a scene shows.
/// Source: chosen; three captures of an F01 have 0.19 to 0.31, a pattern composed of its captures 0.06, a true white image 0.
const SCENE: f64 = 0.11;
/// Relative difference of neighbouring lenslets above which a white image is not even: pictures are then divided by its mean
/// micro-image times the broad light of the main lens.
/// Source: chosen; simulated white images have less than 0.01, with 30 times the usual noise up to 0.07.
const UNEVEN: f64 = 0.04;

/// Calibrates a camera from one or several white images (captures of an evenly lit white surface). Of several, those
/// that cannot be used (black, saturated, damaged, of another camera than most) are left out with a note to the
/// observer.
///
/// ```
/// # mod drawn { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/common/drawn.rs")); }
/// # use drawn::*;
/// use lenslet_core::calibration::{CalibrationOptions, CalibrationVariant, calibrate};
/// use lenslet_core::progress::Silent;
///
/// let options = CalibrationOptions { variant: CalibrationVariant::None, ..CalibrationOptions::default() };
/// let camera = calibrate(&[drawn_white()], &options, &Silent)?;
/// assert_eq!(camera.origin.method, "white (none)");
/// assert_eq!((camera.lattice.pitch(), camera.lattice.rotation()), (10.0, 0.0));
/// # Ok::<(), lenslet_core::calibration::Error>(())
/// ```
///
/// # Errors
/// [`Error::NoImages`]; the error of the first image where none can be used; [`Error::SizesDiffer`] or
/// [`Error::CamerasDiffer`] where no camera has more than half of the images; [`Error::NoPattern`];
/// [`Error::NotWhite`]; [`Error::Parameter`] for hot pixels out of order or off the sensor; [`Error::Interrupted`].
pub fn calibrate(
    whites: &[Capture],
    options: &CalibrationOptions,
    observer: &dyn Observer,
) -> Result<Calibration, Error> {
    observer.begin("average", 0);
    let screened = screening::screen_captures(whites, options, observer)?;
    let kept: Vec<&Capture> = screened.iter().map(|k| k.1).collect();
    let mut image = average::average_captures(&kept, |v| v)?;
    hot_pixels::check_hot_pixels(&options.hot_pixels, image.data.len())?;
    hot_pixels::fill_hot_pixels(&mut image, &options.hot_pixels);
    equalise::equalise_channels(&mut image);
    let prior_lattice = kept.iter().find_map(|c| c.mla.as_ref());
    let located = locate::locate_lenslets(&mut image, prior_lattice, &options.hot_pixels, observer)?;
    let texture = refuse_scenes(&screened, &located, options, observer)?;
    observer.begin("vignetting", 0);
    hot_pixels::fill_hot_pixels(&mut image, &options.hot_pixels);
    let pattern = (!options.without_vignetting).then(|| {
        let light = &located.illumination;
        let full = light.full_light();
        if texture > UNEVEN {
            vignetting::vignetting_from_pattern(&image, &located.lattice, |x, y| light.broad_at(x, y) / full)
        } else {
            vignetting::vignetting_from_white(&image, full * located.profile.at(0.0))
        }
    });
    drop(image);
    let mut found = assemble(located, pattern, &kept, "white", options);
    variants::apply_variant(&mut found, &kept, options.variant, observer)?;
    Ok(found)
}

/// Refuses images given as white in which a scene shows: their centres would be good, and every picture divided by them
/// ruined. One in which a weak scene shows is noted: its mean micro-image is used. Returns the strongest texture.
fn refuse_scenes(
    screened: &[Screened],
    located: &LocatedLenslets,
    options: &CalibrationOptions,
    observer: &dyn Observer,
) -> Result<f64, Error> {
    let mut strongest = 0f64;
    observer.begin("evenness", screened.len() as u64);
    for &(n, capture) in screened {
        let mut image = average::average_captures(std::slice::from_ref(capture), |v| v)?;
        hot_pixels::fill_hot_pixels(&mut image, &options.hot_pixels);
        equalise::equalise_channels(&mut image);
        let texture = texture::scene_texture(&image, &located.lattice, &located.lenslets);
        if texture > SCENE {
            return Err(Error::NotWhite { index: n + 1, percent: 100.0 * texture });
        }
        if texture > UNEVEN {
            let name = screening::name_of(n, options);
            let percent = 100.0 * texture;
            observer.note(&format!(
                "{name}: no clean white image: neighbouring lenslets differ by {percent:.0} %; pictures are divided by its mean \
                 micro-image, not by the image itself; ordinary captures go with --from-captures"
            ));
        }
        strongest = strongest.max(texture);
        observer.advance(1);
        observer.check()?;
    }
    Ok(strongest)
}

/// Calibrates a camera from ordinary captures: the scenes average out, the lenslets stay. Five captures are typical;
/// one gives the lattice only, all lenslets with trust 0. The vignetting pattern is the mean micro-image; the
/// illumination by the main lens cannot be separated from the scenes' and is left out. Captures that cannot be used are
/// left out as by [`calibrate`], and so are those whose pattern disagrees with that of the others.
///
/// ```
/// # mod drawn { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/common/drawn.rs")); }
/// # use drawn::*;
/// use lenslet_core::calibration::{CalibrationOptions, calibrate_from_captures};
/// use lenslet_core::progress::Silent;
///
/// let scene = |n: f64| drawn_capture(move |x, y| 0.6 + 0.3 * (x / 40.0 + n).sin() * (y / 30.0 - n).cos());
/// let captures = [scene(0.0), scene(1.0), scene(2.0)];
/// let camera = calibrate_from_captures(&captures, &CalibrationOptions::default(), &Silent)?;
/// assert_eq!(camera.origin.method, "captures");
/// assert!((camera.lattice.pitch() - 10.0).abs() < 0.05);
/// # Ok::<(), lenslet_core::calibration::Error>(())
/// ```
///
/// # Errors
/// As [`calibrate`].
pub fn calibrate_from_captures(
    captures: &[Capture],
    options: &CalibrationOptions,
    observer: &dyn Observer,
) -> Result<Calibration, Error> {
    let mut kept = screening::screen_captures(captures, options, observer)?;
    let size = kept.first().map_or(Size::new(0, 0), |(_, c)| Size::new(c.mosaic.width, c.mosaic.height));
    hot_pixels::check_hot_pixels(&options.hot_pixels, size.width * size.height)?;
    let (image, mut located) = pattern::locate_in_captures(&mut kept, options, observer)?;
    observer.begin("agreement", kept.len() as u64);
    agreement::weigh_by_agreement(&kept, &options.hot_pixels, size, &mut located, observer)?;
    observer.begin("vignetting", 0);
    let pattern = (!options.without_vignetting).then(|| vignetting::vignetting_from_captures(&image, &located.lattice));
    drop(image);
    let kept: Vec<&Capture> = kept.into_iter().map(|k| k.1).collect();
    let mut found = assemble(located, pattern, &kept, "captures", options);
    variants::apply_variant(&mut found, &kept, options.variant, observer)?;
    Ok(found)
}

/// The calibration of the lenslets located in the captures `from`, which are of one camera.
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
