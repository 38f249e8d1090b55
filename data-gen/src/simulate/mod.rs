//! A scene of textured layers before a simulated lenslet camera: captures, white images, truth.
//!
//! A pixel at offset δ (sensor pixels) from the centre c of its lenslet sees the scene at c − d·δ, where d is the scene
//! point's disparity in sensor pixels per sensor pixel of offset. View (v, u) is the offset δ = (u, v)·view_step, so a
//! point at x in the central view is at x + D·u in view u, D = d·view_step·W_out/W in output pixels per view step.
//! The lenslet's own aperture low-passes what it sees: every layer is blurred by a Gaussian of [`Optics::footprint`]
//! pitches before the layers are composited. A true view is a scene seen from exactly one offset, averaged over the output
//! pixel; a sensor pixel also averages over the offsets within its own extent. There are two truths ([`ScenePair`]): the
//! sharp scene, what a camera without lenslets would see, and the blurred one, what lenslets gather.
//! What real optics do besides is switched on by [`Imperfections`].

mod camera;
mod capture;
mod chart;
mod description;
mod draw;
mod error;
mod imperfections;
mod jpeg;
mod layer;
mod lenslets;
mod micro_images;
mod options;
mod painting;
mod photo_scene;
mod pixels;
mod scene;
mod scene_name;
mod sensor;
mod texels;
mod training_scenes;
mod truth;
mod write;

pub use camera::{Camera, CameraIdentity, LensletGrid, LightProfile, Optics, SensorResponse};
pub use capture::{Simulation, capture_name, render_capture, render_capture_through};
pub use chart::{FREQUENCIES, PATCHES, WHITE};
pub use description::{Bounds, Canvas, LayerSource, Paint, Region, SceneDescription};
pub use error::Error;
pub use imperfections::Imperfections;
pub use jpeg::SavedMosaic;
pub use layer::Layer;
pub use lenslets::Lenslets;
pub use micro_images::{MicroImages, Seen};
pub use options::{SimulationOptions, TruthOptions};
pub use photo_scene::photo_scene;
pub use scene::{Scene, ScenePair};
pub use scene_name::{SceneName, SceneUse};
pub use sensor::{expose_white, record_mosaic, white_pattern};
pub use truth::{output_size, true_disparity, true_view, view_offset};
pub use write::write_simulation;
