//! The default way from an equalised image to centres: spectrum → phases → profile → centres → lattice → shrinkage, all on the
//! unrotated mosaic. Coordinates are transformed, never pixels.

use super::field::Field;
use super::measure::{Measured, Site, measure};
use super::profile::{self, Profile};
use super::shrink::{self, Shrunk};
use super::{Error, Grid, Lattice, Lenslet, Plane, guess, hot, lattice, spectrum};
use crate::container::MlaHint;
use crate::progress::Observer;

/// Window radius in pitches: wide enough to use the light, clear of the neighbours' micro-images.
const REACH: f64 = 0.45;
/// Micro-images flatter than this from centre to rim are none.
const LEAST_CONTRAST: f64 = 0.03;
/// Pixels nearer the model than this share of the light are never left out.
const LEAST_CLIP: f64 = 0.1;
/// Share of lenslets that must be measurable.
const LEAST_USABLE: f64 = 0.3;

/// Everything learnt about a white image.
#[derive(Debug, Clone)]
pub struct Refined {
    /// The regular lattice.
    pub lattice: Lattice,
    /// Lenslets with their centre on the sensor, by (j, i).
    pub lenslets: Vec<Lenslet>,
    /// Common micro-image profile.
    pub profile: Profile,
    /// Broad light.
    pub field: Field,
    /// How the centres were weighed.
    pub shrunk: Shrunk,
    /// Agreement of the pattern's phases over the sensor, 0..1.
    pub coherence: f64,
    /// Prominence of the weakest spectral peak used.
    pub prominence: f64,
}

/// Finds the lattice and every lenslet of an equalised image. `hint` is a first guess of the lattice; the `hot_pixels` (ascending, on the
/// plane) are not measured, and marked as saturated afterwards.
///
/// # Errors
/// [`Error::NoPattern`], and [`Error::Interrupted`] when the observer asks to stop.
pub fn refine(
    plane: &mut Plane,
    hint: Option<&MlaHint>,
    hot_pixels: &[u32],
    observer: &dyn Observer,
) -> Result<Refined, Error> {
    let (width, height) = (plane.width, plane.height);
    let stage = |name: &str| {
        observer.begin(name, 0);
        if observer.cancelled() { Err(Error::Interrupted) } else { Ok(()) }
    };
    stage("spectrum")?;
    let spectrum = spectrum::spectrum(plane);
    stage("phases")?;
    let (start, locked) = guess::lock(plane, &spectrum, hint)?;
    hot::mask(plane, hot_pixels);
    stage("centres, first")?;
    let mut grid = locked.lattice;
    let radius = REACH * spacing(&grid);

    let first = measure(plane, &Profile::paraboloid(radius), &sites(&grid, plane, None), f64::INFINITY);
    grid = lattice::fit(&grid, &first);
    let mut field = Field::new(&first, width, height, grid.pitch());
    stage("centres, second")?;

    let places = sites(&grid, plane, Some(&field));
    let mut profile = pattern(plane, &places, radius)?;
    let second = measure(plane, &profile, &places, f64::INFINITY);
    grid = lattice::fit(&grid, &second);
    field = Field::new(&second, width, height, grid.pitch());
    stage("centres, third")?;

    // Now about the places found, each with its own brightness, and without pixels that do not fit.
    let typical = shrink::typical_misfit(&second);
    let clip = (6.0 * typical).max(LEAST_CLIP);
    let mut places = sites(&grid, plane, Some(&field));
    follow(&mut places, &second, 0.2 * radius, typical);
    profile = pattern(plane, &places, radius)?;
    let third = measure(plane, &profile, &places, clip);
    grid = lattice::centred(lattice::fit(&grid, &third), width, height);
    let usable = third.iter().filter(|m| m.usable).count() as f64 / third.len().max(1) as f64;
    if usable < LEAST_USABLE {
        return Err(Error::NoPattern {
            reason: format!("only {:.0} % of the lenslets could be measured", 100.0 * usable),
        });
    }
    stage("shrink")?;
    let third: Vec<Measured> = reindexed(&grid, third);
    let shrunk = shrink::shrink(&grid, &third, width, height);
    let lenslets = listed(&third, &shrunk, width, height);
    Ok(Refined {
        lattice: grid,
        lenslets,
        profile,
        field,
        shrunk,
        coherence: locked.coherence,
        prominence: start.prominence,
    })
}

/// Distance to the nearest neighbour.
fn spacing(lattice: &Lattice) -> f64 {
    let (a, b) = (lattice.a, lattice.b);
    let length = |v: [f64; 2]| v[0].hypot(v[1]);
    let c = match lattice.grid {
        Grid::Square => a,
        _ => [b[0] - a[0], b[1] - a[1]],
    };
    length(a).min(length(b)).min(length(c))
}

fn sites(lattice: &Lattice, plane: &Plane, field: Option<&Field>) -> Vec<Site> {
    lattice::indices(lattice, plane.width, plane.height, 1.0)
        .into_iter()
        .map(|[i, j]| {
            let [x, y] = lattice.centre(i, j);
            let (gain, slope) = field.map_or((1.0, [0.0; 2]), |f| (f.at(x, y), f.slope(x, y)));
            Site { i, j, x, y, gain, slope }
        })
        .collect()
}

/// Moves the sites to where their lenslets were seen, if that is near and nothing seems to lie on them. Both lists are in
/// (j, i) order and differ at the rim only.
fn follow(places: &mut [Site], seen: &[Measured], near: f64, typical: f64) {
    let mut seen = seen.iter().peekable();
    for site in places {
        let key = (site.j, site.i);
        while seen.next_if(|m| (m.j, m.i) < key).is_some() {}
        if let Some(m) = seen.next_if(|m| (m.j, m.i) == key)
            && m.usable
            && m.misfit < 4.0 * typical * typical
            && (m.x - site.x).hypot(m.y - site.y) < near
        {
            (site.x, site.y) = (m.x, m.y);
            // Its own brightness, unless something lies on it.
            if (0.2..5.0).contains(&(m.gain / site.gain)) {
                site.gain = m.gain;
            }
        }
    }
}

fn pattern(plane: &Plane, places: &[Site], radius: f64) -> Result<Profile, Error> {
    let profile = profile::fit(plane, places, radius)
        .ok_or_else(|| Error::NoPattern { reason: "the micro-images have no light in their middles".into() })?;
    if profile.contrast() < LEAST_CONTRAST {
        return Err(Error::NoPattern {
            reason: format!("the micro-images have only {:.1} % contrast", 100.0 * profile.contrast()),
        });
    }
    Ok(profile)
}

/// Measured lenslets with the indices they have in `lattice`, whose (0, 0) may have moved by a lenslet.
fn reindexed(lattice: &Lattice, mut measured: Vec<Measured>) -> Vec<Measured> {
    // All move together: the commonest shift is the shift.
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

/// Lenslets with their centre on the sensor, by (j, i).
pub fn listed(measured: &[Measured], shrunk: &Shrunk, width: usize, height: usize) -> Vec<Lenslet> {
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
