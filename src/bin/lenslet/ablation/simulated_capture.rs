//! Simulated captures: a camera, a scene, the capture with its white images, and the true views, kept while runs need
//! them.

use std::collections::HashMap;

use anyhow::Result;
use lenslet_core::calibration::{self, Calibration, CalibrationVariant};
use lenslet_core::geometry::Size;
use lenslet_core::lightfield::{ColourSpace, colour};
use lenslet_core::progress::Observer;
use lenslet_data_gen::simulate::{self, Camera, ScenePair, Simulation, SimulationOptions};
use ndarray::{Array2, Array3};

use super::dictionaries::TrainedDictionaries;
use super::experiment::Truth;
use super::settings::Settings;
use super::simulated_scene::SimulatedScene;

/// Captures kept at once; runs come sorted by capture, so that an older one is rarely needed again.
/// Source: chosen.
const KEPT: usize = 2;

/// What distinguishes captures. Noise in thousandths, so that it can be compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Key {
    kind: SimulatedScene,
    seed: u64,
    noise: u64,
}

/// A scene, its captures and its truth.
pub(super) struct SimulatedCapture {
    key: Key,
    pub(super) camera: Camera,
    /// Captured as lenslets gather it.
    pub(super) scenes: ScenePair,
    pub(super) simulation: Simulation,
    /// Views (width, height).
    pub(super) size: Size,
    calibrations: HashMap<&'static str, Calibration>,
    truths: HashMap<(Truth, usize, usize, usize), Array3<f32>>,
}

/// The captures of a call, and the dictionaries trained for them.
pub(super) struct SimulatedCaptures {
    sensor: usize,
    size: usize,
    kept: Vec<SimulatedCapture>,
    trained: TrainedDictionaries,
}

impl SimulatedCaptures {
    pub(super) fn new(settings: &Settings) -> Self {
        SimulatedCaptures {
            sensor: settings.sensor(),
            size: settings.size(),
            kept: Vec::new(),
            trained: TrainedDictionaries::default(),
        }
    }

    /// The dictionaries trained so far.
    pub(super) fn trained(&mut self) -> &mut TrainedDictionaries {
        &mut self.trained
    }

    /// The capture of a scene of `kind` under `seed`, made when it is not there.
    pub(super) fn get(
        &mut self,
        kind: SimulatedScene,
        seed: u64,
        noise: f64,
        observer: &dyn Observer,
    ) -> Result<&mut SimulatedCapture> {
        let key = Key { kind, seed, noise: (1000.0 * noise).round() as u64 };
        if let Some(at) = self.kept.iter().position(|c| c.key == key) {
            // The last one used stays longest.
            let capture = self.kept.remove(at);
            self.kept.push(capture);
        } else {
            if self.kept.len() >= KEPT {
                self.kept.remove(0);
            }
            self.kept.push(SimulatedCapture::new(key, self.sensor, self.size, noise, observer)?);
        }
        let last = self.kept.len() - 1;
        Ok(&mut self.kept[last])
    }
}

impl SimulatedCapture {
    fn new(key: Key, sensor: usize, size: usize, noise: f64, observer: &dyn Observer) -> Result<SimulatedCapture> {
        // Another camera for every seed.
        let camera = Camera::with_sensor(sensor).perturbed(key.seed);
        let scenes = key.kind.draw(&camera, key.seed, observer)?;
        let options = SimulationOptions { seed: key.seed, noise, whites: 2 };
        let simulation = simulate::render_capture(&scenes.gathered, &camera, &options, observer)?;
        let size = simulate::output_size(&camera, size);
        Ok(SimulatedCapture {
            key,
            camera,
            scenes,
            simulation,
            size,
            calibrations: HashMap::new(),
            truths: HashMap::new(),
        })
    }

    /// The calibration of a variant, from the capture's own white images.
    pub(super) fn calibration(&mut self, variant: CalibrationVariant, observer: &dyn Observer) -> Result<&Calibration> {
        if !self.calibrations.contains_key(variant.name()) {
            let options = calibration::CalibrationOptions { variant, ..calibration::CalibrationOptions::default() };
            let found = calibration::calibrate(&self.simulation.whites, &options, observer)?;
            self.calibrations.insert(variant.name(), found);
        }
        Ok(&self.calibrations[variant.name()])
    }

    /// The true view in row v and column u of n×n, sRGB-encoded.
    pub(super) fn truth(&mut self, truth: Truth, v: usize, u: usize, n: usize) -> &Array3<f32> {
        self.truths.entry((truth, v, u, n)).or_insert_with(|| {
            let scene = match truth {
                Truth::Sharp => &self.scenes.sharp,
                Truth::Gathered => &self.scenes.gathered,
            };
            let offset = simulate::view_offset([v, u], n, 1.0);
            let mut view = simulate::true_view(scene, &self.camera, offset, self.size);
            colour::convert(&mut view, ColourSpace::Linear, ColourSpace::Srgb);
            view
        })
    }

    /// True disparity of the middle view.
    pub(super) fn disparity(&self) -> Array2<f32> {
        simulate::true_disparity(&self.scenes.sharp, &self.camera, 1.0, self.size)
    }

    /// Output pixels between neighbouring lenslets.
    pub(super) fn pitch(&self) -> f64 {
        self.camera.lenslets.pitch * self.size.width as f64 / self.camera.sensor.width as f64
    }
}
