//! Training crops of views refined by all the others (paper 4.3, then 4.4): photos stand at several depths before the
//! simulated camera; its captures are calibrated, decoded and refined as a user's would be, noise, colour filters,
//! jitter of the lenslets and errors of disparity included. For samples taken for points (least squares) the truth is the
//! scene as lenslets gather it, for means over a lenslet (the joint fit) the sharp one. With the lattice of a calibrated
//! camera every capture is taken through another piece of that, each lenslet at its own place.

use std::path::PathBuf;

use lenslet_core::calibration;
use lenslet_core::colour::luminance;
use lenslet_core::decode;
use lenslet_core::dictionary::{Footprint, SideInput};
use lenslet_core::lightfield::{ColourSpace, View, colour};
use lenslet_core::metrics::BORDER;
use lenslet_core::progress::{Observer, Silent};
use lenslet_data_gen::pairs::{CameraLattice, Crop};
use lenslet_data_gen::photo::PhotoSet;
use lenslet_data_gen::simulate::{self, Camera, LensletGrid, Lenslets, Scene, SceneName, SceneUse};
use ndarray::{Array2, s};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

use crate::error::Error;
use crate::parameters::Parameters;
use crate::training_crops::TrainingCrops;
use lenslet_views::InterpolatedViews;
use lenslet_views::multiview::{self, Fit};
use lenslet_views::reconstruct::Measurements;

/// Photos that share a scene.
const PHOTOS: usize = 3;
/// Drawn scenes, in turn: photos hardly have thin things before others, letters and sharp edges. None of them is scored.
const DRAWN: SceneUse = SceneUse::Training;
/// Index of the first drawn scene, beyond those of photos.
const AFTER_PHOTOS: usize = 100_000;
/// Views a side of a capture.
const VIEWS: usize = 7;
/// Views of a capture that train.
const TAKEN: usize = 4;
/// Most noise of a capture, as in [`simulate::SimulationOptions`].
const NOISE: f64 = 3.0;
/// Least exposure of a capture, a share of full light.
const DARKEST: f64 = 0.15;
/// JPEG qualities of the captures that are handed on as 8-bit JPEG, one in three.
const QUALITIES: std::ops::RangeInclusive<u8> = 70..=95;

/// Crops for [`crate::train_on_crops`] from photos (files, or folders that are searched): twice
/// `parameters.pairs.crops` for every photo that trains, of `parameters.pairs.crop` pixels a side; every `held_out`-th
/// photo only before captures that do not train. For every two captures of photos there is one of a drawn scene, each
/// with another seed.
///
/// A sample is taken for `footprint`.
///
/// Each capture has another disparity, between −0.35 and 0.35 pitches a sensor pixel, often near 0 where views have
/// the same samples all over again, and noise between none and three times a camera's, mostly little. Half of them are
/// exposed in full, the others have between 15 % and all of that light; a third are saved as 8-bit JPEG of quality 70 to
/// 95, as captures are often handed on.
///
/// # Errors
/// No usable photo, interruption, a pitch that no camera has.
pub fn captured_crops(
    photos: &[PathBuf],
    parameters: &Parameters,
    footprint: Footprint,
    observer: &dyn Observer,
) -> Result<TrainingCrops, Error> {
    let mut data = TrainingCrops { train: Vec::new(), held_out: Vec::new(), photos: Vec::new(), skipped: Vec::new() };
    let (mut train, mut held_out) = (Vec::new(), Vec::new());
    let report = PhotoSet::find(photos, ColourSpace::Srgb)?.for_each(observer, |index, path, _| {
        let keep = parameters.pairs.held_out >= 2 && index % parameters.pairs.held_out == parameters.pairs.held_out - 1;
        if keep { &mut held_out } else { &mut train }.push((index, path.to_path_buf()));
        Ok::<(), Error>(())
    })?;
    (data.photos, data.skipped) = (report.used, report.skipped);
    let mut rng = ChaCha8Rng::seed_from_u64(parameters.seed);
    // Every photo is the background of a capture, with the two after it before it; of those held out every second.
    for k in (1..train.len()).rev() {
        train.swap(k, rng.random_range(0..=k));
    }
    let mut jobs = Vec::new();
    for (set, trains, count, every) in [(&train, true, 2 * parameters.pairs.crops, 1), (&held_out, false, 1, 2)] {
        for k in (0..set.len()).step_by(every) {
            let scene = (0..PHOTOS.min(set.len())).map(|j| set[(k + j) % set.len()].1.clone()).collect();
            jobs.push(Job { shown: Shown::Photos(scene), index: set[k].0, count, trains });
        }
    }
    let kinds = SceneName::of_use(DRAWN).collect::<Vec<_>>().into_iter().cycle();
    for (k, kind) in kinds.take(train.len() / 2).enumerate() {
        let count = 2 * parameters.pairs.crops;
        jobs.push(Job { shown: Shown::Drawn(kind), index: AFTER_PHOTOS + k, count, trains: true });
    }
    observer.begin("captures", jobs.len() as u64);
    let taken = jobs.par_iter().map(|job| {
        observer.check()?;
        let crops = job.take(footprint, parameters)?;
        observer.advance(1);
        Ok(crops)
    });
    // In the order of the jobs, whoever took them.
    for (job, crops) in jobs.iter().zip(taken.collect::<Vec<Result<_, Error>>>()) {
        if job.trains { &mut data.train } else { &mut data.held_out }.extend(crops?);
    }
    Ok(data)
}

/// What stands before the camera of a capture.
enum Shown {
    /// Photos at several depths, the first in the background.
    Photos(Vec<PathBuf>),
    Drawn(SceneName),
}

/// A capture to be taken.
struct Job {
    shown: Shown,
    /// Of its random numbers.
    index: usize,
    /// Crops that are cut.
    count: usize,
    /// Whether they train, or are held out.
    trains: bool,
}

impl Job {
    fn take(&self, footprint: Footprint, parameters: &Parameters) -> Result<Vec<Crop>, Error> {
        let draw = |camera: &Camera, disparity, seed| match &self.shown {
            Shown::Photos(photos) => simulate::photo_scene(photos, camera, Some(disparity), seed, &Silent),
            Shown::Drawn(kind) => Scene::named(*kind, camera, Some(disparity), seed, &Silent),
        };
        capture(&draw, self.index, self.count, footprint, parameters).map_err(|e| {
            Error::Crops(match &self.shown {
                Shown::Photos(photos) => format!("a simulated capture of {}: {e}", photos[0].display()),
                Shown::Drawn(kind) => format!("a simulated capture of the scene {}: {e}", kind.name()),
            })
        })
    }
}

/// Errors of capturing a scene and cutting crops.
#[derive(Debug, thiserror::Error)]
enum CaptureError {
    #[error(transparent)]
    Simulate(#[from] simulate::Error),
    #[error(transparent)]
    Lattice(#[from] lenslet_data_gen::pairs::Error),
    #[error(transparent)]
    Calibration(#[from] calibration::Error),
    #[error(transparent)]
    Decode(#[from] decode::Error),
    #[error(transparent)]
    Views(#[from] lenslet_views::Error),
}

/// What stands before the camera, given its largest disparity and a seed.
type Draw<'a> = &'a dyn Fn(&Camera, f64, u64) -> Result<Scene, simulate::Error>;

/// Crops of one capture.
fn capture(
    draw: Draw<'_>,
    index: usize,
    count: usize,
    footprint: Footprint,
    parameters: &Parameters,
) -> Result<Vec<Crop>, CaptureError> {
    let mut rng = ChaCha8Rng::seed_from_u64(parameters.seed);
    rng.set_stream((5 << 60) | index as u64);
    // As many output pixels as two crops and their borders take, at the camera's own scale.
    let side = 2 * parameters.pairs.crop + 2 * BORDER;
    let (grid, lattice) = (LensletGrid::default(), parameters.degradation.lattice.as_ref());
    let sensor = 2 * ((side as f64 * grid.pitch / parameters.degradation.pitch / 2.0).round() as usize);
    let offset = [rng.random::<f64>() * grid.pitch, rng.random::<f64>() * grid.pitch];
    let mut camera = Camera {
        lenslets: LensletGrid { rotation: parameters.degradation.rotation, offset, ..grid },
        ..Camera::with_sensor(sensor)
    };
    if rng.random::<bool>() {
        camera.response.exposure = rng.random_range(DARKEST..1.0);
    }
    if rng.random_range(0..3) == 0 {
        camera.imperfections.jpeg = Some(rng.random_range(QUALITIES));
    }
    let MeasuredLenslets { camera, centres } = match lattice {
        Some(lattice) => measured_lenslets(lattice, camera, parameters.degradation.pitch, rng.random())?,
        None => MeasuredLenslets { camera, centres: Vec::new() },
    };
    let disparity = 0.7 * rng.random::<f64>() - 0.35;
    let options = simulate::SimulationOptions {
        seed: rng.random::<u32>().into(),
        noise: NOISE * rng.random::<f64>().powi(2),
        whites: 2,
    };
    let scene = draw(&camera, disparity, options.seed)?;
    let lenslets = Lenslets::new(&camera, options.seed)?.moved_to(&centres);
    let simulation = simulate::render_capture_through(&scene, &camera, &lenslets, &options, &Silent)?;
    let calibration = calibration::calibrate(&simulation.whites, &calibration::CalibrationOptions::default(), &Silent)?;
    let samples = decode::sample_views(&simulation.capture, &calibration, &decode::Options::default(), &Silent)?;

    let mut views = vec![(VIEWS / 2, VIEWS / 2)];
    while views.len() < TAKEN.min(count) {
        views.push((rng.random_range(0..VIEWS), rng.random_range(0..VIEWS)));
    }
    let size = simulate::output_size(&camera, side);
    let target = size;
    let wanted: &[SideInput] = parameters.network.as_ref().map_or(&[], |n| &n.side_inputs);
    let truth = Measurements::new(&samples, footprint, parameters.degradation.pitch, size, None, wanted)?;
    let (mut refined, mut beside) = (Vec::new(), Vec::new());
    let mut keep = |v: usize, u: usize, view: View| {
        let values = samples.view(v, u);
        let plane = luminance(view.encode().pixels().view());
        let noise = truth.noise(values, Some(&plane))?;
        let kept = truth.project_onto_samples(&plane, values, &noise, true)?;
        beside.push(truth.side_inputs(wanted, &kept, values, &noise)?);
        refined.push(kept);
        Ok::<(), lenslet_views::Error>(())
    };
    let refinement = multiview::Options { fit: Fit::for_dictionary(footprint), ..multiview::Options::default() };
    InterpolatedViews::refined(&samples, &refinement, &target, &Silent)?.render_views(&views, &mut keep, &Silent)?;

    // Where a sample is a point of the picture, that is the scene as lenslets gather it; else the sharp one.
    let scene = if footprint == Footprint::Lenslet { draw(&camera.sharp(), disparity, options.seed)? } else { scene };
    let truths: Vec<Array2<f32>> = views
        .iter()
        .map(|&at| {
            let mut truth = simulate::true_view(&scene, &camera, simulate::view_offset([at.0, at.1], VIEWS, 1.0), size);
            colour::convert(&mut truth, ColourSpace::Linear, ColourSpace::Srgb);
            luminance(truth.view())
        })
        .collect();
    let mut crops = Vec::new();
    for k in 0..count {
        let at = k % views.len();
        let edge = parameters.pairs.crop.min(size.width.min(size.height).saturating_sub(2 * BORDER));
        let mut corner = |n: usize| rng.random_range(BORDER..=(n - BORDER - edge).max(BORDER));
        let (y, x) = (corner(size.height), corner(size.width));
        let cut = |p: &Array2<f32>| p.slice(s![y..y + edge, x..x + edge]).to_owned();
        let side_inputs = beside[at].iter().map(cut).collect();
        crops.push(Crop { photo: index, high: cut(&truths[at]), low: cut(&refined[at]), side_inputs });
    }
    Ok(crops)
}

/// A small camera and the lenslets of its own whose places were measured.
struct MeasuredLenslets {
    /// Its lattice is laid over measured lenslets, which have no errors but their own.
    camera: Camera,
    /// Their centres (x, y), sensor pixels; the others lie where the camera's own do.
    centres: Vec<[f64; 2]>,
}

/// The lenslets in a window of `lattice` that the sensor of `camera` takes. `pitch`: that of `lattice`, in its pixels;
/// `place` (0..1 in x and y): where the window lies.
fn measured_lenslets(
    lattice: &CameraLattice,
    camera: Camera,
    pitch: f64,
    place: [f64; 2],
) -> Result<MeasuredLenslets, CaptureError> {
    let scale = camera.lenslets.pitch / pitch;
    let side = (camera.sensor.width as f64 / scale).ceil() as usize;
    let in_view = lattice.window(side, side, place)?.centres;
    let centres: Vec<[f64; 2]> = in_view.iter().map(|c| c.map(|x| (x + 0.5) * scale - 0.5)).collect();
    let middle = (camera.sensor.width as f64 - 1.0) / 2.0;
    let offsets = centres.iter().map(|c| c.map(|x| x - middle));
    let nearest = offsets.min_by(|a, b| a[0].hypot(a[1]).total_cmp(&b[0].hypot(b[1])));
    let lenslets = LensletGrid {
        row_stretch: lattice.row_stretch(),
        offset: nearest.unwrap_or(camera.lenslets.offset),
        jitter: 0.0,
        ..camera.lenslets
    };
    Ok(MeasuredLenslets { camera: Camera { lenslets, ..camera }, centres })
}

#[cfg(test)]
mod tests {
    use lenslet_core::geometry::Size;

    use lenslet_core::calibration::{Calibration, Lattice};

    use super::*;

    /// Views of 400×300 pixels, 5 of them between lenslets, whose rows are stretched and whose lenslets lie askew.
    fn lattice() -> CameraLattice {
        let lattice = Lattice::hexagonal(10.0, 0.01, 1.04, [400.0, 300.0]);
        let askew = |i: i32, j: i32| 0.2 * f64::from((7 * i + 13 * j).rem_euclid(5)) - 0.4;
        let mut calibration = Calibration::of_lattice(lattice, Size::new(800, 600));
        for l in &mut calibration.lenslets {
            l.x += askew(l.i, l.j);
            l.y -= askew(l.j, l.i);
        }
        CameraLattice::of_calibration(&calibration, 400).unwrap()
    }

    #[test]
    fn the_small_camera_has_every_lenslet_of_the_window_at_its_place() {
        let camera =
            Camera { lenslets: LensletGrid { rotation: 0.01, ..LensletGrid::default() }, ..Camera::with_sensor(240) };
        let measured = measured_lenslets(&lattice(), camera, 5.0, [0.3, 0.6]).unwrap();
        let regular = Lenslets::new(&measured.camera, 1).unwrap();
        let moved = regular.clone().moved_to(&measured.centres);
        let distances = |lenslets: &Lenslets| -> Vec<f64> {
            measured.centres.iter().map(|c| lenslets.nearest(c[0], c[1]).1.sqrt()).collect()
        };
        assert!(measured.centres.len() > 500, "{}", measured.centres.len());
        assert!(distances(&moved).iter().all(|d| *d < 1e-9));
        // What the stretch and the rotation do not explain is each lenslet's own: at most √2·0.4 pixels, twice that
        // from the one on which the regular lattice lies.
        let unexplained = distances(&regular);
        let mean = unexplained.iter().sum::<f64>() / unexplained.len() as f64;
        assert!((0.2..0.9).contains(&mean) && unexplained.iter().all(|d| *d < 1.3), "{mean}");
    }

    #[test]
    fn captures_are_taken_through_the_calibrated_lenslets() {
        let mut parameters = Parameters::default();
        parameters.pairs.crop = 48;
        (parameters.degradation.pitch, parameters.degradation.rotation) = (5.0, 0.01);
        let kind = SceneName::of_use(DRAWN).next().unwrap();
        let draw = |camera: &Camera, disparity, seed| Scene::named(kind, camera, Some(disparity), seed, &Silent);
        let regular = capture(&draw, 0, 1, Footprint::Point, &parameters).unwrap();
        parameters.degradation.lattice = Some(lattice());
        let calibrated = capture(&draw, 0, 1, Footprint::Point, &parameters).unwrap();
        assert_eq!(regular[0].low.dim(), calibrated[0].low.dim());
        assert_ne!(regular[0].low, calibrated[0].low);
        let error = |c: &Crop| (&c.low - &c.high).mapv(f32::abs).mean().unwrap();
        assert!(error(&calibrated[0]) < 2.0 * error(&regular[0]), "the refined view is of the scene");
    }
}
