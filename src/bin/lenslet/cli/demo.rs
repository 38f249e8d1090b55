//! `lenslet demo`: simulates a capture, calibrates, decodes, runs every method, scores them against the sharp
//! simulated truth.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::report::EmbeddedPicture;
use crate::report::embedded::{self, Crop};
use anyhow::Context as _;
use lenslet_core::calibration;
use lenslet_core::decode::{self, HexSamples};
use lenslet_core::dictionary::Footprint;
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::{ColourSpace, View, colour};
use lenslet_core::metrics::{BORDER, Scores, Window};
use lenslet_core::output::{self, Pending};
use lenslet_core::progress::Observer;
use lenslet_data_gen::simulate::{
    self, Camera, Lenslets, Scene, SceneName, ScenePair, SimulationOptions, TruthOptions,
};
use lenslet_views::reconstruct;
use lenslet_views::{InterpolatedViews, LearnedViews};
use ndarray::{Array3, Axis};
use serde_json::{Value, json};

use super::{Context, Outcome, Usage};
use results::{CROPS, Calibrated, Reconstruction, SCORED, Simulated, VIEWS, mean};

mod page;
mod play;
mod results;

/// Show everything on a simulated capture: no input needed
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet demo --out lenslet-demo

Simulates a capture with its white images, calibrates from these, decodes 7x7 views, reconstructs them by every method,
scores each against the sharp truth, and makes a page to refocus and look around in. Writes report.html, viewer.html,
comparison.png, refocus.png, pictures/, camera.calib and simulated/.")]
pub struct Args {
    /// Directory to write
    #[arg(long, default_value = "lenslet-demo", value_name = "DIR")]
    out: PathBuf,
    /// Longer side of the views in pixels; the sensor is 3.04 times as wide, as in the camera
    #[arg(long, default_value_t = 540, value_name = "N")]
    size: usize,
    /// Seed of the simulation
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
    /// Replace the directory if it exists
    #[arg(long)]
    force: bool,
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    if !(128..=2160).contains(&args.size) {
        return Err(Usage(format!("--size must lie in 128..=2160, not {}", args.size)).into());
    }
    super::written::check_folder_name(&args.out)?;
    let pending = Pending::directory(&args.out, args.force)?;
    let root = pending.path().to_path_buf();
    let observer = &context.progress;
    let began = Instant::now();

    let camera = Camera::with_sensor(2 * (args.size * 3280 / 1080).div_ceil(2));
    let options = SimulationOptions { seed: args.seed, ..SimulationOptions::default() };
    let draw = |camera: &Camera| Scene::named(SceneName::Natural, camera, None, args.seed, observer);
    let scenes = ScenePair::draw(&camera, draw).map_err(super::simulate::usage_or_failure)?;
    let simulation = simulate::render_capture(&scenes.gathered, &camera, &options, observer)
        .map_err(super::simulate::usage_or_failure)?;
    let size = simulate::output_size(&camera, args.size);
    let truth_options = TruthOptions { views: VIEWS, view_step: 1.0, size: args.size };
    simulate::write_simulation(
        &root.join("simulated"),
        &scenes,
        &camera,
        &options,
        &simulation,
        &truth_options,
        false,
        observer,
    )
    .map_err(super::simulate::usage_or_failure)?;
    let truth: Vec<_> = SCORED
        .iter()
        .map(|&(v, u)| {
            let mut view = simulate::true_view(&scenes.sharp, &camera, simulate::view_offset([v, u], VIEWS, 1.0), size);
            colour::convert(&mut view, ColourSpace::Linear, ColourSpace::Srgb);
            view
        })
        .collect();
    let seconds = began.elapsed().as_secs_f64();
    let made = Simulated { size: args.size, seed: args.seed, camera, seconds };

    let calibrated = calibrate(&simulation, &made.camera, args.seed, observer)?;
    calibration::save(&root.join("camera.calib"), &calibrated.found, false)?;
    let samples = decode::sample_views(&simulation.capture, &calibrated.found, &decode::Options::default(), observer)?;
    let mut results = reconstruct(&samples, &size, observer)?;
    for result in &mut results {
        result.scores = result.views.iter().zip(&truth).map(|(a, b)| score(a, b)).collect::<anyhow::Result<_>>()?;
    }
    observer.check()?;
    write_pictures(&root, &results, &truth[0])?;
    let played = play::write(&root, &samples, &size, observer)?;
    let seconds = began.elapsed().as_secs_f64();
    let json = record(args, &calibrated, &results, seconds);
    let page = page::page(&made, &calibrated, &results, &truth[0], &played)?;
    output::write_file(&root.join("report.html"), false, page.as_bytes())?;
    output::write_file(&root.join("scores.json"), false, serde_json::to_string_pretty(&json)?.as_bytes())?;
    pending.commit()?;
    Ok(Outcome { json, text: summary(args, &calibrated, &results, seconds) })
}

fn calibrate(
    simulation: &simulate::Simulation,
    camera: &Camera,
    seed: u64,
    observer: &dyn Observer,
) -> anyhow::Result<Calibrated> {
    let began = Instant::now();
    let found = calibration::calibrate(&simulation.whites, &calibration::CalibrationOptions::default(), observer)?;
    let lenslets = Lenslets::new(camera, seed).map_err(super::simulate::usage_or_failure)?;
    let squares: f64 = found.lenslets.iter().map(|l| lenslets.nearest(l.x, l.y).1).sum();
    let rms = (squares / found.lenslets.len().max(1) as f64).sqrt();
    Ok(Calibrated { truth: simulation.centres.len(), rms, seconds: began.elapsed().as_secs_f64(), found })
}

/// The report's description of each interpolation.
const INTERPOLATIONS: [(Interpolation, &str); 4] = [
    (Interpolation::Bicubic, "low-resolution grid, then bicubic (paper 4.1)"),
    (Interpolation::Barycentric, "on the triangulated lenslets (paper 4.2)"),
    (Interpolation::Cubic, "smooth surface through the same samples"),
    (Interpolation::Multiview, "samples of all views at their true places (paper 4.3)"),
];

/// What `decode --method learned` runs, as earlier versions named it in `scores.json`, and the row it is.
const EARLIER_NAMES: [(&str, &str); 2] = [("learned", "LASSO"), ("learned on multiview", "network on multiview")];

/// Every method on the scored views.
fn reconstruct(samples: &HexSamples, target: &Size, observer: &dyn Observer) -> anyhow::Result<Vec<Reconstruction>> {
    let mut results = Vec::new();
    let mut low: Vec<(Interpolation, Vec<View>)> = Vec::new();
    for (interpolation, about) in INTERPOLATIONS {
        let began = Instant::now();
        let mut views = Vec::new();
        let prepared = InterpolatedViews::prepare(samples, interpolation, target, observer)?;
        let mut keep = |_: usize, _: usize, view: View| -> anyhow::Result<()> {
            views.push(view);
            Ok(())
        };
        prepared.render_views(&SCORED, &mut keep, observer)?;
        results.push(Reconstruction::interpolated(interpolation, about, &views, began));
        low.push((interpolation, views));
    }
    for interpolation in [Interpolation::Barycentric, Interpolation::Multiview] {
        let dictionary = reconstruct::embedded_dictionary_for(interpolation)?;
        // The truth is sharp, of which a sample is the mean over its lenslet.
        let footprint = Footprint::Lenslet;
        let predictors =
            dictionary.model(footprint).context("an embedded dictionary is empty")?.patch_model.predictors();
        for predictor in predictors {
            let began = Instant::now();
            let mode = reconstruct::Mode::Only(predictor);
            let options = reconstruct::Options { mode, footprint, ..reconstruct::Options::default() };
            let prepared = LearnedViews::prepare(samples, interpolation, target, &dictionary, &options, observer)?;
            observer.begin(predictor.name(), SCORED.len() as u64);
            let mut views = Vec::new();
            for (view, (v, u)) in low.iter().filter(|l| l.0 == interpolation).flat_map(|l| &l.1).zip(SCORED) {
                observer.check()?;
                views.push(prepared.reconstruct_view(view, v, u)?);
                observer.advance(1);
            }
            results.push(Reconstruction::learned(interpolation, predictor, &views, began));
        }
    }
    Ok(results)
}

fn score(result: &Array3<f32>, truth: &Array3<f32>) -> anyhow::Result<Scores> {
    Scores::between(result.view(), truth.view(), &Window::without_border(BORDER)).context("the views cannot be scored")
}

/// `pictures/NAME.png` of the central view of every method and of the truth, and the strip of crops.
fn write_pictures(root: &Path, results: &[Reconstruction], truth: &Array3<f32>) -> anyhow::Result<()> {
    for (name, view) in results.iter().map(|r| (r.name.as_str(), &r.views[0])).chain([("truth", truth)]) {
        let file: String = name.chars().map(|c| if c == ' ' { '-' } else { c }).collect();
        output::write_file(
            &root.join("pictures").join(format!("{file}.png")),
            false,
            &EmbeddedPicture::png(view, 1)?.bytes,
        )?;
    }
    let strip_of = ["bicubic", "barycentric", "LASSO", "multiview", "network on multiview"];
    let in_strip = results.iter().filter(|r| strip_of.contains(&r.name.as_str()));
    let shown: Vec<_> = in_strip.map(|r| (r.name.as_str(), &r.views[0])).collect();
    let side = (truth.dim().0 / 5).clamp(24, 80);
    let mut rows = Vec::new();
    for (k, (_, x, y)) in CROPS.into_iter().enumerate().filter(|(k, _)| [0, 2].contains(k)) {
        let crop = Crop::about(truth.dim(), x, y, side, side);
        let cut = |name: &str, view: &Array3<f32>| {
            (if k == 0 { name.to_owned() } else { String::new() }, embedded::enlarge(&crop.of(view), 3))
        };
        let all: Vec<_> = shown.iter().map(|(name, view)| cut(name, view)).chain([cut("truth", truth)]).collect();
        rows.push(embedded::captioned_strip(&all, 6, 12 * usize::from(k == 0) + 3 * usize::from(k != 0))?);
    }
    let views: Vec<_> = rows.iter().map(|r| r.view()).collect();
    let strip = ndarray::concatenate(Axis(0), &views)?;
    output::write_file(&root.join("comparison.png"), false, &EmbeddedPicture::png(&strip, 1)?.bytes)?;
    Ok(())
}

fn record(args: &Args, calibrated: &Calibrated, results: &[Reconstruction], seconds: f64) -> Value {
    let value_of = |r: &Reconstruction| {
        let centre = r.scores[0];
        let mut value = json!({
            "psnr_rgb": centre.psnr_rgb, "psnr_y": centre.psnr_y, "ssim_y": centre.ssim_y,
            "psnr_y_five_views": mean(&r.scores, |s| s.psnr_y), "ssim_y_five_views": mean(&r.scores, |s| s.ssim_y),
            "seconds": r.seconds,
        });
        if let Some(predictor) = r.predictor {
            value["predictor"] = predictor.name().into();
        }
        value
    };
    let mut methods: serde_json::Map<_, _> = results.iter().map(|r| (r.name.clone(), value_of(r))).collect();
    for (earlier, row) in EARLIER_NAMES {
        methods.extend(results.iter().find(|r| r.name == row).map(|r| (earlier.to_owned(), value_of(r))));
    }
    let lattice = &calibrated.found.lattice;
    json!({
        "out": args.out,
        "size": args.size,
        "seed": args.seed,
        "calibration": {
            "pitch": lattice.pitch(), "rotation": lattice.rotation(), "row_stretch": lattice.row_stretch(),
            "lenslets": calibrated.found.lenslets.len(), "true_lenslets": calibrated.truth, "centre_rms": calibrated.rms,
        },
        "methods": methods,
        "seconds": seconds,
    })
}

fn summary(args: &Args, calibrated: &Calibrated, results: &[Reconstruction], seconds: f64) -> String {
    let mut text = format!(
        "calibrated {} lenslets, pitch {:.4} px, centres {:.3} px RMS from the truth\n\n{:<24}{:>9}{:>9}{:>8}\n",
        calibrated.found.lenslets.len(),
        calibrated.found.lattice.pitch(),
        calibrated.rms,
        "centre view",
        "PSNR RGB",
        "PSNR Y",
        "SSIM Y"
    );
    for r in results {
        let s = r.scores[0];
        let _ = writeln!(text, "{:<24}{:>9.2}{:>9.2}{:>8.4}", r.name, s.psnr_rgb, s.psnr_y, s.ssim_y);
    }
    let page = |name: &str| args.out.join(name).display().to_string();
    let _ = write!(text, "\n{seconds:.0} s; look at {}, play with {}", page("report.html"), page(play::PAGE));
    text
}
