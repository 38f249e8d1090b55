//! Scenes: what there is to see, as layers from front to back, each with its disparity.

use std::str::FromStr;

use lenslet_core::progress::Observer;
use serde::{Deserialize, Serialize};

use super::camera::Camera;
use super::layer::{Bounds, Layer, Sheet};
use super::{Error, chart, painting};

/// A scene by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Wall, table, poster, leaves and wires at several depths.
    Natural,
    /// Four textured planes at even steps of disparity, overlapping.
    Planes,
    /// One textured plane whose disparity runs from one side to the other.
    Slanted,
    /// Thin bars and wires in front of a textured wall.
    Occluders,
    /// Resolution chart on one plane: sector star, line pairs, slanted edge, letters.
    Chart,
    /// Colour chart of 24 known patches, disparity 0 unless asked otherwise.
    Colour,
    /// Evenly lit white.
    White,
    /// One textured plane, disparity 0 unless asked otherwise.
    Flat,
}

impl Kind {
    /// All of them.
    pub const ALL: [Kind; 8] = [
        Kind::Natural,
        Kind::Planes,
        Kind::Slanted,
        Kind::Occluders,
        Kind::Chart,
        Kind::Colour,
        Kind::White,
        Kind::Flat,
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Natural => "natural",
            Kind::Planes => "planes",
            Kind::Slanted => "slanted",
            Kind::Occluders => "occluders",
            Kind::Chart => "chart",
            Kind::Colour => "colour",
            Kind::White => "white",
            Kind::Flat => "flat",
        }
    }

    /// Largest disparity where none is asked for, in pitches per sensor pixel.
    pub fn usual_disparity(self) -> f64 {
        match self {
            Kind::Natural | Kind::Planes | Kind::Slanted | Kind::Occluders => 0.3,
            Kind::Chart => 0.15,
            Kind::Colour | Kind::White | Kind::Flat => 0.0,
        }
    }
}

impl FromStr for Kind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Kind::ALL.into_iter().find(|k| k.name() == text).ok_or_else(|| {
            let names: Vec<_> = Kind::ALL.iter().map(|k| k.name()).collect();
            format!("no scene is named {text:?}; there are {}", names.join(", "))
        })
    }
}

/// Something of the scene whose place tests and scores need: a patch of known colour, an edge, a line pattern.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Region {
    /// What it is: `patch`, `edge`, `lines`, `star`, `letters`.
    pub kind: String,
    /// Left, top, right, bottom as shares of the width and height of the central view.
    pub bounds: [f64; 4],
    /// Line pairs a lenslet pitch (`lines`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency: Option<f64>,
    /// Direction across the lines or the edge, radians from x, clockwise on screen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle: Option<f64>,
    /// Linear sRGB (`patch`); dark and bright level in `levels` otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colour: Option<[f32; 3]>,
    /// Dark and bright level, linear light.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub levels: Option<[f32; 2]>,
}

/// A scene before it is rasterised: sheets from front to back.
#[derive(Default)]
pub struct Plan<'a> {
    /// Front first; the last has no border and is opaque.
    pub sheets: Vec<Sheet<'a>>,
    /// Known things, bounds in pitches from the sensor's centre (turned into shares by [`Scene::new`]).
    pub regions: Vec<Region>,
}

/// What is around a plan: half the canvas in pitches, the largest disparity, the seed.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// Half the canvas (x, y) in pitches.
    pub half: [f64; 2],
    /// Largest disparity, pitches per sensor pixel.
    pub disparity: f64,
    /// Seed of all randomness in the pictures.
    pub seed: u32,
}

/// A rasterised scene, ready to be looked at from any view.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Name, for the record.
    pub name: String,
    /// Largest disparity asked for, pitches per sensor pixel.
    pub disparity: f64,
    /// Known things.
    pub regions: Vec<Region>,
    pitch: f64,
    centre: [f64; 2],
    layers: Vec<Layer>,
}

impl Scene {
    /// Draws the named scene for `camera`. `disparity`: the largest one in lenslet pitches per sensor pixel of offset
    /// (−1..=1; `None`: [`Kind::usual_disparity`]).
    ///
    /// # Errors
    /// [`Error::Parameter`] for values out of range, [`Error::Interrupted`] when the observer says so.
    pub fn named(
        kind: Kind,
        camera: &Camera,
        disparity: Option<f64>,
        seed: u64,
        observer: &dyn Observer,
    ) -> Result<Scene, Error> {
        let disparity = disparity.unwrap_or(kind.usual_disparity());
        let frame = Frame::new(camera, disparity, seed)?;
        let plan = match kind {
            Kind::Natural => painting::natural(&frame),
            Kind::Planes => painting::planes(&frame),
            Kind::Slanted => painting::slanted(&frame),
            Kind::Occluders => painting::occluders(&frame),
            Kind::Flat => painting::flat(&frame),
            Kind::White => chart::white(),
            Kind::Chart => chart::resolution(&frame),
            Kind::Colour => chart::colour(&frame),
        };
        Scene::new(kind.name(), camera, &frame, &plan, observer)
    }

    /// Rasterises a plan.
    ///
    /// # Errors
    /// As [`Scene::named`].
    pub fn new(
        name: &str,
        camera: &Camera,
        frame: &Frame,
        plan: &Plan,
        observer: &dyn Observer,
    ) -> Result<Scene, Error> {
        camera.check()?;
        // A pixel of a neighbouring lenslet looks past the canvas by its disparity times its offset.
        let rim = frame.disparity.abs() * camera.pitch + 3.0;
        let canvas: Bounds = [-frame.half[0] - rim, -frame.half[1] - rim, frame.half[0] + rim, frame.half[1] + rim];
        observer.begin("scene", plan.sheets.len() as u64);
        let mut layers = Vec::with_capacity(plan.sheets.len());
        for sheet in &plan.sheets {
            if observer.cancelled() {
                return Err(Error::Interrupted);
            }
            layers.push(Layer::new(sheet, canvas, camera.footprint)?);
            observer.advance(1);
        }
        let share = |value: f64, axis: usize| (value + frame.half[axis]) / (2.0 * frame.half[axis]);
        let regions = plan.regions.iter().map(|region| {
            let [left, top, right, bottom] = region.bounds;
            Region { bounds: [share(left, 0), share(top, 1), share(right, 0), share(bottom, 1)], ..region.clone() }
        });
        Ok(Scene {
            name: name.to_owned(),
            disparity: frame.disparity,
            regions: regions.collect(),
            pitch: camera.pitch,
            centre: [(camera.sensor.0 as f64 - 1.0) / 2.0, (camera.sensor.1 as f64 - 1.0) / 2.0],
            layers,
        })
    }

    /// Linear sRGB seen at sensor position (`x`, `y`) under offset `delta` (sensor pixels from the lenslet centre).
    #[inline]
    pub fn sample(&self, x: f64, y: f64, delta: [f64; 2]) -> [f32; 3] {
        let p = [(x - self.centre[0]) / self.pitch, (y - self.centre[1]) / self.pitch];
        let mut seen = [0f32; 3];
        let mut left = 1f32;
        for layer in &self.layers {
            let [r, g, b, a] = layer.sample(p, delta);
            seen[0] += left * r;
            seen[1] += left * g;
            seen[2] += left * b;
            left *= 1.0 - a;
            if left < 1e-4 {
                break;
            }
        }
        seen
    }

    /// Disparity of what is seen at (`x`, `y`) under offset `delta`, in sensor pixels per sensor pixel of offset.
    pub fn disparity(&self, x: f64, y: f64, delta: [f64; 2]) -> f64 {
        let p = [(x - self.centre[0]) / self.pitch, (y - self.centre[1]) / self.pitch];
        let mut left = 1f32;
        for layer in &self.layers {
            left *= 1.0 - layer.sample(p, delta)[3];
            if left < 0.5 {
                return layer.disparity(p, delta) * self.pitch;
            }
        }
        0.0
    }
}

impl Frame {
    /// The frame of `camera`'s sensor.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the disparity is not in −1..=1.
    pub fn new(camera: &Camera, disparity: f64, seed: u64) -> Result<Frame, Error> {
        camera.check()?;
        if !(-1.0..=1.0).contains(&disparity) {
            return Err(Error::Parameter(format!(
                "the disparity must lie in -1..=1 pitches per step, not {disparity}"
            )));
        }
        let half = [camera.sensor.0 as f64 / (2.0 * camera.pitch), camera.sensor.1 as f64 / (2.0 * camera.pitch)];
        Ok(Frame { half, disparity, seed: (seed ^ (seed >> 32)) as u32 })
    }
}
