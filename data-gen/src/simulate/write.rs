//! A simulation on disk: `capture.lfp`, `white-NN.lfp`, and `truth/` with centres, disparity, views as lenslets gather them
//! (`views`) and sharp ones (`sharp`), and what the scene was.

use std::io::Write;
use std::path::Path;

use lenslet_core::container;
use lenslet_core::lightfield::{self, ColourSpace, Format, Meta, ViewOrigin, colour};
use lenslet_core::output::{Pending, create_part, write_part};
use lenslet_core::progress::Observer;
use ndarray::Array2;
use ndarray_npy::WriteNpyExt;
use serde_json::json;

use super::camera::Camera;
use super::capture::{Simulation, capture_name};
use super::error::Error;
use super::options::{SimulationOptions, TruthOptions};
use super::scene::{Scene, ScenePair};
use super::truth;

/// Writes everything into the directory `dir`, which appears when it is complete.
///
/// # Errors
/// [`Error::Parameter`], [`Error::Interrupted`], or what keeps a file from being written.
#[allow(clippy::too_many_arguments)] // the record needs every input of the simulation
pub fn write_simulation(
    dir: &Path,
    scenes: &ScenePair,
    camera: &Camera,
    options: &SimulationOptions,
    simulation: &Simulation,
    truth: &TruthOptions,
    force: bool,
    observer: &dyn Observer,
) -> Result<(), Error> {
    truth.check()?;
    let scene = &scenes.gathered;
    let pending = Pending::directory(dir, force)?;
    let root = pending.path().to_path_buf();
    let path = root.join(capture_name(camera));
    match &simulation.jpeg {
        Some(saved) => {
            for (path, bytes) in [(path.clone(), &saved.file), (path.with_extension("json"), &saved.metadata)] {
                write_part(&path, bytes).map_err(|e| Error::Write { path, reason: e.to_string() })?;
            }
        }
        None => container::write_lfp(&path, &simulation.capture, false)?,
    }
    for (k, white) in simulation.whites.iter().enumerate() {
        container::write_lfp(&root.join(format!("white-{k:02}.lfp")), white, false)?;
    }
    let folder = root.join("truth");
    let centres = Array2::from_shape_fn((simulation.centres.len(), 2), |(k, axis)| simulation.centres[k][axis]);
    npy(&folder.join("centres.npy"), &centres)?;

    let size = truth::output_size(camera, truth.size);
    npy(&folder.join("disparity.npy"), &truth::true_disparity(scene, camera, truth.view_step, size))?;
    let record = json!({
        "tool": concat!("lenslet ", env!("CARGO_PKG_VERSION")),
        "scene": scene.name,
        "largest_disparity": scene.disparity,
        "largest_disparity_unit": "lenslet pitches per sensor pixel of offset",
        "camera": camera,
        "seed": options.seed,
        "noise": options.noise,
        "whites": options.whites,
        "view_step": truth.view_step,
        "regions": scene.regions,
    });
    let path = folder.join("scene.json");
    let text =
        serde_json::to_vec_pretty(&record).map_err(|e| Error::Write { path: path.clone(), reason: e.to_string() })?;
    write_part(&path, &text).map_err(|e| Error::Write { path, reason: e.to_string() })?;

    observer.begin("truth", 2 * (truth.views * truth.views) as u64);
    write_views(&folder.join("views"), (scene, "gathered"), camera, options.seed, truth, observer)?;
    write_views(&folder.join("sharp"), (&scenes.sharp, "sharp"), camera, options.seed, truth, observer)?;
    pending.commit()?;
    Ok(())
}

/// The true views of a scene, sharp or as lenslets gather it, as a light field.
fn write_views(
    to: &Path,
    (scene, seen): (&Scene, &str),
    camera: &Camera,
    seed: u64,
    truth: &TruthOptions,
    observer: &dyn Observer,
) -> Result<(), Error> {
    let (n, size) = (truth.views, truth::output_size(camera, truth.size));
    let mut meta = Meta::new([n, n], [size.height, size.width], 3, ColourSpace::Srgb);
    meta.method = Some(ViewOrigin::Truth);
    meta.provenance.push(json!({
        "tool": "lenslet simulate", "version": env!("CARGO_PKG_VERSION"), "scene": scene.name, "seed": seed,
        "truth": seen,
    }));
    let mut sink = lightfield::create(to, meta, Format::Directory, false)?;
    for v in 0..n {
        for u in 0..n {
            observer.check()?;
            let mut view = truth::true_view(scene, camera, truth::view_offset([v, u], n, truth.view_step), size);
            colour::convert(&mut view, ColourSpace::Linear, ColourSpace::Srgb);
            sink.write(v, u, &view)?;
            observer.advance(1);
        }
    }
    sink.finish()?;
    Ok(())
}

fn npy<T: ndarray_npy::WritableElement>(path: &Path, array: &Array2<T>) -> Result<(), Error> {
    let failed = |reason: String| Error::Write { path: path.to_path_buf(), reason };
    let mut part = std::io::BufWriter::new(create_part(path).map_err(|e| failed(e.to_string()))?);
    array.write_npy(&mut part).map_err(|e| failed(e.to_string()))?;
    part.flush().map_err(|e| failed(e.to_string()))
}
