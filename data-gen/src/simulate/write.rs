//! A simulation on disk: `capture.lfp`, `white-NN.lfp`, and `truth/` with centres, views, disparity and what the scene was.

use std::path::Path;

use lenslet_core::container;
use lenslet_core::lightfield::{self, ColourSpace, Format, Meta, ViewOrigin, colour};
use lenslet_core::output::Pending;
use lenslet_core::progress::Observer;
use ndarray::Array2;
use serde_json::json;

use super::camera::Camera;
use super::scene::Scene;
use super::{Error, Options, Simulation, truth};

/// What truth to write.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// Views a row and a column, odd, 1..=15.
    pub views: usize,
    /// Sensor pixels between neighbouring views, above 0, at most 4.
    pub view_step: f64,
    /// Longer side of the views, 16..=8192 pixels.
    pub size: usize,
}

impl Default for Truth {
    fn default() -> Self {
        Truth { views: 7, view_step: 1.0, size: 1080 }
    }
}

impl Truth {
    /// Refuses what cannot be rendered.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the first value out of range.
    pub fn check(&self) -> Result<(), Error> {
        let bad = |text: String| Err(Error::Parameter(text));
        if self.views.is_multiple_of(2) || self.views > 15 {
            return bad(format!("the views a side must be odd and at most 15, not {}", self.views));
        }
        if !(self.view_step > 0.0 && self.view_step <= 4.0) {
            return bad(format!("the view step must be over 0 and at most 4, not {}", self.view_step));
        }
        if !(16..=8192).contains(&self.size) {
            return bad(format!("the size of the views must lie in 16..=8192, not {}", self.size));
        }
        Ok(())
    }
}

/// Writes everything into the directory `dir`, which appears when it is complete.
///
/// # Errors
/// [`Error::Parameter`], [`Error::Interrupted`], or what keeps a file from being written.
#[allow(clippy::too_many_arguments)] // the record needs every input of the simulation
pub fn write(
    dir: &Path,
    scene: &Scene,
    camera: &Camera,
    options: &Options,
    simulation: &Simulation,
    truth: &Truth,
    force: bool,
    observer: &dyn Observer,
) -> Result<(), Error> {
    truth.check()?;
    let pending = Pending::directory(dir, force)?;
    let root = pending.path().to_path_buf();
    container::write_lfp(&root.join(capture_name(camera)), &simulation.capture, false)?;
    for (k, white) in simulation.whites.iter().enumerate() {
        container::write_lfp(&root.join(format!("white-{k:02}.lfp")), white, false)?;
    }
    let folder = root.join("truth");
    std::fs::create_dir(&folder).map_err(|e| Error::Write { path: folder.clone(), reason: e.to_string() })?;
    let centres = Array2::from_shape_fn((simulation.centres.len(), 2), |(k, axis)| simulation.centres[k][axis]);
    npy(&folder.join("centres.npy"), &centres)?;

    let size = truth::output_size(camera, truth.size);
    npy(&folder.join("disparity.npy"), &truth::disparity(scene, camera, truth.view_step, size))?;
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
    std::fs::write(&path, text).map_err(|e| Error::Write { path, reason: e.to_string() })?;

    let n = truth.views;
    let mut meta = Meta::new([n, n], [size.1, size.0], 3, ColourSpace::Srgb);
    meta.method = Some(ViewOrigin::Truth);
    meta.provenance.push(json!({
        "tool": "lenslet simulate", "version": env!("CARGO_PKG_VERSION"), "scene": scene.name, "seed": options.seed,
    }));
    let mut sink = lightfield::create(&folder.join("views"), meta, Format::Directory, false)?;
    observer.begin("truth", (n * n) as u64);
    for v in 0..n {
        for u in 0..n {
            if observer.cancelled() {
                return Err(Error::Interrupted);
            }
            let mut view = truth::view(scene, camera, truth::offset([v, u], n, truth.view_step), size);
            colour::convert(&mut view, ColourSpace::Linear, ColourSpace::Srgb);
            sink.write(v, u, &view)?;
            observer.advance(1);
        }
    }
    sink.finish()?;
    pending.commit()?;
    Ok(())
}

/// What the capture's file is called: captures that carry their white image are called `.lfr`.
pub fn capture_name(camera: &Camera) -> &'static str {
    if camera.white_inside { "capture.lfr" } else { "capture.lfp" }
}

fn npy<T: ndarray_npy::WritableElement>(path: &Path, array: &Array2<T>) -> Result<(), Error> {
    ndarray_npy::write_npy(path, array).map_err(|e| Error::Write { path: path.to_path_buf(), reason: e.to_string() })
}
