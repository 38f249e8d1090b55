//! `lenslet decode`: captures to light fields.

mod choose;
mod inputs;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::Context as _;
use lenslet_core::calibration::Calibration;
use lenslet_core::container::{self, Capture};
use lenslet_core::decode::{
    self, Demosaic, HexSamples, RawStep, SAMPLES_FILE, SamplesOrigin, ViewStep, WhiteBalance, samples_beside,
    view_fingerprint,
};
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::{self, Format, Meta, View};
use lenslet_core::output::{self, Kind};
use lenslet_core::progress::Observer;
use lenslet_views::multiview::Fit;
use lenslet_views::reconstruct::{self, Available, Plan};
use lenslet_views::{Learned, Method, Renderer, native_size};
use serde_json::{Value, json};

use super::inputs::{Input, each};
use super::learned::LearnedArgs;
use super::source::file_name;
use super::values::FitName;
use super::written::{Written, kind_of};
use super::{Context, Outcome, Usage, dict};
pub(super) use choose::CalibrationStore;
use inputs::Job;

/// Decode captures to light fields
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet decode IMG_0001.lfp --calibration cam.calib --out IMG_0001.lf
         lenslet decode IMG_4.jpg --profile lytro-f01 --calibration cam.calib --out IMG_4.lf --method learned
         lenslet decode captures/ --calibration calibrations/ --out lightfields/

Captures: .lfp, .lfr, data.C.n, .raw with .txt or .json beside it, and mosaics as png, tif or jpg (with --profile). Several
captures, or a folder of them, go to --out/NAME each; what is there already is left alone, so a second run goes on.")]
pub struct Args {
    /// Captures, or folders of captures
    #[arg(required = true, value_name = "CAPTURE")]
    captures: Vec<PathBuf>,
    /// Calibration of the camera, a folder of calibrations to choose from, or white images: the camera's calibration
    /// folder, data.C.n bundle or .tar (not needed for an Illum .lfr)
    #[arg(short, long, value_name = "CAM.calib|DIR")]
    calibration: Option<PathBuf>,
    #[command(flatten)]
    written: Written,
    /// How views are made: bicubic, barycentric, cubic, multiview or learned
    #[arg(short, long, default_value = "cubic", value_name = "METHOD")]
    method: MethodName,
    /// Interpolation that learned reconstruction starts from: barycentric, cubic or multiview
    #[arg(long, value_name = "METHOD")]
    base: Option<Interpolation>,
    /// How multi-view samples become pixels [default: joint, or what the dictionary was made for]
    #[arg(long, value_enum)]
    fit: Option<FitName>,
    /// Views a row and a column (odd, up to 15)
    #[arg(long, default_value_t = 7, value_name = "N")]
    views: usize,
    /// Sensor pixels between neighbouring views
    #[arg(value_parser = super::values::finite::<f64>, long, default_value_t = 1.0, value_name = "PIXELS")]
    view_step: f64,
    /// Size of the views: pixels of the longer side, WIDTHxHEIGHT, or native (one pixel a lenslet)
    #[arg(long, default_value = "1080", value_name = "SIZE")]
    size: SizeChoice,
    /// Camera profile (a name or a TOML file), where the files do not name their camera
    #[arg(long, value_name = "NAME")]
    profile: Option<String>,
    /// White balance: camera (that of the file), auto (estimated from the capture), or gains R,G,B
    #[arg(long, default_value = "camera", value_name = "HOW", value_parser = parse_white_balance)]
    white_balance: WhiteBalance,
    /// How colours are filled in: lenslet (each micro-image by itself), malvar or bilinear
    #[arg(long, default_value = "lenslet", value_name = "HOW", value_parser = parse_demosaic)]
    demosaic: Demosaic,
    /// Rotate the demosaiced raw by the lattice's angle and resample it, as printed in the paper's Algorithm 1, instead
    /// of turning coordinates (with --demosaic malvar or bilinear)
    #[arg(long)]
    rotate_raw: bool,
    /// Brighten (or darken, below 0) by this many stops
    #[arg(long, value_name = "EV", allow_negative_numbers = true, value_parser = parse_exposure)]
    exposure: Option<f32>,
    /// Smooth the colours of noisy captures and keep their luminance (the default for mosaics saved as JPEG)
    #[arg(long)]
    calm_colours: bool,
    /// Leave out a step: black-level, hot-pixels, vignetting, white-balance, highlights, calm-colours, colour-matrix,
    /// exposure-bias, gamut, or recentre (of the views)
    #[arg(long, value_name = "STEP", value_parser = parse_without)]
    without: Vec<Without>,
    /// Do not keep the measured samples (samples.npz)
    #[arg(long)]
    no_samples: bool,
    #[command(flatten)]
    learned: LearnedArgs,
}

/// `--without`.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Without {
    Raw(RawStep),
    View(ViewStep),
    Recentring,
}

/// `--method`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum MethodName {
    Interpolation(Interpolation),
    Learned,
}

impl MethodName {
    fn name(self) -> &'static str {
        match self {
            MethodName::Interpolation(interpolation) => interpolation.name(),
            MethodName::Learned => "learned",
        }
    }
}

impl std::str::FromStr for MethodName {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            "learned" => Ok(MethodName::Learned),
            _ => name
                .parse()
                .map(MethodName::Interpolation)
                .map_err(|_| format!("no method \"{name}\": one of bicubic, barycentric, cubic, multiview, learned")),
        }
    }
}

/// `--size`.
#[derive(Debug, Clone, Copy, PartialEq)]
enum SizeChoice {
    Longer(usize),
    Exactly(usize, usize),
    Native,
}

impl std::str::FromStr for SizeChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let side = |t: &str| t.parse().ok().filter(|n| (1..=lightfield::MAX_SIDE).contains(n));
        let parsed = match (text, text.split_once('x')) {
            ("native", _) => Some(SizeChoice::Native),
            (_, Some((w, h))) => side(w).zip(side(h)).map(|(w, h)| SizeChoice::Exactly(w, h)),
            _ => side(text).map(SizeChoice::Longer),
        };
        parsed.ok_or_else(|| {
            format!("no size `{text}`: a number of pixels up to {}, WIDTHxHEIGHT, or native", lightfield::MAX_SIDE)
        })
    }
}

fn parse_white_balance(text: &str) -> Result<WhiteBalance, String> {
    match text {
        "camera" => return Ok(WhiteBalance::Camera),
        "auto" => return Ok(WhiteBalance::Auto),
        _ => {}
    }
    let gains: Option<Vec<f32>> = text.split(',').map(|g| g.trim().parse().ok()).collect();
    match gains.as_deref() {
        Some(&[r, g, b]) if [r, g, b].iter().all(|&g| g > 0.0 && g < 1e3) => Ok(WhiteBalance::Gains([r, g, b])),
        _ => Err("camera, auto, or three gains above 0 as in 1.2,1,1.6".into()),
    }
}

fn parse_demosaic(text: &str) -> Result<Demosaic, String> {
    Demosaic::from_name(text).ok_or_else(|| "lenslet, malvar or bilinear".into())
}

fn parse_exposure(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|ev| (-32.0..=32.0).contains(ev)).ok_or_else(|| "stops from -32 to 32".into())
}

/// What `--without` can leave out.
const STEPS: [(&str, Without); 10] = [
    ("black-level", Without::Raw(RawStep::BlackLevel)),
    ("hot-pixels", Without::Raw(RawStep::HotPixels)),
    ("vignetting", Without::Raw(RawStep::Vignetting)),
    ("white-balance", Without::Raw(RawStep::WhiteBalance)),
    ("highlights", Without::Raw(RawStep::Highlights)),
    ("calm-colours", Without::View(ViewStep::ChromaDenoise)),
    ("colour-matrix", Without::View(ViewStep::ColourMatrix)),
    ("exposure-bias", Without::View(ViewStep::ExposureBias)),
    ("gamut", Without::View(ViewStep::Gamut)),
    ("recentre", Without::Recentring),
];

fn parse_without(text: &str) -> Result<Without, String> {
    let found = STEPS.iter().find(|(name, _)| *name == text).map(|s| s.1);
    found.ok_or_else(|| STEPS.map(|s| s.0).join(", "))
}

impl Args {
    /// The options for a capture.
    fn decode_options(&self, capture: &Capture) -> decode::Options {
        let mut steps = decode::steps_for(capture);
        steps.demosaic = self.demosaic;
        if self.calm_colours {
            steps.add_chroma_denoise();
        }
        if let Some(ev) = self.exposure {
            let last = steps.view.iter().position(|s| *s == ViewStep::Gamut).unwrap_or(steps.view.len());
            steps.view.insert(last, ViewStep::Exposure(ev));
        }
        // Scene-linear output keeps what the screen cannot show.
        steps.view.retain(|s| !(self.written.linear && *s == ViewStep::Gamut));
        steps.raw.retain(|s| !self.without.contains(&Without::Raw(*s)));
        steps.view.retain(|s| !self.without.contains(&Without::View(*s)));
        decode::Options {
            views: self.views,
            view_step: self.view_step,
            white_balance: self.white_balance,
            recentre: !self.without.contains(&Without::Recentring),
            rotate_raw: self.rotate_raw,
            steps,
        }
    }

    fn target(&self, samples: &HexSamples) -> Size {
        match self.size {
            SizeChoice::Longer(side) => samples.sensor.with_longer_side(side),
            SizeChoice::Exactly(width, height) => Size { width, height },
            SizeChoice::Native => native_size(samples),
        }
    }

    fn check(&self) -> anyhow::Result<()> {
        if self.views.is_multiple_of(2) || self.views > 15 {
            return Err(Usage(format!("--views {}: it must be odd, 1 to 15", self.views)).into());
        }
        if !(self.view_step > 0.0 && self.view_step <= 4.0) {
            return Err(Usage(format!("--view-step {}: it must be above 0, up to 4", self.view_step)).into());
        }
        if self.rotate_raw && self.demosaic == Demosaic::CoKriging {
            return Err(Usage("--rotate-raw goes with --demosaic malvar or bilinear".into()).into());
        }
        self.learned.check()?;
        if self.fit.is_some() && self.interpolation() != Interpolation::Multiview {
            return Err(Usage("--fit goes with --method multiview, or learned on --base multiview".into()).into());
        }
        if let (MethodName::Interpolation(method), Some(option)) = (self.method, self.learned.first_given()) {
            return Err(Usage(format!("{option} goes with --method learned, not {method}")).into());
        }
        match (self.method, self.base) {
            (MethodName::Learned, Some(Interpolation::Bicubic)) => {
                Err(Usage("--base must be barycentric, cubic or multiview".into()).into())
            }
            (MethodName::Learned, _) | (_, None) => Ok(()),
            (MethodName::Interpolation(method), Some(_)) => {
                Err(Usage(format!("--base goes with --method learned, not {method}")).into())
            }
        }
    }

    /// What learned reconstruction starts from: barycentric views are what the default dictionary was trained on.
    fn base(&self) -> Interpolation {
        self.base.unwrap_or(Interpolation::Barycentric)
    }

    /// The dictionary's name, or its file.
    fn dictionary_name(&self) -> String {
        let embedded = || reconstruct::embedded_name_for(self.base()).to_owned();
        self.learned.dictionary.as_ref().map_or_else(embedded, |file| file.display().to_string())
    }

    /// The interpolation that views are made of, or start from.
    fn interpolation(&self) -> Interpolation {
        match self.method {
            MethodName::Interpolation(interpolation) => interpolation,
            MethodName::Learned => self.base(),
        }
    }

    fn method(&self) -> anyhow::Result<Method> {
        let mut interpolated = Method::from(self.interpolation());
        interpolated.fit = self.fit.map(Fit::from);
        match self.method {
            MethodName::Interpolation(_) => Ok(interpolated),
            MethodName::Learned => {
                let name = self.dictionary_name();
                let dictionary = Arc::new(dict::find(Path::new(&name))?);
                let options = self.learned.options();
                // Before any capture is read.
                if let Some(model) = dictionary.model(options.footprint) {
                    Plan::new(model, &options, Available::Samples).with_context(|| format!("dictionary {name}"))?;
                }
                let dictionary = Some(dictionary);
                Ok(interpolated.learned_with(Learned { dictionary, options }))
            }
        }
    }
}

impl Args {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> Vec<(&Path, Input)> {
        let calibration = self.calibration.as_deref().map(|p| (p, Input::Calibrations));
        each(&self.captures, Input::Captures).chain(calibration).chain(self.learned.inputs()).collect()
    }
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    args.check()?;
    let inputs::Jobs { jobs, several, left_out } = inputs::jobs(&args.captures, &args.written)?;
    for (path, why) in &left_out {
        context.progress.note(&format!("{}: left out: {why}", path.display()));
    }
    let mut inputs: Vec<&Path> = args.captures.iter().map(PathBuf::as_path).collect();
    inputs.extend(args.calibration.as_deref().into_iter().chain(args.learned.dictionary.as_deref()));
    if several {
        // Results are added to a folder, whatever else is in it.
        anyhow::ensure!(
            args.written.out.is_dir() || args.written.out.symlink_metadata().is_err(),
            "{} is a file; several light fields need a folder",
            args.written.out.display()
        );
    } else {
        args.written.check(&inputs)?;
        check_samples(args, &jobs[0], &inputs)?;
    }
    let method = args.method()?;
    let mut store = CalibrationStore::open(args.calibration.as_deref(), context)?;
    let mut done: Vec<Value> = Vec::new();
    let mut skipped: Vec<&Job> = Vec::new();
    let mut failed: Vec<String> = Vec::new();
    for job in &jobs {
        context.progress.check()?;
        if several && !args.written.force && std::fs::symlink_metadata(&job.out).is_ok() {
            skipped.push(job);
            continue;
        }
        let allowed = if several { check_job(args, job, &inputs) } else { Ok(()) };
        match allowed.and_then(|()| decode_one(args, &method, job, &mut store, context)) {
            Ok(report) => done.push(report),
            Err(e) if !several || context.progress.cancelled() || e.is::<Usage>() => return Err(e),
            Err(e) => {
                let line = format!("{e:#}").replace(['\n', '\r'], " ");
                let name = job.capture.display().to_string();
                context.progress.note(&format!(
                    "failed: {}",
                    if line.contains(&name) { line.clone() } else { format!("{name}: {line}") }
                ));
                failed.push(name);
            }
        }
    }
    if !several && let Some(report) = done.pop() {
        return Ok(Outcome { text: describe(&report), json: report });
    }
    let mut summary = format!("{} decoded, {} there already, {} failed", done.len(), skipped.len(), failed.len());
    if !left_out.is_empty() {
        summary.push_str(&format!(", {} left out ({})", left_out.len(), inputs::reasons(&left_out)));
    }
    if !failed.is_empty() {
        anyhow::bail!("{summary}: {}", failed.join(", "));
    }
    let skipped: Vec<String> = skipped.iter().map(|j| j.out.display().to_string()).collect();
    let left_out: Vec<Value> =
        left_out.iter().map(|(path, why)| json!({ "capture": path.display().to_string(), "reason": why })).collect();
    let json = json!({ "decoded": done, "skipped": skipped, "failed": [], "left_out": left_out });
    Ok(Outcome { json, text: summary })
}

/// Whether one of several results may be written, before the work for it.
fn check_job(args: &Args, job: &Job, inputs: &[&Path]) -> anyhow::Result<()> {
    output::check_target(&job.out, kind_of(job.format), args.written.force, inputs)?;
    check_samples(args, job, inputs)
}

/// Whether the samples beside a light field that is one file may be written.
fn check_samples(args: &Args, job: &Job, inputs: &[&Path]) -> anyhow::Result<()> {
    if !args.no_samples && job.format != Format::Directory {
        output::check_target(&samples_beside(&job.out), Kind::File, replaces_samples(args, job), inputs)?;
    }
    Ok(())
}

/// Samples without their light field are the remains of a killed run.
fn replaces_samples(args: &Args, job: &Job) -> bool {
    args.written.force || std::fs::symlink_metadata(&job.out).is_err()
}

/// Decodes one capture.
fn decode_one(
    args: &Args,
    method: &Method,
    job: &Job,
    store: &mut CalibrationStore,
    context: &Context,
) -> anyhow::Result<Value> {
    let started = Instant::now();
    let progress = &context.progress;
    let capture = container::open_capture(&job.capture, args.profile.as_deref())?;
    for warning in &capture.warnings {
        progress.note(&format!("{}: {warning}", job.capture.display()));
    }
    let (calibration, reason) = store.choose(&capture, context).with_context(|| job.capture.display().to_string())?;
    progress.note(&format!("{}: calibration {reason}", job.capture.display()));
    let read = started.elapsed();
    let options = args.decode_options(&capture);
    let samples = decode::sample_views(&capture, calibration, &options, progress)
        .with_context(|| job.capture.display().to_string())?;
    let mut meta = describe_views(args, job, &capture, calibration, &samples, &options, &reason);
    let source = capture.source_sha256.clone();
    drop(capture);
    let sampled = started.elapsed();
    let size = meta.size;
    let target = Size { width: size[1], height: size[0] };
    let renderer = Renderer::prepare(&samples, method, target, progress)?;
    if let (Some(fit), Some(Value::Object(last))) = (renderer.fit(), meta.provenance.last_mut()) {
        last.insert("fit".into(), fit.name().into());
    }
    let predictor = renderer.plan().map(|plan| plan.to_string());
    if let Some(predictor) = &predictor {
        let (base, dictionary) = (args.base(), args.dictionary_name());
        progress.note(&format!("{base} views are reconstructed by: {predictor} (dictionary {dictionary})"));
        if let Some(Value::Object(last)) = meta.provenance.last_mut() {
            last.insert("dictionary".into(), file_name(Path::new(&dictionary)).into());
            last.insert("predictor".into(), predictor.clone().into());
        }
    }
    meta.predictor = predictor.clone();
    let mut sink = lightfield::create(&job.out, meta, job.format, args.written.force)?;
    let mut writing = std::time::Duration::ZERO;
    let mut origin = SamplesOrigin { capture_sha256: source, middle_view: None };
    let mut put = |v: usize, u: usize, view: View| -> anyhow::Result<()> {
        let begin = Instant::now();
        let encoded;
        let view = if args.written.linear {
            view.pixels()
        } else {
            encoded = view.encode();
            encoded.pixels()
        };
        if [v, u] == [args.views / 2; 2] {
            origin.middle_view = Some(view_fingerprint(view));
        }
        sink.write(v, u, view)?;
        writing += begin.elapsed();
        Ok(())
    };
    renderer.render_all(&mut put)?;
    progress.check()?;
    let kept = if args.no_samples { None } else { Some(keep_samples(args, job, &*sink, &samples, &origin)?) };
    let begin = Instant::now();
    sink.finish()?;
    writing += begin.elapsed();
    let total = started.elapsed();
    Ok(json!({
        "capture": job.capture.display().to_string(),
        "out": job.out.display().to_string(),
        "calibration": reason,
        "method": args.method.name(),
        "predictor": predictor,
        "views": [args.views, args.views],
        "size": size,
        "lenslets": samples.centres.len(),
        "samples": kept,
        "seconds": {
            "read": read.as_secs_f64(),
            "sample": sampled.saturating_sub(read).as_secs_f64(),
            // A clock that stood still or jumped gives odd times, nothing else.
            "render": total.saturating_sub(sampled).saturating_sub(writing).as_secs_f64(),
            "encode_and_write": writing.as_secs_f64(),
            "total": total.as_secs_f64(),
        },
    }))
}

/// Writes `samples.npz` into the light field's folder, or beside a light field that is one file.
fn keep_samples(
    args: &Args,
    job: &Job,
    sink: &dyn lightfield::ViewSink,
    samples: &HexSamples,
    origin: &SamplesOrigin,
) -> anyhow::Result<String> {
    if let Some(folder) = sink.folder() {
        samples.save_of(&folder.join(SAMPLES_FILE), false, origin)?;
        return Ok(job.out.join(SAMPLES_FILE).display().to_string());
    }
    let path = samples_beside(&job.out);
    samples.save_of(&path, replaces_samples(args, job), origin)?;
    Ok(path.display().to_string())
}

fn describe_views(
    args: &Args,
    job: &Job,
    capture: &Capture,
    calibration: &Calibration,
    samples: &HexSamples,
    options: &decode::Options,
    reason: &str,
) -> Meta {
    let target = args.target(samples);
    let n = args.views;
    let mut meta = Meta::new([n, n], [target.height, target.width], samples.values.dim().2, args.written.colour());
    meta.weights = Some(samples.weights.clone());
    meta.pitch = Some(calibration.lattice.pitch() * target.width as f64 / samples.sensor.width as f64);
    meta.rotation = Some(calibration.lattice.rotation());
    meta.method = Some(args.method.name().into());
    let name = job.capture.file_name().map(|n| n.to_string_lossy().into_owned());
    meta.provenance.push(json!({
        "tool": "lenslet",
        "version": env!("CARGO_PKG_VERSION"),
        "command": "decode",
        "input": name,
        "sha256": capture.source_sha256,
        "calibration": reason,
        "calibration_sources": calibration.origin.sources,
        "method": args.method.name(),
        "base": (args.method == MethodName::Learned).then(|| args.base().name()),
        "view_step": args.view_step,
        "steps": options.steps.names(),
        "white_balance": format!("{:?}", args.white_balance),
        "recentred": options.recentre,
    }));
    meta
}

fn describe(report: &Value) -> String {
    let size = &report["size"];
    let seconds = report["seconds"]["total"].as_f64().unwrap_or(0.0);
    let share = report["seconds"]["encode_and_write"].as_f64().unwrap_or(0.0) / seconds.max(1e-9);
    format!(
        "{}\n{}x{} views of {}x{} pixels by {}{}, from {} lenslets, in {seconds:.1} s ({:.0} % encoding and writing)",
        report["out"].as_str().unwrap_or_default(),
        report["views"][0],
        report["views"][1],
        size[1],
        size[0],
        report["method"].as_str().unwrap_or_default(),
        report["predictor"].as_str().map(|p| format!(" ({p})")).unwrap_or_default(),
        report["lenslets"],
        100.0 * share,
    )
}
