//! Algorithm 1 of the paper (section 3.2): from white images to the centre of every lenslet.
//!
//! Steps, a file each: `gamma`, `average` (several whites), `equalise` (demosaic by equal channels, grey), `stretch`; `spectrum` and
//! `rotation` (the lattice in the frequency domain), `turn`; `erosion`, `maxima`, `paraboloid`, `triangulation`; `lattice` (the
//! regular grid). `paper` runs them as the paper does. `refine`, the default, keeps the image as it is and goes from the
//! spectrum to `phase` (the lattice over the whole sensor), `profile` and `measure` (sub-pixel centres with their variance),
//! `field` (broad light) and `shrink` (each centre as far as the image is sure of it). `captures` does without white images,
//! `vignetting` keeps the pattern, `file` the model on disk, `fits` tells whether a capture is this camera's. `usable` passes over bad
//! images, `hot` finds hot pixels in black ones, `guess` begins from what metadata say of the lattice.

mod average;
mod captures;
mod equalise;
mod erosion;
mod error;
mod field;
pub mod figures;
mod file;
mod fits;
mod gamma;
mod guess;
mod hot;
mod lattice;
mod linear;
mod maxima;
mod measure;
mod model;
pub mod paper;
mod paraboloid;
mod phase;
mod plane;
#[cfg(test)]
mod planted;
mod profile;
mod refine;
#[cfg(test)]
mod robust;
mod rotation;
mod shrink;
pub mod spectrum;
mod stretch;
#[cfg(test)]
mod tests;
pub mod triangulation;
mod turn;
mod usable;
mod variant;
mod vignetting;

pub use error::Error;
pub use file::{load, save};
pub use fits::{differences, fits};
pub use hot::hot_pixels;
pub use model::*;
pub use plane::Plane;
pub use usable::usable;
pub use variant::Variant;

use crate::container::Capture;
use crate::progress::Observer;

/// How a camera is calibrated.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Options {
    /// Which centres to give.
    pub variant: Variant,
    /// Leave out the vignetting pattern (centres only; quicker).
    pub without_vignetting: bool,
    /// Pixels to leave out, as [`hot_pixels`] finds them in black images: `y·width + x`, ascending, at most one in a hundred.
    pub hot_pixels: Vec<u32>,
    /// What notes call the images, in their order; those without a name are called by their number.
    pub names: Vec<String>,
}

/// Calibrates a camera from one or several white images (captures of an evenly lit white surface). Where there are several,
/// those that are of no use (black, saturated, damaged, of another camera than most) are left out, with a note.
///
/// # Errors
/// No usable image, images of two cameras and none of them with most, no lenslet pattern; [`Error::Interrupted`].
pub fn calibrate(whites: &[Capture], options: &Options, observer: &dyn Observer) -> Result<Calibration, Error> {
    observer.begin("average", 0);
    let kept: Vec<&Capture> = usable::usable(whites, options, observer)?.into_iter().map(|k| k.1).collect();
    let mut plane = average::average(&kept, |v| v)?;
    hot::check(&options.hot_pixels, plane.data.len())?;
    hot::fill(&mut plane, &options.hot_pixels);
    equalise::equalise(&mut plane);
    let hint = kept.iter().find_map(|c| c.mla.as_ref());
    let refined = refine::refine(&mut plane, hint, &options.hot_pixels, observer)?;
    observer.begin("vignetting", 0);
    hot::fill(&mut plane, &options.hot_pixels);
    let pattern = (!options.without_vignetting)
        .then(|| vignetting::from_white(&plane, refined.field.full() * refined.profile.at(0.0)));
    drop(plane);
    let mut found = assemble(refined, pattern, &kept, "white", options);
    vary(&mut found, &kept, options.variant, observer)?;
    Ok(found)
}

/// Calibrates a camera from ordinary captures: the scenes average away, the lenslets stay. Five captures are typical, one gives
/// the lattice without any lenslet's own place. The vignetting pattern is the mean micro-image; the main lens' broad light
/// cannot be told from the scenes' and is left out. Captures of no use are left out as by [`calibrate`], and so are those whose
/// pattern is not where that of the others is.
///
/// # Errors
/// As [`calibrate`].
pub fn from_captures(captures: &[Capture], options: &Options, observer: &dyn Observer) -> Result<Calibration, Error> {
    let mut kept = usable::usable(captures, options, observer)?;
    let size = kept.first().map_or((0, 0), |(_, c)| (c.mosaic.width, c.mosaic.height));
    hot::check(&options.hot_pixels, size.0 * size.1)?;
    let (plane, mut refined) = captures::found(&mut kept, options, observer)?;
    observer.begin("agreement", kept.len() as u64);
    captures::agree(&kept, &options.hot_pixels, size, &mut refined, observer)?;
    observer.begin("vignetting", 0);
    let pattern = (!options.without_vignetting).then(|| vignetting::from_pattern(&plane, &refined.lattice));
    drop(plane);
    let kept: Vec<&Capture> = kept.into_iter().map(|k| k.1).collect();
    let mut found = assemble(refined, pattern, &kept, "captures", options);
    vary(&mut found, &kept, options.variant, observer)?;
    Ok(found)
}

fn assemble(
    refined: refine::Refined,
    vignetting: Option<Vignetting>,
    from: &[&Capture],
    method: &str,
    options: &Options,
) -> Calibration {
    let first = from[0];
    let accepted = 1.0 - refined.shrunk.rejected;
    Calibration {
        width: first.mosaic.width,
        height: first.mosaic.height,
        lattice: refined.lattice,
        lenslets: refined.lenslets,
        quality: Quality {
            residual_rms: refined.shrunk.residual_rms,
            scatter: refined.shrunk.scatter,
            noise: refined.shrunk.noise,
            rejected: refined.shrunk.rejected,
            confidence: confidence(refined.coherence, refined.prominence, accepted),
        },
        vignetting,
        hot_pixels: options.hot_pixels.clone(),
        origin: Origin {
            method: method.into(),
            model: first.camera.model.clone(),
            serial: first.camera.serial.clone(),
            zoom_step: first.camera.zoom_step,
            focus_step: first.camera.focus_step,
            sources: from.iter().map(|c| c.source_sha256.clone()).collect(),
        },
    }
}

/// 0 to 1: a pattern that agrees with itself over the sensor, stands out of the spectrum, and whose lenslets could be measured.
fn confidence(coherence: f64, prominence: f64, accepted: f64) -> f64 {
    let peak = 1.0 - 1.0 / prominence.max(1.0).sqrt();
    (coherence * peak * accepted).clamp(0.0, 1.0)
}

/// Replaces the centres by those of a lesser variant.
fn vary(
    found: &mut Calibration,
    captures: &[&Capture],
    variant: Variant,
    observer: &dyn Observer,
) -> Result<(), Error> {
    let (width, height) = (found.width, found.height);
    let on_grid = |grid: Lattice| -> Vec<Lenslet> {
        let place = |[i, j]: [i32; 2]| {
            let [x, y] = grid.centre(i, j);
            Lenslet { i, j, x, y, trust: 0.0 }
        };
        lattice::indices(&grid, width, height, 0.0).into_iter().map(place).collect()
    };
    match variant {
        Variant::Full => return Ok(()),
        Variant::Paper => {
            let stages = paper::stages(captures, observer)?;
            found.lattice = stages.lattice;
            found.lenslets = stages.lenslets;
            found.quality.residual_rms = stages.residual_rms;
            found.quality.scatter = stages.residual_rms / std::f64::consts::SQRT_2;
            found.quality.noise = 0.0;
            let measured = found.lenslets.iter().filter(|l| l.trust > 0.0).count();
            found.quality.rejected = 1.0 - measured as f64 / found.lenslets.len().max(1) as f64;
            found.quality.confidence = confidence(stages.coherence, stages.prominence, 1.0 - found.quality.rejected);
        }
        Variant::Integer => {
            let (right, bottom) = ((width - 1) as f64, (height - 1) as f64);
            for l in &mut found.lenslets {
                (l.x, l.y) = (l.x.round().clamp(0.0, right), l.y.round().clamp(0.0, bottom));
            }
        }
        Variant::RotationOnly => {
            let l = found.lattice;
            found.lattice = variant::ideal(&l, l.pitch(), l.rotation(), width, height);
            found.lenslets = on_grid(found.lattice);
        }
        Variant::None => {
            let l = found.lattice;
            found.lattice = variant::ideal(&l, l.pitch().round(), 0.0, width, height);
            found.lenslets = on_grid(found.lattice);
        }
    }
    found.origin.method = format!("{} ({variant})", found.origin.method);
    Ok(())
}
