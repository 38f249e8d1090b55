//! `lenslet simulate`: a capture with known truth, from a drawn scene or from photos.

use std::path::{Path, PathBuf};

use lenslet_core::container::CameraProfile;
use lenslet_core::geometry::Size;
use lenslet_core::output::{self, Kind};
use lenslet_data_gen::simulate::{
    self, Camera, Imperfections, LensletGrid, Optics, Scene, SceneName, ScenePair, SensorResponse, SimulationOptions,
    TruthOptions,
};
use serde_json::json;

use super::inputs::{Input, each};
use super::written::check_folder_name;
use super::{Context, Outcome, Usage};

/// Simulate a capture of a lenslet camera, with white images and the truth
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples: lenslet simulate --out sim
          lenslet simulate --scene chart --sensor 1640 --size 540 --noise 0 --out chart
          lenslet simulate --photo wall.jpg print.jpg --out photos
          lenslet simulate --camera lytro-illum --out illum
          lenslet simulate --optics pupil-shift=0.2,cats-eye,crosstalk --out worn
          lenslet simulate --optics real --out real

Writes capture.lfp (capture.lfr where the camera puts a white image into it, capture.jpg
with capture.json beside it with --optics jpeg), white-00.lfp ..., and truth/: centres.npy (N x 2: x, y of the micro-images in sensor pixels, pixel centres at integers), views/ (a light field, as lenslets gather the scene), sharp/ (the same without
lenslets), disparity.npy
(central view, output pixels per view step: a point at x in the central view is at x + D*u in view u), scene.json
(camera, scene, and where the charts' elements are).
A scene's detail is drawn in lenslet pitches, so a small sensor sees a smaller piece at the same detail.")]
pub struct Args {
    /// natural, planes, slanted, occluders, chart, colour, white or flat
    #[arg(long, default_value = "natural", value_name = "NAME", conflicts_with = "photo")]
    scene: SceneName,
    /// Photos instead: the first as background, the others as prints before it
    #[arg(long, value_name = "FILE", num_args = 1..)]
    photo: Vec<PathBuf>,
    /// Directory to write
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Replace the directory if it exists
    #[arg(long)]
    force: bool,
    /// Seed of lenslet errors, noise and pictures
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
    /// Camera profile (lytro-f01, lytro-illum, or a TOML file): sensor, filters, levels, lenslets, colours
    #[arg(long, default_value = "lytro-f01", value_name = "NAME")]
    camera: String,
    /// Sides of the sensor in pixels, even: N or WIDTHxHEIGHT [default: the camera's]
    #[arg(long, value_name = "N", value_parser = parse_sides)]
    sensor: Option<Size>,
    /// Longer side of the truth views in pixels
    #[arg(long, default_value_t = 1080, value_name = "N")]
    size: usize,
    /// Truth views a row and a column, odd
    #[arg(long, default_value_t = 7, value_name = "N")]
    views: usize,
    /// Sensor pixels between neighbouring views
    #[arg(value_parser = super::values::finite::<f64>, long, default_value_t = 1.0, value_name = "PIXELS")]
    view_step: f64,
    /// Largest disparity of the scene in lenslet pitches per sensor pixel [default: 0.3; chart 0.15; colour, flat, one
    /// photo 0]
    #[arg(value_parser = super::values::finite::<f64>, long, value_name = "D", allow_negative_numbers = true)]
    disparity: Option<f64>,
    /// Lenslet pitch in sensor pixels [default: the camera's]
    #[arg(value_parser = super::values::finite::<f64>, long, value_name = "PIXELS")]
    pitch: Option<f64>,
    /// Rotation of the lattice in radians, positive = clockwise on screen
    #[arg(value_parser = super::values::finite::<f64>, long, default_value_t = LensletGrid::default().rotation, value_name = "RADIANS", allow_negative_numbers = true)]
    rotation: f64,
    /// Row distance over its ideal [default: the camera's]
    #[arg(value_parser = super::values::finite::<f64>, long, value_name = "RATIO")]
    row_stretch: Option<f64>,
    /// Lenslet (0, 0) minus the sensor's centre, pixels
    #[arg(long, value_name = "X,Y", default_value = "2.37,-1.61", allow_hyphen_values = true, value_parser = parse_offset)]
    offset: [f64; 2],
    /// Standard deviation of each lenslet's own position error, pixels
    #[arg(value_parser = super::values::finite::<f64>, long, default_value_t = LensletGrid::default().jitter, value_name = "PIXELS")]
    jitter: f64,
    /// Light over a micro-image: parabolic or gaussian
    #[arg(long, value_enum, default_value = "parabolic", hide_possible_values = true)]
    profile: LightProfile,
    /// Share of the light the main lens loses in the corners
    #[arg(value_parser = super::values::finite::<f64>, long, default_value_t = Optics::default().vignetting, value_name = "SHARE", allow_negative_numbers = true)]
    vignetting: f64,
    /// Optical blur on the sensor (standard deviation), pixels
    #[arg(value_parser = super::values::finite::<f64>, long, default_value_t = Optics::default().psf, value_name = "PIXELS")]
    psf: f64,
    /// Noise: 0 none; 1 one electron a DN and 3 DN of read noise
    #[arg(value_parser = super::values::finite::<f64>, long, default_value_t = SimulationOptions::default().noise, value_name = "K", allow_negative_numbers = true)]
    noise: f64,
    /// Light of the scene as a share of a full exposure, 0.001..=1
    #[arg(value_parser = super::values::finite::<f64>, long, default_value_t = SensorResponse::default().exposure, value_name = "SHARE", allow_negative_numbers = true)]
    exposure: f64,
    /// White images
    #[arg(long, default_value_t = SimulationOptions::default().whites, value_name = "N")]
    whites: usize,
    /// What real optics and sensors do besides: a list of NAME or NAME=VALUE of pupil-shift (pitches in the corners;
    /// 0.1), cats-eye (half pitches in the corners; 0.5), white-shift (pupil shift of the white images over the
    /// capture's, pitches in the corners; 0.05), white-size (size of their micro-images over the capture's; 0.95),
    /// other-zoom (both), focal-spot (relative deviation of the lenslets' blur; 0.15), crosstalk (share to each
    /// neighbouring pixel; 0.01), saturation (share of full scale where the response bends; 0.8), jpeg (quality of the
    /// capture saved in 8 bits; 95); real: all, ideal: none
    #[arg(long, default_value = "ideal", value_name = "LIST")]
    optics: Imperfections,
}

/// Standard deviation of the Gaussian profile, radii of a micro-image.
/// Source: chosen.
const GAUSSIAN_SIGMA: f64 = 0.55;

/// `--profile`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum LightProfile {
    Parabolic,
    Gaussian,
}

/// `n` or `width x height`.
fn parse_sides(text: &str) -> Result<Size, String> {
    let side = |t: &str| t.parse().map_err(|_| format!("`{text}` is neither N nor WIDTHxHEIGHT"));
    match text.split_once('x') {
        Some((w, h)) => Ok(Size::new(side(w)?, side(h)?)),
        None => side(text).map(|n| Size::new(n, n)),
    }
}

/// `x,y` as two numbers.
fn parse_offset(text: &str) -> Result<[f64; 2], String> {
    let bad = || format!("`{text}` is not X,Y");
    let (x, y) = text.split_once(',').ok_or_else(bad)?;
    Ok([x.trim().parse().map_err(|_| bad())?, y.trim().parse().map_err(|_| bad())?])
}

/// Values out of range are wrong usage.
pub fn usage_or_failure(error: simulate::Error) -> anyhow::Error {
    match error {
        simulate::Error::Parameter(text) => Usage(text).into(),
        other => other.into(),
    }
}

impl Args {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> Vec<(&Path, Input)> {
        each(&self.photo, Input::PhotoFile).collect()
    }
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    let like = Camera::from_profile(&CameraProfile::find(&args.camera)?);
    let profile = match args.profile {
        LightProfile::Gaussian => simulate::LightProfile::Gaussian { sigma: GAUSSIAN_SIGMA },
        LightProfile::Parabolic => Optics::default().profile,
    };
    let camera = Camera {
        sensor: args.sensor.unwrap_or(like.sensor),
        lenslets: LensletGrid {
            pitch: args.pitch.unwrap_or(like.lenslets.pitch),
            rotation: args.rotation,
            row_stretch: args.row_stretch.unwrap_or(like.lenslets.row_stretch),
            offset: args.offset,
            jitter: args.jitter,
        },
        optics: Optics { profile, vignetting: args.vignetting, psf: args.psf, ..like.optics },
        response: SensorResponse { exposure: args.exposure, ..like.response },
        imperfections: args.optics.clone(),
        ..like
    };
    let options = SimulationOptions { seed: args.seed, noise: args.noise, whites: args.whites };
    let truth = TruthOptions { views: args.views, view_step: args.view_step, size: args.size };
    // Everything that can be refused is refused before the long work begins.
    camera.check().and_then(|()| options.check()).and_then(|()| truth.check()).map_err(usage_or_failure)?;
    let inputs: Vec<&Path> = args.photo.iter().map(PathBuf::as_path).collect();
    check_folder_name(&args.out)?;
    output::check_target(&args.out, Kind::Directory, args.force, &inputs)?;
    let observer = &context.progress;
    let scenes = ScenePair::draw(&camera, |camera| {
        if args.photo.is_empty() {
            Scene::named(args.scene, camera, args.disparity, args.seed, observer)
        } else {
            simulate::photo_scene(&args.photo, camera, args.disparity, args.seed, observer)
        }
    });
    let scenes = scenes.map_err(usage_or_failure)?;
    let scene = &scenes.gathered;
    let simulation = simulate::render_capture(scene, &camera, &options, observer).map_err(usage_or_failure)?;
    simulate::write_simulation(&args.out, &scenes, &camera, &options, &simulation, &truth, args.force, observer)
        .map_err(usage_or_failure)?;
    let out = args.out.display();
    let Size { width, height } = camera.sensor;
    let inside = simulation.capture.white.is_some();
    let name = simulate::capture_name(&camera);
    let next = if inside {
        format!("lenslet decode {out}/{name} --out {out}/views.lf")
    } else {
        format!("lenslet calibrate {out}/white-*.lfp --out {out}/camera.calib")
    };
    Ok(Outcome {
        text: format!(
            "{out}: scene {}, {width}x{height} sensor, {} lenslets, {} white images{}, {n}x{n} truth views\nnext: {next}",
            scene.name,
            simulation.centres.len(),
            simulation.whites.len(),
            if inside { " and one inside the capture" } else { "" },
            n = args.views,
        ),
        json: json!({
            "out": args.out,
            "capture": name,
            "scene": scene.name,
            "camera": args.camera,
            "sensor": [width, height],
            "lenslets": simulation.centres.len(),
            "whites": simulation.whites.len(),
            "white_inside": inside,
            "views": args.views,
            "largest_disparity": scene.disparity,
            "seed": args.seed,
        }),
    })
}
