//! The default method, from an equalised image to centres: spectrum → phases → three rounds of (profile → centres →
//! lattice → illumination) → shrinkage, all on the unrotated mosaic. Coordinates are transformed, never pixels.

use super::centres::lattice_fit;
use super::centres::measure::measure_lenslets;
use super::centres::measured::{self, MeasuredLenslet};
use super::centres::predicted::PredictedLenslet;
use super::centres::profile::{self, MicroImageProfile};
use super::error::Error;
use super::fundamentals::{prior, spectrum};
use super::model::{Grid, Lattice, Lenslet};
use super::photometric::hot_pixels;
use super::sensor_image::SensorImage;
use super::smoothing::illumination::Illumination;
use super::smoothing::shrink::{self, ShrunkCentres};
use crate::container::MlaHint;
use crate::geometry::Size;
use crate::progress::Observer;

/// Radius of the measuring window in distances of neighbours; below 0.5, so that it stays clear of their micro-images.
/// Source: chosen
const REACH: f64 = 0.45;
/// Least contrast of micro-images from centre to rim (0 to 1); flatter ones are rejected.
/// Source: chosen
const LEAST_CONTRAST: f64 = 0.03;
/// Clipping threshold for pixels, in typical misfits of the round before.
/// Source: chosen
const CLIP: f64 = 6.0;
/// Lower bound of the clipping threshold for pixels, as a share of the lenslet's light.
/// Source: chosen
const LEAST_CLIP: f64 = 0.1;
/// Largest distance from prediction to measurement at which the next round starts from the measurement, in window
/// radii.
/// Source: chosen
const NEAR: f64 = 0.2;
/// Largest misfit at which the next round starts from the measurement, relative to the typical one.
/// Source: chosen
const FITS: f64 = 4.0;
/// Largest factor by which a lenslet's own light may differ from the illumination (dust, reflections).
/// Source: chosen
const OWN_LIGHT: f64 = 5.0;
/// Least share of lenslets that must be measurable.
/// Source: chosen
const LEAST_USABLE: f64 = 0.3;

/// The lenslets of an image, and the estimates they came from.
#[derive(Debug, Clone)]
pub struct LocatedLenslets {
    /// The regular lattice.
    pub lattice: Lattice,
    /// Lenslets with their centre on the sensor, by (j, i).
    pub lenslets: Vec<Lenslet>,
    /// Common micro-image profile.
    pub profile: MicroImageProfile,
    /// Illumination by the main lens.
    pub illumination: Illumination,
    /// The shrunk centres and their variances.
    pub shrunk: ShrunkCentres,
    /// Coherence of the pattern's phases over the sensor, 0 to 1.
    pub coherence: f64,
    /// Prominence of the weakest spectral peak used.
    pub prominence: f64,
}

/// Finds the lattice and every lenslet of an equalised image. `prior_lattice` is the lattice in the metadata. The
/// `hot` pixels (`y·width + x`, ascending) are not measured; they are marked as saturated in `image`.
///
/// # Errors
/// [`Error::NoPattern`], and [`Error::Interrupted`] when the observer cancels the work.
pub fn locate_lenslets(
    image: &mut SensorImage,
    prior_lattice: Option<&MlaHint>,
    hot: &[u32],
    observer: &dyn Observer,
) -> Result<LocatedLenslets, Error> {
    let (width, height) = (image.width, image.height);
    let stage = |name: &str| {
        observer.begin(name, 0);
        observer.check()
    };
    stage("spectrum")?;
    let spectrum = spectrum::power_spectrum(image);
    stage("phases")?;
    let (start, phases) = prior::fit_with_prior(image, &spectrum, prior_lattice)?;
    hot_pixels::mask_hot_pixels(image, hot);
    stage("centres, first")?;
    let mut grid = phases.lattice;
    let radius = REACH * neighbour_distance(&grid);

    let first = measure_lenslets(
        image,
        &MicroImageProfile::paraboloid(radius),
        &predict_lenslets(&grid, image, None),
        f64::INFINITY,
    );
    grid = lattice_fit::fit_lattice(&grid, &first);
    let mut illumination = Illumination::new(&first, Size::new(width, height), grid.pitch());
    stage("centres, second")?;

    let sites = predict_lenslets(&grid, image, Some(&illumination));
    let mut profile = fit_micro_image(image, &sites, radius)?;
    let second = measure_lenslets(image, &profile, &sites, f64::INFINITY);
    grid = lattice_fit::fit_lattice(&grid, &second);
    illumination = Illumination::new(&second, Size::new(width, height), grid.pitch());
    stage("centres, third")?;

    // The third round starts at the measured centres, each with its own brightness, and leaves out pixels that do not
    // fit.
    let typical = measured::typical_misfit(&second);
    let clip = (CLIP * typical).max(LEAST_CLIP);
    let mut sites = predict_lenslets(&grid, image, Some(&illumination));
    move_to_measured(&mut sites, &second, NEAR * radius, typical);
    profile = fit_micro_image(image, &sites, radius)?;
    let third = measure_lenslets(image, &profile, &sites, clip);
    grid = lattice_fit::fit_lattice(&grid, &third).centred_on(Size::new(width, height));
    let usable = third.iter().filter(|m| m.usable).count() as f64 / third.len().max(1) as f64;
    if usable < LEAST_USABLE {
        return Err(Error::NoPattern {
            reason: format!("only {:.0} % of the lenslets could be measured", 100.0 * usable),
        });
    }
    stage("shrink")?;
    let third: Vec<MeasuredLenslet> = reindex_lenslets(&grid, third);
    let shrunk = shrink::shrink_centres(&grid, &third, Size::new(width, height));
    let lenslets = lenslets_on_sensor(&third, &shrunk, width, height);
    Ok(LocatedLenslets {
        lattice: grid,
        lenslets,
        profile,
        illumination,
        shrunk,
        coherence: phases.coherence,
        prominence: start.prominence,
    })
}

/// Distance to the nearest neighbour, pixels.
fn neighbour_distance(lattice: &Lattice) -> f64 {
    let (a, b) = (lattice.a, lattice.b);
    let length = |v: [f64; 2]| v[0].hypot(v[1]);
    let c = match lattice.grid {
        Grid::Square => a,
        _ => [b[0] - a[0], b[1] - a[1]],
    };
    length(a).min(length(b)).min(length(c))
}

/// The lenslets of the lattice whose centre lies on the sensor or at most a pixel outside, by (j, i), in the light of
/// `illumination` (1 without it).
fn predict_lenslets(
    lattice: &Lattice,
    image: &SensorImage,
    illumination: Option<&Illumination>,
) -> Vec<PredictedLenslet> {
    lattice
        .points_within(Size::new(image.width, image.height), 1.0)
        .index
        .into_iter()
        .map(|[i, j]| {
            let [x, y] = lattice.centre(i, j);
            let (gain, slope) =
                illumination.map_or((1.0, [0.0; 2]), |f| (f.brightness_at(x, y), f.relative_slope(x, y)));
            PredictedLenslet { i, j, x, y, gain, slope }
        })
        .collect()
}

/// Moves predictions to the measured centres that are within `near` pixels and fit as well as is typical. Both lists
/// are in (j, i) order and differ at the border only.
fn move_to_measured(sites: &mut [PredictedLenslet], seen: &[MeasuredLenslet], near: f64, typical: f64) {
    let mut seen = seen.iter().peekable();
    for site in sites {
        let key = (site.j, site.i);
        while seen.next_if(|m| (m.j, m.i) < key).is_some() {}
        if let Some(m) = seen.next_if(|m| (m.j, m.i) == key)
            && m.usable
            && m.misfit < FITS * typical * typical
            && (m.x - site.x).hypot(m.y - site.y) < near
        {
            (site.x, site.y) = (m.x, m.y);
            if (1.0 / OWN_LIGHT..OWN_LIGHT).contains(&(m.gain / site.gain)) {
                site.gain = m.gain;
            }
        }
    }
}

/// The micro-image profile over a window of `radius` pixels; [`Error::NoPattern`] where it has too little contrast.
fn fit_micro_image(image: &SensorImage, sites: &[PredictedLenslet], radius: f64) -> Result<MicroImageProfile, Error> {
    let profile = profile::fit_profile(image, sites, radius)
        .ok_or_else(|| Error::NoPattern { reason: "the micro-images have no light at their centres".into() })?;
    if profile.contrast() < LEAST_CONTRAST {
        return Err(Error::NoPattern {
            reason: format!("the micro-images have only {:.1} % contrast", 100.0 * profile.contrast()),
        });
    }
    Ok(profile)
}

/// Measured lenslets with the indices they have in `lattice`, whose (0, 0) may have moved by a lenslet.
fn reindex_lenslets(lattice: &Lattice, mut measured: Vec<MeasuredLenslet>) -> Vec<MeasuredLenslet> {
    // All indices shift alike, so the first usable lenslet gives the shift.
    let shift = measured.iter().find(|m| m.usable).map_or([0, 0], |m| {
        let c = lattice.coordinates(m.x, m.y);
        [c[0].round() as i32 - m.i, c[1].round() as i32 - m.j]
    });
    for m in &mut measured {
        m.i += shift[0];
        m.j += shift[1];
    }
    measured
}

/// The shrunk lenslets whose centre lies on the sensor of `width`×`height` pixels, by (j, i).
pub fn lenslets_on_sensor(
    measured: &[MeasuredLenslet],
    shrunk: &ShrunkCentres,
    width: usize,
    height: usize,
) -> Vec<Lenslet> {
    let (right, bottom) = (width as f64 - 1.0, height as f64 - 1.0);
    let mut all: Vec<Lenslet> = measured
        .iter()
        .zip(&shrunk.centres)
        .map(|(m, &([x, y], trust))| Lenslet { i: m.i, j: m.j, x, y, trust })
        .filter(|l| l.x >= 0.0 && l.x <= right && l.y >= 0.0 && l.y <= bottom)
        .collect();
    all.sort_by_key(|l| (l.j, l.i));
    all
}
