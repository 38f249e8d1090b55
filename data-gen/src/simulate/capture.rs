//! A simulated capture: the scene and its white images through one camera.

use lenslet_core::container::{CameraFacts, Capture, Levels, MlaHint, RawMosaic};
use lenslet_core::progress::Observer;

use super::camera::Camera;
use super::error::Error;
use super::jpeg::{SavedMosaic, save_as_jpeg};
use super::lenslets::Lenslets;
use super::micro_images::MicroImages;
use super::options::SimulationOptions;
use super::pixels::disturb_signal;
use super::scene::Scene;
use super::sensor::{expose_scene, expose_white, light_pattern, record_mosaic, white_pattern};

/// A capture with its white images and its true lenslet centres.
#[derive(Debug, Clone)]
pub struct Simulation {
    /// The capture of the scene.
    pub capture: Capture,
    /// White images of the same camera, without the one that the capture carries.
    pub whites: Vec<Capture>,
    /// True centres (x, y) of the capture's micro-images on the sensor, row by row: those of the lenslets, moved by
    /// the pupil shift where there is one.
    pub centres: Vec<[f64; 2]>,
    /// The files of a capture that was saved as JPEG.
    pub jpeg: Option<SavedMosaic>,
}

/// Takes a capture of `scene` and the white images.
///
/// # Errors
/// [`Error::Parameter`] for values out of range, [`Error::Interrupted`].
pub fn render_capture(
    scene: &Scene,
    camera: &Camera,
    options: &SimulationOptions,
    observer: &dyn Observer,
) -> Result<Simulation, Error> {
    render_capture_through(scene, camera, &Lenslets::new(camera, options.seed)?, options, observer)
}

/// As [`render_capture`], with lenslets that need not lie where the camera's own would.
///
/// # Errors
/// As [`render_capture`].
pub fn render_capture_through(
    scene: &Scene,
    camera: &Camera,
    lenslets: &Lenslets,
    options: &SimulationOptions,
    observer: &dyn Observer,
) -> Result<Simulation, Error> {
    options.check()?;
    camera.check()?;
    let images = MicroImages::of_capture(camera, lenslets);
    let pattern = light_pattern(&images);
    let signal = disturb_signal(expose_scene(&images, scene, &pattern, observer)?, camera);
    let mut capture = with_facts(camera, record_mosaic(&signal, camera, options.noise, options.seed, 0), false);
    let jpeg = camera.imperfections.jpeg.map(|quality| save_as_jpeg(&mut capture, quality)).transpose()?;
    let other_zoom = camera.imperfections.white_shift != 0.0 || camera.imperfections.white_size != 1.0;
    let pattern = if other_zoom { white_pattern(camera, lenslets) } else { pattern };
    let white = disturb_signal(expose_white(camera, &pattern), camera);
    let mut whites: Vec<Capture> = (0..options.whites)
        .map(|k| with_facts(camera, record_mosaic(&white, camera, options.noise, options.seed, k as u32 + 1), true))
        .collect();
    if camera.identity.white_inside && !whites.is_empty() {
        capture.white = Some(Box::new(whites.remove(0)));
    }
    Ok(Simulation { capture, whites, centres: images.centres_on_sensor(), jpeg })
}

/// A mosaic with the facts a camera writes beside it.
fn with_facts(camera: &Camera, mosaic: RawMosaic, white: bool) -> Capture {
    let response = camera.response.white_response.map(|r| (r / camera.response.white_response[1]) as f32);
    let grid = &camera.lenslets;
    Capture {
        mosaic,
        cfa: camera.response.cfa,
        levels: Levels {
            black: [f32::from(camera.response.levels[0]); 4],
            white: [f32::from(camera.response.levels[1]); 4],
        },
        colour: camera.response.colour.clone(),
        camera: CameraFacts {
            make: Some("Lytro, Inc.".to_owned()),
            model: Some(camera.identity.model.clone()),
            serial: Some("SIMULATED".to_owned()),
            zoom_step: Some(600),
            focus_step: Some(500),
            iso: Some(100.0),
            exposure_seconds: Some(0.01),
            exposure_bias: Some(if white { 0.0 } else { camera.identity.exposure_bias }),
            normalized_response: white.then_some([response[0], response[1], response[1], response[2]]),
            white_ref: None,
        },
        mla: Some(MlaHint { pitch: grid.pitch, rotation: grid.rotation, row_stretch: grid.row_stretch }),
        source_sha256: String::new(),
        jpeg: false,
        white: None,
        warnings: Vec::new(),
    }
}

/// What the capture's file is called: captures that carry their white image are called `.lfr`, those saved as JPEG
/// `.jpg`.
pub fn capture_name(camera: &Camera) -> &'static str {
    match (camera.identity.white_inside, camera.imperfections.jpeg) {
        (true, _) => "capture.lfr",
        (false, Some(_)) => "capture.jpg",
        (false, None) => "capture.lfp",
    }
}
