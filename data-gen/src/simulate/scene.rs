//! Scenes: what there is to see, as layers from front to back, each with its disparity.

use std::str::FromStr;

use lenslet_core::progress::Observer;
use rayon::prelude::*;
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
    /// Which layers can show in each cell of [`CELL`] pitches, as bits, for offsets up to `reach`.
    cells: Vec<u32>,
    across: usize,
    /// Corner of the first cell, pitches.
    corner: [f64; 2],
    reach: f64,
}

/// Side of a cell in pitches.
const CELL: f64 = 4.0;

/// Layers of a scene at most.
const MOST_LAYERS: usize = 32;

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
        if plan.sheets.len() > MOST_LAYERS {
            return Err(Error::Parameter(format!("{} layers are too many: at most {MOST_LAYERS}", plan.sheets.len())));
        }
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
        // Offsets within a lenslet, corners and blur included.
        let reach = 0.75 * camera.pitch + 4.0;
        let across = ((canvas[2] - canvas[0]) / CELL).ceil() as usize;
        let down = ((canvas[3] - canvas[1]) / CELL).ceil() as usize;
        let mut cells = vec![0u32; across * down];
        cells.par_iter_mut().enumerate().for_each(|(k, cell)| {
            let (x, y) = (canvas[0] + (k % across) as f64 * CELL, canvas[1] + (k / across) as f64 * CELL);
            for (n, layer) in layers.iter().enumerate() {
                *cell |= u32::from(layer.reaches([x, y, x + CELL, y + CELL], reach)) << n;
            }
        });
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
            cells,
            across,
            corner: [canvas[0], canvas[1]],
            reach,
        })
    }

    /// Linear sRGB seen at sensor position (`x`, `y`) under offset `delta` (sensor pixels from the lenslet centre).
    #[inline]
    pub fn sample(&self, x: f64, y: f64, delta: [f64; 2]) -> [f32; 3] {
        let p = [(x - self.centre[0]) / self.pitch, (y - self.centre[1]) / self.pitch];
        let mut seen = [0f32; 3];
        let mut left = 1f32;
        let mut bits = self.showing(p, delta);
        while bits != 0 {
            let layer = &self.layers[bits.trailing_zeros() as usize];
            bits &= bits - 1;
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

    /// The layers that can show at `p` under offset `delta`, as bits.
    #[inline]
    fn showing(&self, p: [f64; 2], delta: [f64; 2]) -> u32 {
        let (column, row) = ((p[0] - self.corner[0]) / CELL, (p[1] - self.corner[1]) / CELL);
        let known = delta[0].abs() <= self.reach && delta[1].abs() <= self.reach && column >= 0.0 && row >= 0.0;
        let (column, row) = (column as usize, row as usize);
        if known
            && column < self.across
            && let Some(cell) = self.cells.get(row * self.across + column)
        {
            return *cell;
        }
        (((1u64 << self.layers.len()) - 1) & u64::from(u32::MAX)) as u32
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

#[cfg(test)]
mod tests {
    use lenslet_core::progress::Silent;

    use super::*;

    fn camera() -> Camera {
        Camera { sensor: (300, 260), ..Camera::default() }
    }

    #[test]
    fn leaving_out_hidden_layers_changes_nothing() {
        for kind in Kind::ALL {
            let scene = Scene::named(kind, &camera(), Some(0.3), 5, &Silent).unwrap();
            let mut all = scene.clone();
            all.reach = -1.0;
            for k in 0..3000u32 {
                let (x, y) = (f64::from(k % 61) * 5.0 - 1.0, f64::from(k / 61) * 5.5 - 1.0);
                let delta = [f64::from(k % 7) - 3.0, f64::from(k % 5) * 1.5 - 3.0];
                let (fast, plain) = (scene.sample(x, y, delta), all.sample(x, y, delta));
                assert!(fast.iter().zip(&plain).all(|(a, b)| (a - b).abs() < 1e-5), "{kind:?} {fast:?} {plain:?}");
            }
        }
    }

    #[test]
    fn every_scene_is_opaque_within_its_range_and_follows_the_seed() {
        for kind in Kind::ALL {
            let make = |seed| Scene::named(kind, &camera(), None, seed, &Silent).unwrap();
            let (scene, again, other) = (make(5), make(5), make(6));
            let mut differs = false;
            for k in 0..2000u32 {
                let (x, y) = (f64::from(k % 50) * 6.0, f64::from(k / 50) * 6.5);
                let seen = scene.sample(x, y, [2.0, -1.0]);
                assert!(seen.iter().all(|v| (0.0..=0.96).contains(v)), "{kind:?} {seen:?}");
                assert_eq!(seen, again.sample(x, y, [2.0, -1.0]));
                differs |= seen != other.sample(x, y, [2.0, -1.0]);
            }
            assert_eq!(differs, !matches!(kind, Kind::White | Kind::Chart | Kind::Colour), "{kind:?}");
        }
    }

    #[test]
    fn disparity_says_where_a_point_goes() {
        // What view u shows at x + d·u is what the central view shows at x, wherever nothing hides it.
        let camera = camera();
        for kind in [Kind::Flat, Kind::Slanted, Kind::Planes, Kind::Natural] {
            let scene = Scene::named(kind, &camera, Some(0.2), 5, &Silent).unwrap();
            let (mut same, mut all) = (0, 0);
            for k in 0..2500u32 {
                let (x, y) = (30.0 + f64::from(k % 50) * 4.8, 30.0 + f64::from(k / 50) * 4.0);
                let d = scene.disparity(x, y, [0.0; 2]);
                let (a, b) = (scene.sample(x, y, [0.0; 2]), scene.sample(x + 2.0 * d, y - 3.0 * d, [2.0, -3.0]));
                all += 1;
                same += usize::from(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 0.01));
            }
            let needed = if matches!(kind, Kind::Flat | Kind::Slanted) { 1.0 } else { 0.6 };
            assert!(same as f64 >= needed * f64::from(all), "{kind:?}: {same} of {all}");
        }
    }

    #[test]
    fn wrong_values_are_refused() {
        for disparity in [2.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(
                Scene::named(Kind::Flat, &camera(), Some(disparity), 1, &Silent),
                Err(Error::Parameter(_))
            ));
        }
        assert!("nothing".parse::<Kind>().is_err() && "natural".parse() == Ok(Kind::Natural));
    }
}
