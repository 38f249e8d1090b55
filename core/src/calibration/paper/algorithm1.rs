//! Algorithm 1 as printed in the paper, for comparison with the default method: gamma, average, demosaic by equal
//! channels, contrast stretch; rotation from the spectral peak nearest zero, the image rotated; erosion, local maxima,
//! paraboloids; Delaunay triangulation and a regular triangle grid. Vignetting, noise and the second resampling bias
//! its centres.

use std::borrow::Borrow;

use super::{erosion, gamma, maxima, paraboloid, rotate, stretch, triangulation};
use crate::calibration::average;
use crate::calibration::centres::lattice_fit;
use crate::calibration::centres::measured::MeasuredLenslet;
use crate::calibration::error::Error;
use crate::calibration::fundamentals::{phase, rotation, spectrum};
use crate::calibration::model::{Lattice, Lenslet};
use crate::calibration::photometric::equalise;
use crate::calibration::sensor_image::SensorImage;
use crate::container::Capture;
use crate::geometry::Size;
use crate::progress::Observer;

/// Radius of the eroding disc, in pitches.
/// Source: chosen; the paper gives none
const DISC: f64 = 0.2;
/// Least distance between two maxima, in pitches.
/// Source: chosen; the paper gives none
const APART: f64 = 0.45;
/// Least value of a maximum, as a share of the stretched range.
/// Source: chosen
const FLOOR: f32 = 0.05;

/// The image after each step (the paper's figures 4 to 6), and the results.
#[derive(Debug, Clone)]
pub struct Algorithm1Stages {
    /// Encoded average of the captures (4a).
    pub average: SensorImage,
    /// Equal channels: the grey image (4b, 4c).
    pub equalised: SensorImage,
    /// Contrast stretched (4d).
    pub stretched: SensorImage,
    /// Power spectrum (5a).
    pub spectrum: spectrum::Spectrum,
    /// Angle the image was rotated by, radians.
    pub angle: f64,
    /// Rotated image (5c).
    pub turned: SensorImage,
    /// Eroded image (6a).
    pub eroded: SensorImage,
    /// Centres in the *unrotated* image (6c), (x, y) in pixels.
    pub centres: Vec<[f64; 2]>,
    /// Delaunay edges (6d), as pairs of indices into `centres`.
    pub edges: Vec<[usize; 2]>,
    /// The fitted lattice.
    pub lattice: Lattice,
    /// Lenslets by (j, i): at a centre found (trust 1), else on the lattice (trust 0).
    pub lenslets: Vec<Lenslet>,
    /// RMS distance of the centres found from the lattice, pixels.
    pub residual_rms: f64,
    /// Coherence of the pattern's phases, 0 to 1.
    pub coherence: f64,
    /// Prominence of the weaker fundamental.
    pub prominence: f64,
}

/// Runs the paper's steps on captures of one camera and size.
///
/// ```
/// # mod drawn { include!(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/common/drawn.rs")); }
/// # use drawn::*;
/// use lenslet_core::calibration::paper::run_algorithm1;
///
/// let stages = run_algorithm1(&[drawn_white()], &lenslet_core::progress::Silent)?;
/// assert!((stages.lattice.pitch() - 10.0).abs() < 0.05 && stages.angle.abs() < 0.01);
/// assert!(stages.centres.len() > 100 && stages.edges.len() > stages.centres.len());
/// # Ok::<(), lenslet_core::calibration::Error>(())
/// ```
///
/// # Errors
/// As [`crate::calibration::calibrate`].
pub fn run_algorithm1<C: Borrow<Capture>>(captures: &[C], observer: &dyn Observer) -> Result<Algorithm1Stages, Error> {
    let step = |name: &str| {
        observer.begin(name, 0);
        observer.check()
    };
    step("average")?;
    let exponent = captures.first().map_or(gamma::DEFAULT_EXPONENT, |c| gamma::gamma_exponent(c.borrow()));
    let average = average::average_captures(captures, |v| gamma::encode_gamma(v, exponent))?;
    let mut image = average.clone();
    equalise::equalise_channels(&mut image);
    let spectrum = spectrum::power_spectrum(&image);
    let equalised = image.clone();
    stretch::stretch_contrast(&mut image);
    step("rotate")?;

    let start = rotation::find_fundamentals(&spectrum)?;
    let locked = phase::fit_phases(&image, &start)?;
    let (packing, a, b) = rotation::lattice_vectors(start.square, start.f1, start.f2);
    let guess = Lattice { grid: packing, origin: locked.lattice.origin, a, b };
    let angle = guess.rotation();
    let (width, height) = (image.width, image.height);
    let turned = rotate::rotate_image(&image, angle);
    step("erode")?;

    let pitch = guess.pitch();
    let eroded = erosion::erode_by_disc(&turned, DISC * pitch);
    let reach = ((0.15 * pitch) as usize).max(1);
    let centres: Vec<[f64; 2]> = maxima::local_maxima(&eroded, APART * pitch, FLOOR)
        .into_iter()
        .filter_map(|[x, y]| paraboloid::paraboloid_top(&eroded, x, y, reach))
        .map(|c| rotate::to_unrotated(c, angle, Size::new(width, height)))
        .filter(|c| c[0] >= 0.0 && c[1] >= 0.0 && c[0] <= (width - 1) as f64 && c[1] <= (height - 1) as f64)
        .collect();
    step("triangulate")?;

    let edges = triangulation::delaunay_edges(&centres);
    let index = triangulation::index_centres(&centres, &edges, &guess);
    let measured: Vec<MeasuredLenslet> = centres
        .iter()
        .zip(&index)
        .filter_map(|(c, at)| at.map(|[i, j]| MeasuredLenslet::from_position(i, j, c[0], c[1])))
        .collect();
    if measured.len() < 10 {
        return Err(Error::NoPattern { reason: format!("only {} lenslets were found", measured.len()) });
    }
    let fitted = lattice_fit::fit_lattice(&guess, &measured);
    let grid = fitted.centred_on(Size::new(width, height));
    let moved = fitted.coordinates(grid.origin[0], grid.origin[1]).map(|v| v.round() as i32);
    let mut found = std::collections::BTreeMap::new();
    let mut sum = 0.0;
    for m in &measured {
        let at = fitted.centre(m.i, m.j);
        sum += (m.x - at[0]).powi(2) + (m.y - at[1]).powi(2);
        found.insert((m.j - moved[1], m.i - moved[0]), [m.x, m.y]);
    }
    let lenslets = grid
        .points_within(Size::new(width, height), 0.0)
        .index
        .into_iter()
        .map(|[i, j]| {
            let at = grid.centre(i, j);
            // A maximum half a pitch or more away belongs to another lenslet.
            let own = found.get(&(j, i)).filter(|c| (c[0] - at[0]).hypot(c[1] - at[1]) < 0.5 * pitch);
            let [x, y] = own.copied().unwrap_or(at);
            Lenslet { i, j, x, y, trust: if own.is_some() { 1.0 } else { 0.0 } }
        })
        .collect();
    Ok(Algorithm1Stages {
        average,
        equalised,
        stretched: image,
        spectrum,
        angle,
        turned,
        eroded,
        centres,
        edges,
        lattice: grid,
        lenslets,
        residual_rms: (sum / measured.len() as f64).sqrt(),
        coherence: locked.coherence,
        prominence: start.prominence,
    })
}
