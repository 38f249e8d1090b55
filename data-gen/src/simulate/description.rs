//! A scene before it is rasterised: layers from front to back, given by formulas, and the things whose place is known.

use serde::{Deserialize, Serialize};

use super::camera::Camera;
use super::error::Error;

/// Paints a layer: straight (r, g, b, alpha) in linear light at a position in pitches.
pub type Paint<'a> = dyn Fn(f64, f64) -> [f32; 4] + Sync + 'a;

/// Where a layer has anything: left, top, right, bottom in pitches.
pub type Bounds = [f64; 4];

/// A layer before it is rasterised: a plane with a picture.
pub struct LayerSource<'a> {
    /// d0, gx, gy: disparity in pitches per sensor pixel of offset, and its slope per pitch.
    pub disparity: [f64; 3],
    /// Nothing is painted outside (`None`: the layer has no border).
    pub bounds: Option<Bounds>,
    /// The picture.
    pub paint: Box<Paint<'a>>,
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

/// A scene before it is rasterised.
#[derive(Default)]
pub struct SceneDescription<'a> {
    /// Front first; the last has no border and is opaque.
    pub layers: Vec<LayerSource<'a>>,
    /// Things whose place is known, bounds in pitches from the sensor's centre; a rasterised scene has them as shares.
    pub regions: Vec<Region>,
}

/// What a scene is drawn on, and how.
#[derive(Debug, Clone, Copy)]
pub struct Canvas {
    /// Half its width and height (x, y) in pitches.
    pub half: [f64; 2],
    /// Largest disparity, pitches per sensor pixel.
    pub disparity: f64,
    /// Seed of all randomness in the pictures.
    pub seed: u32,
}

impl Canvas {
    /// The canvas of `camera`'s sensor.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the disparity is not in −1..=1.
    pub fn new(camera: &Camera, disparity: f64, seed: u64) -> Result<Canvas, Error> {
        camera.check()?;
        if !(-1.0..=1.0).contains(&disparity) {
            return Err(Error::Parameter(format!(
                "the disparity must lie in -1..=1 pitches per step, not {disparity}"
            )));
        }
        let half = [
            camera.sensor.width as f64 / (2.0 * camera.lenslets.pitch),
            camera.sensor.height as f64 / (2.0 * camera.lenslets.pitch),
        ];
        Ok(Canvas { half, disparity, seed: (seed ^ (seed >> 32)) as u32 })
    }
}
