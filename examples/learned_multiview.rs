//! What learned reconstruction adds to multi-view refinement, in every view of simulated captures:
//! `cargo run --release --example learned_multiview -- [--dictionary FILE] [--mode MODE] [--seed N] [--noise S] [--sensor N] [SCENE…]`
//!
//! Each scene (default: natural, chart, occluders, planes; none is trained on) is captured by a simulated camera (`--sensor`
//! pixels wide, noise as in `simulate`), calibrated, decoded, refined and reconstructed as
//! `decode --method learned --base multiview` does it, and every view compared with the sharp truth. Prints one JSON object: PSNR
//! (dB, sRGB-encoded, 12 pixels of border left out) of colour and of luminance, before and after, of the centre view; the
//! mean, the least and the view of the least gain over all views; which predictor made it; and the centre view by cubic
//! interpolation and by every predictor of the dictionary, no codes among them.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Parser as _;
use lenslet_core::calibration;
use lenslet_core::decode;
use lenslet_core::dictionary::{self, Dictionary};
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::{ColourSpace, View, colour};
use lenslet_core::metrics::{BORDER, Scores, Window};
use lenslet_core::progress::Silent;
use lenslet_data_gen::simulate::{self, Camera, Scene, SceneName, ScenePair, SceneUse, SimulationOptions};
use lenslet_views::reconstruct::{self, Mode, Options};
use lenslet_views::{LearnedViews, RenderSamples as _};
use ndarray::Array3;
use serde_json::{Map, Value, json};

const VIEWS: usize = 7;

/// What learned reconstruction adds to multi-view refinement
#[derive(clap::Parser)]
struct Arguments {
    /// Dictionary file (default: the embedded one for refined views)
    #[arg(long)]
    dictionary: Option<PathBuf>,
    /// learned, fast, best, lasso, network, anchored, ridge or no-codes
    #[arg(long, default_value = "learned", value_parser = parse_mode)]
    mode: Mode,
    /// Seed of camera, scene and noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Strength of the noise, as in `simulate`
    #[arg(long, default_value_t = SimulationOptions::default().noise)]
    noise: f64,
    /// Side of the sensor, pixels
    #[arg(long, default_value_t = 1144)]
    sensor: usize,
    /// Scenes that nothing is trained on
    #[arg(value_parser = parse_scene, default_values = ["natural", "chart", "occluders", "planes"])]
    scenes: Vec<SceneName>,
}

fn parse_mode(name: &str) -> Result<Mode, String> {
    let names = || Mode::all().map(Mode::name).collect::<Vec<_>>().join(", ");
    Mode::all().find(|m| m.name() == name).ok_or_else(names)
}

fn parse_scene(name: &str) -> Result<SceneName, String> {
    let scene: SceneName = name.parse()?;
    match scene.scene_use() {
        SceneUse::Scoring => Ok(scene),
        SceneUse::Training => Err(format!("dictionaries are trained on the scene {name}: nothing is scored on it")),
    }
}

/// PSNR of colour and of luminance.
fn scores(view: &View, truth: &Array3<f32>) -> anyhow::Result<[f64; 2]> {
    let scores = Scores::between(view.encode().pixels().view(), truth.view(), &Window::without_border(BORDER))?;
    Ok([scores.psnr_rgb, scores.psnr_y])
}

fn scored(kind: SceneName, a: &Arguments, dictionary: &Dictionary) -> anyhow::Result<Value> {
    // Another camera for every seed, as in `ablate`.
    let camera = Camera::with_sensor(a.sensor).perturbed(a.seed);
    let scenes = ScenePair::draw(&camera, |camera| Scene::named(kind, camera, None, a.seed, &Silent))?;
    let options = SimulationOptions { seed: a.seed, noise: a.noise, whites: 2 };
    let simulation = simulate::render_capture(&scenes.gathered, &camera, &options, &Silent)?;
    let size = simulate::output_size(&camera, (a.sensor * 1080 + 1640) / 3280);
    let calibration = calibration::calibrate(&simulation.whites, &calibration::CalibrationOptions::default(), &Silent)?;
    let samples = decode::sample_views(&simulation.capture, &calibration, &decode::Options::default(), &Silent)?;

    let target = size;
    let options = Options { mode: a.mode, ..Options::default() };
    let interpolation = Interpolation::Multiview;
    let learned = LearnedViews::prepare(&samples, interpolation, &target, dictionary, &options, &Silent)?;

    let cubic = samples.renderer(Interpolation::Cubic).size(target).prepare()?;
    let predictors = dictionary.model(options.footprint).context("no model")?.patch_model.predictors();
    let others = predictors.map(|p| {
        let options = Options { mode: Mode::Only(p), ..Options::default() };
        Ok((p, LearnedViews::prepare(&samples, interpolation, &target, dictionary, &options, &Silent)?))
    });
    let others = others.collect::<anyhow::Result<Vec<_>>>()?;
    let mut methods = Map::new();
    let mut gains: Vec<((usize, usize), [f64; 2])> = Vec::new();
    let mut centre = Value::Null;
    let mut each = |v: usize, u: usize, view: View| -> anyhow::Result<()> {
        let mut truth = simulate::true_view(&scenes.sharp, &camera, simulate::view_offset([v, u], VIEWS, 1.0), size);
        colour::convert(&mut truth, ColourSpace::Linear, ColourSpace::Srgb);
        let sharp = learned.reconstruct_view(&view, v, u)?;
        let (before, after) = (scores(&view, &truth)?, scores(&sharp, &truth)?);
        if (v, u) == (VIEWS / 2, VIEWS / 2) {
            let pair = |k: usize| json!({ "multiview": before[k], "learned": after[k], "gain": after[k] - before[k] });
            centre = json!({ "rgb": pair(0), "y": pair(1) });
            let mut add = |name: &str, [rgb, y]: [f64; 2]| methods.insert(name.into(), json!({ "rgb": rgb, "y": y }));
            add("cubic", scores(&cubic.view(v, u)?, &truth)?);
            for (predictor, by) in &others {
                add(predictor.name(), scores(&by.reconstruct_view(&view, v, u)?, &truth)?);
            }
        }
        gains.push(((v, u), [after[0] - before[0], after[1] - before[1]]));
        Ok(())
    };
    samples.renderer(interpolation).size(target).prepare()?.render_all(&mut each)?;
    let over = |k: usize| -> anyhow::Result<Value> {
        let least = gains.iter().min_by(|a, b| a.1[k].total_cmp(&b.1[k])).context("no view")?;
        let mean = gains.iter().map(|g| g.1[k]).sum::<f64>() / gains.len() as f64;
        Ok(json!({ "mean": mean, "least": least.1[k], "of_view": [least.0.0, least.0.1] }))
    };
    Ok(json!({
        "predictor": learned.plan().to_string(), "centre": centre, "methods": methods,
        "gain": { "rgb": over(0)?, "y": over(1)? },
    }))
}

#[allow(clippy::print_stdout)]
fn main() -> anyhow::Result<()> {
    let a = Arguments::parse();
    let dictionary = match &a.dictionary {
        Some(file) => dictionary::load(file)?,
        None => reconstruct::embedded_dictionary_for(Interpolation::Multiview)?,
    };
    let mut out = Map::new();
    for &kind in &a.scenes {
        out.insert(kind.name().into(), scored(kind, &a, &dictionary)?);
    }
    println!("{}", Value::Object(out));
    Ok(())
}
