//! What stands before the simulated camera of a run: a drawn scene, or photographs at depths.

use anyhow::Result;
use lenslet_core::progress::Observer;
use lenslet_data_gen::simulate::{self, Camera, Scene, SceneName, ScenePair};
use serde::{Serialize, Serializer};

use super::photos::{SCORED, write_photos};

/// What stands before the camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SimulatedScene {
    /// Drawn from formulas.
    Drawn(SceneName),
    /// Three photographs that no shipped dictionary was trained on, the background first; the seed says which is it.
    Photos,
}

impl SimulatedScene {
    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            SimulatedScene::Drawn(scene) => scene.name(),
            SimulatedScene::Photos => "photos",
        }
    }

    /// The scene under a seed, as lenslets gather it and sharp.
    ///
    /// # Errors
    /// As [`Scene::named`], or photographs that cannot be written.
    pub fn draw(self, camera: &Camera, seed: u64, observer: &dyn Observer) -> Result<ScenePair> {
        match self {
            SimulatedScene::Drawn(scene) => {
                Ok(ScenePair::draw(camera, |camera| Scene::named(scene, camera, None, seed, observer))?)
            }
            SimulatedScene::Photos => {
                let (mut files, _folder) = write_photos(&SCORED)?;
                let first = (seed % files.len() as u64) as usize;
                files.rotate_left(first);
                let draw = |camera: &Camera| simulate::photo_scene(&files, camera, None, seed, observer);
                Ok(ScenePair::draw(camera, draw)?)
            }
        }
    }
}

impl From<SceneName> for SimulatedScene {
    fn from(scene: SceneName) -> Self {
        SimulatedScene::Drawn(scene)
    }
}

impl Serialize for SimulatedScene {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}
