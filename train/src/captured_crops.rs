//! Training crops of views refined by all the others (paper 4.3, then 4.4): photos stand at several depths before the
//! simulated camera; its captures are calibrated, decoded and refined as a user's would be, noise, colour filters,
//! jitter of the lenslets and errors of disparity included. The truth is the scene as a lenslet sees it.

use std::path::PathBuf;

use lenslet_core::calibration;
use lenslet_core::colour::luminance;
use lenslet_core::decode;
use lenslet_core::dictionary::Footprint;
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::{ColourSpace, View, colour};
use lenslet_core::metrics::BORDER;
use lenslet_core::progress::{Observer, Silent};
use lenslet_data_gen::pairs::Crop;
use lenslet_data_gen::photo::PhotoSet;
use lenslet_data_gen::simulate::{self, Camera, LensletGrid, Scene, SceneName, SceneUse};
use ndarray::{Array2, s};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use crate::error::Error;
use crate::parameters::Parameters;
use crate::training_crops::TrainingCrops;
use lenslet_views::InterpolatedViews;
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

/// Crops for [`crate::train_on_crops`] from photos (files, or folders that are searched): twice
/// `parameters.pairs.crops` for every photo that trains, of `parameters.pairs.crop` pixels a side; every `held_out`-th
/// photo only before captures that do not train. For every two captures of photos there is one of a drawn scene, each
/// with another seed.
///
/// Each capture has another disparity, between −0.35 and 0.35 pitches a sensor pixel, often near 0 where views have
/// the same samples all over again, and noise between none and three times a camera's, mostly little.
///
/// # Errors
/// No usable photo, interruption, a pitch that no camera has.
pub fn captured_crops(
    photos: &[PathBuf],
    parameters: &Parameters,
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
    let drawn = train.len() / 2;
    observer.begin("captures", (train.len() + held_out.len().div_ceil(2) + drawn) as u64);
    let sets = [(&train, &mut data.train, 2 * parameters.pairs.crops, 1), (&held_out, &mut data.held_out, 1, 2)];
    for (set, crops, count, every) in sets {
        for k in (0..set.len()).step_by(every) {
            observer.check()?;
            let scene: Vec<PathBuf> = (0..PHOTOS.min(set.len())).map(|j| set[(k + j) % set.len()].1.clone()).collect();
            let index = set[k].0;
            let draw = |camera: &Camera, disparity, seed| {
                simulate::photo_scene(&scene, camera, Some(disparity), seed, &Silent)
            };
            let failed = |e: CaptureError| Error::Crops(format!("a simulated capture of {}: {e}", scene[0].display()));
            crops.extend(capture(&draw, index, count, parameters).map_err(failed)?);
            observer.advance(1);
        }
    }
    for (k, kind) in SceneName::of_use(DRAWN).collect::<Vec<_>>().into_iter().cycle().take(drawn).enumerate() {
        observer.check()?;
        let draw = |camera: &Camera, disparity, seed| Scene::named(kind, camera, Some(disparity), seed, &Silent);
        let failed = |e: CaptureError| Error::Crops(format!("a simulated capture of the scene {}: {e}", kind.name()));
        let index = AFTER_PHOTOS + k;
        data.train.extend(capture(&draw, index, 2 * parameters.pairs.crops, parameters).map_err(failed)?);
        observer.advance(1);
    }
    Ok(data)
}

/// Errors of capturing a scene and cutting crops.
#[derive(Debug, thiserror::Error)]
enum CaptureError {
    #[error(transparent)]
    Simulate(#[from] simulate::Error),
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
fn capture(draw: Draw<'_>, index: usize, count: usize, parameters: &Parameters) -> Result<Vec<Crop>, CaptureError> {
    let mut rng = ChaCha8Rng::seed_from_u64(parameters.seed);
    rng.set_stream((5 << 60) | index as u64);
    // As many output pixels as two crops and their borders take, at the camera's own scale.
    let side = 2 * parameters.pairs.crop + 2 * BORDER;
    let grid = LensletGrid::default();
    let sensor = 2 * ((side as f64 * grid.pitch / parameters.degradation.pitch / 2.0).round() as usize);
    let offset = [rng.random::<f64>() * grid.pitch, rng.random::<f64>() * grid.pitch];
    let camera = Camera {
        lenslets: LensletGrid { rotation: parameters.degradation.rotation, offset, ..grid },
        ..Camera::with_sensor(sensor)
    };
    let disparity = 0.7 * rng.random::<f64>() - 0.35;
    let options = simulate::SimulationOptions {
        seed: rng.random::<u32>().into(),
        noise: NOISE * rng.random::<f64>().powi(2),
        whites: 2,
    };
    let scene = draw(&camera, disparity, options.seed)?;
    let simulation = simulate::render_capture(&scene, &camera, &options, &Silent)?;
    let calibration = calibration::calibrate(&simulation.whites, &calibration::CalibrationOptions::default(), &Silent)?;
    let samples = decode::sample_views(&simulation.capture, &calibration, &decode::Options::default(), &Silent)?;

    let mut views = vec![(VIEWS / 2, VIEWS / 2)];
    while views.len() < TAKEN.min(count) {
        views.push((rng.random_range(0..VIEWS), rng.random_range(0..VIEWS)));
    }
    let size = simulate::output_size(&camera, side);
    let target = Size { width: size.0, height: size.1 };
    let alone: &[Interpolation] = parameters.network.as_ref().map_or(&[], |n| &n.side_inputs);
    let truth = Measurements::new(&samples, Footprint::Point, parameters.degradation.pitch, size, None, alone)?;
    let (mut refined, mut beside) = (Vec::new(), Vec::new());
    let mut keep = |v: usize, u: usize, view: View| {
        let values = samples.view(v, u);
        refined.push(truth.project_onto_samples(&luminance(view.encode().pixels().view()), values, true)?);
        beside.push(
            alone
                .iter()
                .map(|&base| truth.interpolate_own_samples(values, base))
                .collect::<Result<Vec<_>, lenslet_views::Error>>()?,
        );
        Ok::<(), lenslet_views::Error>(())
    };
    InterpolatedViews::prepare(&samples, Interpolation::Multiview, &target, &Silent)?
        .render_views(&views, &mut keep, &Silent)?;

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
        let edge = parameters.pairs.crop.min(size.0.min(size.1).saturating_sub(2 * BORDER));
        let mut corner = |n: usize| rng.random_range(BORDER..=(n - BORDER - edge).max(BORDER));
        let (y, x) = (corner(size.1), corner(size.0));
        let cut = |p: &Array2<f32>| p.slice(s![y..y + edge, x..x + edge]).to_owned();
        let side_inputs = beside[at].iter().map(cut).collect();
        crops.push(Crop { photo: index, high: cut(&truths[at]), low: cut(&refined[at]), side_inputs });
    }
    Ok(crops)
}
