//! Scenes: what there is to see, as layers from front to back, each with its disparity.

use lenslet_core::progress::Observer;
use rayon::prelude::*;

use super::camera::Camera;
use super::description::{Bounds, Canvas, Region, SceneDescription};
use super::error::Error;
use super::layer::Layer;
use super::scene_name::SceneName;
use super::{chart, painting, training_scenes};

/// A rasterised scene, from which any view can be rendered.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Name, for the record.
    pub name: String,
    /// Largest disparity, pitches per sensor pixel.
    pub disparity: f64,
    /// Regions of known content.
    pub regions: Vec<Region>,
    /// Share of its light that the camera's exposure lets in.
    exposure: f32,
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

/// A scene twice: as lenslets see it, each gathering over its footprint, and as a camera would that has none.
#[derive(Debug, Clone)]
pub struct ScenePair {
    /// For captures.
    pub gathered: Scene,
    /// For the truth that multi-view and learned views are to reach.
    pub sharp: Scene,
}

impl ScenePair {
    /// Draws both; `draw` as [`Scene::named`] or [`photo_scene`](super::photo_scene()) for the camera it is given.
    ///
    /// ```
    /// use lenslet_core::progress::Silent;
    /// use lenslet_data_gen::simulate::{Camera, Scene, SceneName, ScenePair};
    ///
    /// let camera = Camera::with_sensor(120);
    /// let both = ScenePair::draw(&camera, |camera| Scene::named(SceneName::Planes, camera, None, 1, &Silent))?;
    /// assert_eq!(both.gathered.disparity, both.sharp.disparity);
    /// # Ok::<(), lenslet_data_gen::simulate::Error>(())
    /// ```
    ///
    /// # Errors
    /// Those of `draw`.
    pub fn draw<E>(camera: &Camera, draw: impl Fn(&Camera) -> Result<Scene, E>) -> Result<ScenePair, E> {
        Ok(ScenePair { gathered: draw(camera)?, sharp: draw(&camera.sharp())? })
    }
}

impl Scene {
    /// Draws the named scene for `camera`. `disparity`: the largest one in lenslet pitches per sensor pixel of offset
    /// (−1..=1; `None`: [`SceneName::default_disparity`]).
    ///
    /// # Errors
    /// [`Error::Parameter`] for values out of range, [`Error::Interrupted`] when the observer cancels.
    pub fn named(
        name: SceneName,
        camera: &Camera,
        disparity: Option<f64>,
        seed: u64,
        observer: &dyn Observer,
    ) -> Result<Scene, Error> {
        let disparity = disparity.unwrap_or(name.default_disparity());
        let canvas = Canvas::new(camera, disparity, seed)?;
        let description = match name {
            SceneName::Natural => painting::natural(&canvas),
            SceneName::Planes => painting::planes(&canvas),
            SceneName::Slanted => painting::slanted(&canvas),
            SceneName::Occluders => painting::occluders(&canvas),
            SceneName::Flat => painting::flat(&canvas),
            SceneName::White => chart::white(),
            SceneName::Chart => chart::resolution(&canvas),
            SceneName::Colour => chart::colour(&canvas),
            SceneName::Collage => training_scenes::collage(&canvas),
            SceneName::Thicket => training_scenes::thicket(&canvas),
        };
        Scene::from_description(name.name(), camera, &canvas, &description, observer)
    }

    /// Rasterises a description.
    ///
    /// # Errors
    /// As [`Scene::named`].
    pub fn from_description(
        name: &str,
        camera: &Camera,
        canvas: &Canvas,
        description: &SceneDescription,
        observer: &dyn Observer,
    ) -> Result<Scene, Error> {
        camera.check()?;
        if description.layers.len() > MOST_LAYERS {
            return Err(Error::Parameter(format!(
                "{} layers are too many: at most {MOST_LAYERS}",
                description.layers.len()
            )));
        }
        // A pixel of a lenslet at the rim reaches beyond the canvas by its disparity times its offset.
        let rim = canvas.disparity.abs() * camera.lenslets.pitch + 3.0;
        let extent: Bounds = [-canvas.half[0] - rim, -canvas.half[1] - rim, canvas.half[0] + rim, canvas.half[1] + rim];
        observer.begin("scene", description.layers.len() as u64);
        let mut layers = Vec::with_capacity(description.layers.len());
        for source in &description.layers {
            observer.check()?;
            layers.push(Layer::new(source, extent, camera.optics.footprint)?);
            observer.advance(1);
        }
        // Offsets within a lenslet, corners and blur included.
        let reach = 0.75 * camera.lenslets.pitch + 4.0;
        let across = ((extent[2] - extent[0]) / CELL).ceil() as usize;
        let down = ((extent[3] - extent[1]) / CELL).ceil() as usize;
        let mut cells = vec![0u32; across * down];
        cells.par_iter_mut().enumerate().for_each(|(k, cell)| {
            let (x, y) = (extent[0] + (k % across) as f64 * CELL, extent[1] + (k / across) as f64 * CELL);
            for (n, layer) in layers.iter().enumerate() {
                *cell |= u32::from(layer.reaches([x, y, x + CELL, y + CELL], reach)) << n;
            }
        });
        let share = |value: f64, axis: usize| (value + canvas.half[axis]) / (2.0 * canvas.half[axis]);
        let regions = description.regions.iter().map(|region| {
            let [left, top, right, bottom] = region.bounds;
            Region { bounds: [share(left, 0), share(top, 1), share(right, 0), share(bottom, 1)], ..region.clone() }
        });
        Ok(Scene {
            name: name.to_owned(),
            disparity: canvas.disparity,
            regions: regions.collect(),
            exposure: camera.response.exposure as f32,
            pitch: camera.lenslets.pitch,
            centre: [(camera.sensor.width as f64 - 1.0) / 2.0, (camera.sensor.height as f64 - 1.0) / 2.0],
            layers,
            cells,
            across,
            corner: [extent[0], extent[1]],
            reach,
        })
    }

    /// Linear sRGB, as exposed, seen at sensor position (`x`, `y`) under offset `delta` (sensor pixels from the lenslet
    /// centre).
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
        seen.map(|light| self.exposure * light)
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

#[cfg(test)]
mod tests {
    use lenslet_core::geometry::Size;

    use lenslet_core::progress::Silent;

    use super::*;
    use crate::simulate::SensorResponse;

    fn camera() -> Camera {
        Camera { sensor: Size::new(300, 260), ..Camera::default() }
    }

    #[test]
    fn leaving_out_hidden_layers_changes_nothing() {
        for name in SceneName::ALL {
            let scene = Scene::named(name, &camera(), Some(0.3), 5, &Silent).unwrap();
            let mut all = scene.clone();
            all.reach = -1.0;
            for k in 0..3000u32 {
                let (x, y) = (f64::from(k % 61) * 5.0 - 1.0, f64::from(k / 61) * 5.5 - 1.0);
                let delta = [f64::from(k % 7) - 3.0, f64::from(k % 5) * 1.5 - 3.0];
                let (fast, plain) = (scene.sample(x, y, delta), all.sample(x, y, delta));
                assert!(fast.iter().zip(&plain).all(|(a, b)| (a - b).abs() < 1e-5), "{name:?} {fast:?} {plain:?}");
            }
        }
    }

    #[test]
    fn every_scene_is_opaque_within_its_range_and_follows_the_seed() {
        for name in SceneName::ALL {
            let make = |seed| Scene::named(name, &camera(), None, seed, &Silent).unwrap();
            let (scene, again, other) = (make(5), make(5), make(6));
            let mut differs = false;
            for k in 0..2000u32 {
                let (x, y) = (f64::from(k % 50) * 6.0, f64::from(k / 50) * 6.5);
                let seen = scene.sample(x, y, [2.0, -1.0]);
                assert!(seen.iter().all(|v| (0.0..=0.96).contains(v)), "{name:?} {seen:?}");
                assert_eq!(seen, again.sample(x, y, [2.0, -1.0]));
                differs |= seen != other.sample(x, y, [2.0, -1.0]);
            }
            assert_eq!(differs, !matches!(name, SceneName::White | SceneName::Chart | SceneName::Colour), "{name:?}");
        }
    }

    #[test]
    fn a_point_moves_by_its_disparity_from_view_to_view() {
        // What view u shows at x + d·u is what the central view shows at x, wherever nothing hides it.
        let camera = camera();
        for name in [SceneName::Flat, SceneName::Slanted, SceneName::Planes, SceneName::Natural] {
            let scene = Scene::named(name, &camera, Some(0.2), 5, &Silent).unwrap();
            let (mut same, mut all) = (0, 0);
            for k in 0..2500u32 {
                let (x, y) = (30.0 + f64::from(k % 50) * 4.8, 30.0 + f64::from(k / 50) * 4.0);
                let d = scene.disparity(x, y, [0.0; 2]);
                let (a, b) = (scene.sample(x, y, [0.0; 2]), scene.sample(x + 2.0 * d, y - 3.0 * d, [2.0, -3.0]));
                all += 1;
                same += usize::from(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 0.01));
            }
            let needed = if matches!(name, SceneName::Flat | SceneName::Slanted) { 1.0 } else { 0.6 };
            assert!(same as f64 >= needed * f64::from(all), "{name:?}: {same} of {all}");
        }
    }

    #[test]
    fn exposure_is_a_share_of_the_light() {
        let response = SensorResponse { exposure: 0.25, ..SensorResponse::default() };
        let full = Scene::named(SceneName::Natural, &camera(), None, 5, &Silent).unwrap();
        let dark = Scene::named(SceneName::Natural, &Camera { response, ..camera() }, None, 5, &Silent).unwrap();
        for k in 0..100u32 {
            let (x, y) = (3.0 * f64::from(k), 2.5 * f64::from(k));
            assert_eq!(dark.sample(x, y, [1.0, 2.0]), full.sample(x, y, [1.0, 2.0]).map(|v| 0.25 * v));
        }
    }

    #[test]
    fn wrong_values_are_refused() {
        for disparity in [2.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(
                Scene::named(SceneName::Flat, &camera(), Some(disparity), 1, &Silent),
                Err(Error::Parameter(_))
            ));
        }
        assert!("nothing".parse::<SceneName>().is_err() && "natural".parse() == Ok(SceneName::Natural));
    }
}
