//! `lenslet demo`: simulates a capture, calibrates, decodes, runs every method, scores them against the simulated truth.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::report::embedded::{self, Crop};
use crate::report::{EmbeddedPicture, Page, Stage, Table, plot};
use anyhow::Context as _;
use lenslet_core::calibration::{self, Calibration};
use lenslet_core::decode::{self, HexSamples};
use lenslet_core::dictionary::Interpolation;
use lenslet_core::lightfield::{ColourSpace, View, colour};
use lenslet_core::metrics::{BORDER, Scores, Window};
use lenslet_core::output::{self, Pending};
use lenslet_core::progress::Observer;
use lenslet_data_gen::simulate::{self, Camera, Kind, Lenslets, Options, Scene, Truth};
use lenslet_views::reconstruct;
use lenslet_views::{InterpolatedViews, LearnedViews, Target};
use ndarray::{Array3, Axis};
use serde_json::{Value, json};

use super::{Context, Outcome, Usage};

mod play;

/// Show everything on a simulated capture: no input needed
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet demo --out lenslet-demo

Simulates a capture with its white images, calibrates from these, decodes 7x7 views, reconstructs them by every method,
scores each against the simulated truth, and makes a page to refocus and look around in. Writes report.html, viewer.html,
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

/// Views a side, and those that are scored (row, column): the centre and the corners.
const VIEWS: usize = 7;
const SCORED: [(usize, usize); 5] = [(3, 3), (0, 0), (0, 6), (6, 0), (6, 6)];
/// Crops shown: name and middle as shares of the picture.
const CROPS: [(&str, f64, f64); 4] =
    [("star", 0.33, 0.27), ("letters", 0.19, 0.49), ("leaves", 0.72, 0.18), ("fruit and wall", 0.6, 0.67)];

/// One method's views, sRGB-encoded, in the order of [`SCORED`].
struct Reconstruction {
    name: &'static str,
    about: &'static str,
    views: Vec<Array3<f32>>,
    seconds: f64,
    scores: Vec<Scores>,
}

impl Reconstruction {
    fn new(name: &'static str, about: &'static str, views: &[View], began: Instant) -> Self {
        let seconds = began.elapsed().as_secs_f64();
        let views = views.iter().map(|view| view.encode().into_pixels()).collect();
        Reconstruction { name, about, views, seconds, scores: Vec::new() }
    }
}

/// What calibration found beside what is true.
struct Calibrated {
    found: Calibration,
    truth: usize,
    rms: f64,
    seconds: f64,
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    if !(128..=2160).contains(&args.size) {
        return Err(Usage(format!("--size must lie in 128..=2160, not {}", args.size)).into());
    }
    let pending = Pending::directory(&args.out, args.force)?;
    let root = pending.path().to_path_buf();
    let observer = &context.progress;
    let began = Instant::now();

    let camera = Camera::with_sensor(2 * (args.size * 3280 / 1080).div_ceil(2));
    let options = Options { seed: args.seed, ..Options::default() };
    let scene =
        Scene::named(Kind::Natural, &camera, None, args.seed, observer).map_err(super::simulate::usage_or_failure)?;
    let simulation =
        simulate::render(&scene, &camera, &options, observer).map_err(super::simulate::usage_or_failure)?;
    let size = simulate::output_size(&camera, args.size);
    let truth_options = Truth { views: VIEWS, view_step: 1.0, size: args.size };
    simulate::write(&root.join("simulated"), &scene, &camera, &options, &simulation, &truth_options, false, observer)
        .map_err(super::simulate::usage_or_failure)?;
    let truth: Vec<_> = SCORED
        .iter()
        .map(|&(v, u)| {
            let mut view = simulate::view(&scene, &camera, simulate::offset([v, u], VIEWS, 1.0), size);
            colour::convert(&mut view, ColourSpace::Linear, ColourSpace::Srgb);
            view
        })
        .collect();
    let simulated = began.elapsed().as_secs_f64();

    let calibrated = calibrate(&simulation, &camera, args.seed, observer)?;
    calibration::save(&root.join("camera.calib"), &calibrated.found, false)?;
    let samples = decode::samples(&simulation.capture, &calibrated.found, &decode::Options::default(), observer)?;
    let mut results = reconstruct(&samples, &Target { width: size.0, height: size.1 }, observer)?;
    for result in &mut results {
        result.scores = result.views.iter().zip(&truth).map(|(a, b)| score(a, b)).collect::<anyhow::Result<_>>()?;
    }
    observer.check()?;
    write_pictures(&root, &results, &truth[0])?;
    let played = play::write(&root, &samples, &Target { width: size.0, height: size.1 }, observer)?;
    let seconds = began.elapsed().as_secs_f64();
    let json = record(args, &calibrated, &results, seconds);
    let page = page(args, &camera, &calibrated, &results, &truth[0], &played, simulated)?;
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

/// What the report says of each interpolation.
const INTERPOLATIONS: [(Interpolation, &str); 4] = [
    (Interpolation::Bicubic, "low-resolution grid, then bicubic (paper 4.1)"),
    (Interpolation::Barycentric, "on the triangulated lenslets (paper 4.2)"),
    (Interpolation::Cubic, "smooth surface through the same samples"),
    (Interpolation::Multiview, "samples of all views at their true places (paper 4.3)"),
];

/// What the report says of learned reconstruction on each interpolation.
const LEARNED: [(&str, Interpolation, &str); 2] = [
    ("learned", Interpolation::Barycentric, "dictionary reconstruction of the barycentric views (paper 4.4)"),
    (
        "learned on multiview",
        Interpolation::Multiview,
        "dictionary reconstruction of the refined views (paper 4.3, then 4.4)",
    ),
];

/// Every method on the scored views.
fn reconstruct(samples: &HexSamples, target: &Target, observer: &dyn Observer) -> anyhow::Result<Vec<Reconstruction>> {
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
        results.push(Reconstruction::new(interpolation.name(), about, &views, began));
        low.push((interpolation, views));
    }
    for (name, interpolation, about) in LEARNED {
        let began = Instant::now();
        let dictionary = reconstruct::embedded_for(interpolation)?;
        let options = reconstruct::Options::default();
        let prepared = LearnedViews::prepare(samples, interpolation, target, &dictionary, &options, observer)?;
        observer.begin(name, SCORED.len() as u64);
        let mut views = Vec::new();
        for (view, (v, u)) in low.iter().filter(|l| l.0 == interpolation).flat_map(|l| &l.1).zip(SCORED) {
            observer.check()?;
            views.push(prepared.reconstruct_view(view, v, u)?);
            observer.advance(1);
        }
        results.push(Reconstruction::new(name, about, &views, began));
    }
    Ok(results)
}

fn score(result: &Array3<f32>, truth: &Array3<f32>) -> anyhow::Result<Scores> {
    Scores::between(result.view(), truth.view(), &Window::without_border(BORDER)).context("the views cannot be scored")
}

fn mean(scores: &[Scores], of: impl Fn(&Scores) -> f64) -> f64 {
    scores.iter().map(of).sum::<f64>() / scores.len().max(1) as f64
}

/// `pictures/NAME.png` of the central view of every method and of the truth, and the strip of crops.
fn write_pictures(root: &Path, results: &[Reconstruction], truth: &Array3<f32>) -> anyhow::Result<()> {
    for (name, view) in results.iter().map(|r| (r.name, &r.views[0])).chain([("truth", truth)]) {
        let file: String = name.chars().map(|c| if c == ' ' { '-' } else { c }).collect();
        output::write_file(
            &root.join("pictures").join(format!("{file}.png")),
            false,
            &EmbeddedPicture::png(view, 1)?.bytes,
        )?;
    }
    let strip_of = ["bicubic", "barycentric", "learned", "multiview", "learned on multiview"];
    let shown: Vec<_> = results.iter().filter(|r| strip_of.contains(&r.name)).map(|r| (r.name, &r.views[0])).collect();
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
    let methods = results.iter().map(|r| {
        let centre = r.scores[0];
        let value = json!({
            "psnr_rgb": centre.psnr_rgb, "psnr_y": centre.psnr_y, "ssim_y": centre.ssim_y,
            "psnr_y_five_views": mean(&r.scores, |s| s.psnr_y), "ssim_y_five_views": mean(&r.scores, |s| s.ssim_y),
            "seconds": r.seconds,
        });
        (r.name.to_owned(), value)
    });
    let lattice = &calibrated.found.lattice;
    json!({
        "out": args.out,
        "size": args.size,
        "seed": args.seed,
        "calibration": {
            "pitch": lattice.pitch(), "rotation": lattice.rotation(), "row_stretch": lattice.row_stretch(),
            "lenslets": calibrated.found.lenslets.len(), "true_lenslets": calibrated.truth, "centre_rms": calibrated.rms,
        },
        "methods": methods.collect::<serde_json::Map<_, _>>(),
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

fn page(
    args: &Args,
    camera: &Camera,
    calibrated: &Calibrated,
    results: &[Reconstruction],
    truth: &Array3<f32>,
    played: &play::Pictures,
    simulated: f64,
) -> anyhow::Result<String> {
    let mut page = Page::new(
        "From a raw capture to sharp views",
        &format!(
            "A simulated capture of {0}x{0} sensor pixels, reconstructed to views of {1}x{1} by every method and compared with the truth.",
            camera.sensor.0, args.size
        ),
    );
    page.heading("The same view by every method");
    let mut stages = Vec::new();
    for (name, view) in results.iter().map(|r| (r.name, &r.views[0])).chain([("truth", truth)]) {
        stages.push(Stage { name: name.to_owned(), picture: EmbeddedPicture::png(view, 1)? });
    }
    page.compare("central view", &stages, [CROPS[0].1, CROPS[0].2]);
    scores_section(&mut page, results);
    page.heading("Close up");
    page.paragraph("The same piece of the central view, every pixel enlarged, nothing smoothed.");
    let side = (truth.dim().0 / 5).clamp(24, 64);
    for (name, x, y) in CROPS {
        let crop = Crop::about(truth.dim(), x, y, side, side);
        let figures = results
            .iter()
            .map(|r| (r.name, &r.views[0]))
            .chain([("truth", truth)])
            .map(|(method, view)| Ok((EmbeddedPicture::png(&crop.of(view), 3)?, format!("{name}: {method}"))))
            .collect::<anyhow::Result<Vec<_>>>()?;
        page.figures(&figures);
    }
    page.heading("Where each method is wrong");
    page.paragraph(
        "Difference from the truth, five times as strong: red is too bright, blue too dark, white is right.",
    );
    let figures = results
        .iter()
        .map(|r| {
            Ok((EmbeddedPicture::jpeg(&embedded::difference_map(&r.views[0], truth, 5.0), 85)?, r.name.to_owned()))
        })
        .collect::<anyhow::Result<Vec<_>>>()?;
    page.figures(&figures);
    page.heading("What a light field is for");
    page.paragraph("All 7x7 views together: focus chosen after the fact, and how far away everything is.");
    let figures = played
        .iter()
        .map(|(name, view)| Ok((EmbeddedPicture::png(view, 1)?, name.clone())))
        .collect::<anyhow::Result<Vec<_>>>()?;
    page.figures(&figures);
    page.link(play::PAGE, "The same light field to play with: click to focus, drag to look around.");
    calibration_section(&mut page, camera, calibrated);
    page.heading("How it was made");
    page.paragraph(&format!(
        "Scene, capture, two white images and the 7x7 truth views took {simulated:.1} s, calibration {:.1} s. The truth is the \
         scene behind the lenslets' own low-pass (a Gaussian of a quarter pitch), seen from exactly one direction. Sensor \
         noise, optical blur, vignetting, colour filters and errors of single lenslets are in the capture. The same steps by hand:",
        calibrated.seconds
    ));
    page.code(&format!(
        "lenslet simulate --sensor {} --size {} --seed {} --out sim\n\
         lenslet calibrate sim/white-*.lfp --out sim/camera.calib\n\
         lenslet decode sim/capture.lfp --calibration sim/camera.calib --method learned --size {} --out sim/views\n\
         lenslet score sim/views sim/truth/views --border {BORDER}",
        camera.sensor.0, args.size, args.seed, args.size
    ));
    Ok(page.finish())
}

/// A column of the score table: its head, its value, its decimals.
type Column = (&'static str, fn(&Reconstruction) -> f64, usize);

fn scores_section(page: &mut Page, results: &[Reconstruction]) {
    page.heading("Scores against the truth");
    let columns: [Column; 5] = [
        ("PSNR RGB, dB", |r| r.scores[0].psnr_rgb, 2),
        ("PSNR luminance, dB", |r| r.scores[0].psnr_y, 2),
        ("SSIM luminance", |r| r.scores[0].ssim_y, 4),
        ("five views, PSNR luminance", |r| mean(&r.scores, |s| s.psnr_y), 2),
        ("five views, SSIM", |r| mean(&r.scores, |s| s.ssim_y), 4),
    ];
    let mut head = vec!["method".to_owned()];
    head.extend(columns.iter().map(|c| c.0.to_owned()));
    head.push("seconds".to_owned());
    let mut rows = Vec::new();
    for r in results {
        let mut row = vec![r.name.to_owned()];
        row.extend(columns.iter().map(|(_, of, decimals)| format!("{:.*}", *decimals, of(r))));
        row.push(format!("{:.2}", r.seconds));
        rows.push(row);
    }
    let mut best = Vec::new();
    for (c, (_, of, _)) in columns.iter().enumerate() {
        let top = results.iter().enumerate().max_by(|a, b| of(a.1).total_cmp(&of(b.1)));
        best.extend(top.map(|(r, _)| (r, c + 1)));
    }
    let caption = format!(
        "Central view unless said otherwise, sRGB-encoded, {BORDER} pixels left out on each side. Five views: the centre \
         and the corners of 7x7. Seconds: for these five views."
    );
    page.table(&Table { caption, head, rows, best });
    let bars: Vec<_> = results.iter().map(|r| (r.name.to_owned(), r.scores[0].psnr_y)).collect();
    let base = bars.iter().map(|b| b.1).fold(f64::INFINITY, f64::min).floor() - 1.0;
    page.drawing(
        &plot::bars("dB", base, &bars),
        &format!("PSNR of the central view's luminance; the bars begin at {base:.0} dB."),
    );
    page.list(&results.iter().map(|r| (r.name, r.about)).collect::<Vec<_>>());
}

fn calibration_section(page: &mut Page, camera: &Camera, calibrated: &Calibrated) {
    page.heading("Calibration");
    let lattice = &calibrated.found.lattice;
    let row = |name: &str, found: String, truth: String| vec![name.to_owned(), found, truth];
    let rows = vec![
        row("pitch, px", format!("{:.4}", lattice.pitch()), format!("{:.4}", camera.pitch)),
        row("rotation, rad", format!("{:.6}", lattice.rotation()), format!("{:.6}", camera.rotation)),
        row("row stretch", format!("{:.6}", lattice.row_stretch()), format!("{:.6}", camera.row_stretch)),
        row("lenslets", calibrated.found.lenslets.len().to_string(), calibrated.truth.to_string()),
        row("centres, px RMS from the truth", format!("{:.4}", calibrated.rms), "0".to_owned()),
    ];
    page.table(&Table {
        caption: format!(
            "Found from two white images with noise; every lenslet has its own error of {:.2} px (standard deviation) in x and y.",
            camera.jitter
        ),
        head: ["", "found", "true"].map(str::to_owned).to_vec(),
        rows,
        best: Vec::new(),
    });
}
