//! Algorithm 1 as the paper has it, step by step, for comparison with the default way: gamma, average, demosaic by equal
//! channels, contrast stretch; rotation from the spectral peak nearest zero, the image rotated; erosion, local maxima,
//! paraboloids; Delaunay triangulation and a regular triangle grid. Vignetting, noise and the second resampling pull its centres.

use std::borrow::Borrow;

use super::lattice as grid;
use super::measure::Measured;
use super::{
    Error, Lattice, Lenslet, Plane, average, equalise, erosion, gamma, maxima, paraboloid, phase, rotation, spectrum,
    stretch, triangulation, turn,
};
use crate::container::Capture;
use crate::progress::Observer;

/// Radius of the eroding disc, in pitches.
const DISC: f64 = 0.2;
/// Distance between two maxima, in pitches.
const APART: f64 = 0.45;
/// Light under which a maximum is no lenslet (of the stretched range).
const FLOOR: f32 = 0.05;

/// Every image on the way (the paper's figures 4 to 6) and what came out.
#[derive(Debug, Clone)]
pub struct Stages {
    /// Encoded average of the captures (4a).
    pub average: Plane,
    /// Equal channels: the grey image (4b, 4c).
    pub equalised: Plane,
    /// Contrast stretched (4d).
    pub stretched: Plane,
    /// Power spectrum (5a).
    pub spectrum: spectrum::Spectrum,
    /// Angle the image was rotated by, radians.
    pub angle: f64,
    /// Rotated image (5c).
    pub turned: Plane,
    /// Eroded image (6a).
    pub eroded: Plane,
    /// Centres in the *unrotated* image (6c), all that were found.
    pub centres: Vec<[f64; 2]>,
    /// Delaunay edges between them (6d).
    pub edges: Vec<[usize; 2]>,
    /// The lattice fitted.
    pub lattice: Lattice,
    /// Lenslets: found ones where they were found (trust 1), the others on the lattice (trust 0).
    pub lenslets: Vec<Lenslet>,
    /// RMS distance of found centres from the lattice, pixels.
    pub residual_rms: f64,
    /// Agreement of the pattern's phases.
    pub coherence: f64,
    /// Prominence of the spectral peaks.
    pub prominence: f64,
}

/// Runs the paper's steps.
///
/// # Errors
/// As [`super::calibrate`].
pub fn stages<C: Borrow<Capture>>(captures: &[C], observer: &dyn Observer) -> Result<Stages, Error> {
    let step = |name: &str| {
        observer.begin(name, 0);
        if observer.cancelled() { Err(Error::Interrupted) } else { Ok(()) }
    };
    step("average")?;
    let exponent = captures.first().map_or(gamma::USUAL, |c| gamma::exponent(c.borrow()));
    let average = average::average(captures, |v| gamma::encode(v, exponent))?;
    let mut plane = average.clone();
    equalise::equalise(&mut plane);
    let spectrum = spectrum::spectrum(&plane);
    let equalised = plane.clone();
    stretch::stretch(&mut plane);
    step("rotate")?;

    let start = rotation::fundamentals(&spectrum)?;
    let locked = phase::lock(&plane, &start)?;
    let (packing, a, b) = rotation::lattice_vectors(start.square, start.f1, start.f2);
    let guess = Lattice { grid: packing, origin: locked.lattice.origin, a, b };
    let angle = guess.rotation();
    let (width, height) = (plane.width, plane.height);
    let turned = turn::turn(&plane, angle);
    step("erode")?;

    let pitch = guess.pitch();
    let eroded = erosion::erode(&turned, DISC * pitch);
    let reach = ((0.15 * pitch) as usize).max(1);
    let centres: Vec<[f64; 2]> = maxima::maxima(&eroded, APART * pitch, FLOOR)
        .into_iter()
        .filter_map(|[x, y]| paraboloid::top(&eroded, x, y, reach))
        .map(|c| turn::unturned(c, angle, width, height))
        .filter(|c| c[0] >= 0.0 && c[1] >= 0.0 && c[0] <= (width - 1) as f64 && c[1] <= (height - 1) as f64)
        .collect();
    step("triangulate")?;

    let edges = triangulation::edges(&centres);
    let index = triangulation::walk(&centres, &edges, &guess);
    let measured: Vec<Measured> =
        centres.iter().zip(&index).filter_map(|(c, at)| at.map(|[i, j]| Measured::found(i, j, c[0], c[1]))).collect();
    if measured.len() < 10 {
        return Err(Error::NoPattern { reason: format!("only {} lenslets were found", measured.len()) });
    }
    let fitted = grid::fit(&guess, &measured);
    let lattice = grid::centred(fitted, width, height);
    let moved = fitted.coordinates(lattice.origin[0], lattice.origin[1]).map(|v| v.round() as i32);
    let mut found = std::collections::BTreeMap::new();
    let mut sum = 0.0;
    for m in &measured {
        let at = fitted.centre(m.i, m.j);
        sum += (m.x - at[0]).powi(2) + (m.y - at[1]).powi(2);
        found.insert((m.j - moved[1], m.i - moved[0]), [m.x, m.y]);
    }
    let lenslets = grid::indices(&lattice, width, height, 0.0)
        .into_iter()
        .map(|[i, j]| {
            let at = lattice.centre(i, j);
            // A maximum half a pitch away is another thing.
            let own = found.get(&(j, i)).filter(|c| (c[0] - at[0]).hypot(c[1] - at[1]) < 0.5 * pitch);
            let [x, y] = own.copied().unwrap_or(at);
            Lenslet { i, j, x, y, trust: if own.is_some() { 1.0 } else { 0.0 } }
        })
        .collect();
    Ok(Stages {
        average,
        equalised,
        stretched: plane,
        spectrum,
        angle,
        turned,
        eroded,
        centres,
        edges,
        lattice,
        lenslets,
        residual_rms: (sum / measured.len() as f64).sqrt(),
        coherence: locked.coherence,
        prominence: start.prominence,
    })
}
