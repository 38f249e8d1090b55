//! `lenslet assess`: measures of a capture's views that need no ground truth.

mod calibrations;
mod measured;
mod table;

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use lenslet_core::container::{self, Capture};
use lenslet_core::decode;
use lenslet_core::output::{self, Kind};
use lenslet_core::progress::Observer;
use lenslet_views::Method;
use lenslet_views::assess::{compare_calibrations, parse_lines};
use serde_json::json;

use super::inputs::{Input, each};
use super::{Context, Outcome, Usage};
use calibrations::Calibrations;
use measured::{Assessment, Wanted, measure_methods};

/// Longest file of lines that is read, bytes.
/// Source: chosen.
const MAX_LINES: u64 = 1 << 20;

/// Assess the views of real captures without a ground truth: rays, edges, lines, raw pixels
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet assess IMG_4.jpg --profile lytro-f01 --calibration cam.calib
         lenslet assess IMG_4.jpg --profile lytro-f01 --from-captures IMG_2.jpg IMG_3.jpg IMG_4.jpg --lines strings.txt

Measures (docs/assessing.md says what each can and cannot tell):
  rays   how well the middle view foretells samples of other views between its own; dB, and dB over barycentric
  edges  MTF50 (cycles a pixel) beside roughness (pixels); never one alone
  lines  roughness, width (pixels) and ripple of thin bright lines, found or given with --lines
  raw    raw pixels foretold by each calibration, dB over the first: several --calibration, or the variants that are
         calibrated from --white or --from-captures
  holes  hidden lenslets filled by their neighbours' mean: biased, judges nothing, only when named
All have standard errors; differences are of the same places.")]
pub struct Args {
    /// Captures
    #[arg(required = true, value_name = "CAPTURE")]
    captures: Vec<PathBuf>,
    /// Calibration of the camera, a folder of calibrations to choose from, or white images, as `decode` takes them; with
    /// several files the first is used and the others are compared with it
    #[arg(short, long, value_name = "CAM.calib|DIR", num_args = 1..)]
    calibration: Vec<PathBuf>,
    /// White images to calibrate from
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with = "calibration")]
    white: Vec<PathBuf>,
    /// Ordinary captures to calibrate from
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with_all = ["calibration", "white"])]
    from_captures: Vec<PathBuf>,
    /// Camera profile (a name or a TOML file), where the files do not name their camera
    #[arg(long, value_name = "NAME")]
    profile: Option<String>,
    /// Methods: bicubic, barycentric, cubic, multiview, learned, learned-on-multiview
    #[arg(long, value_name = "NAME", num_args = 1.., value_parser = parse_method,
          default_values = ["barycentric", "cubic", "multiview", "learned", "learned-on-multiview"])]
    method: Vec<MethodName>,
    /// Measures: rays, edges, lines, raw, holes [default: rays, edges, lines, and raw where there are calibrations to
    /// compare]
    #[arg(long, value_name = "NAME", num_args = 1.., value_parser = parse_measure)]
    measure: Vec<Measure>,
    /// Lines to measure, a polyline a row: `x y x y …`, pixels of the middle view, `#` begins a comment; without it lines are
    /// found
    #[arg(long, value_name = "FILE")]
    lines: Option<PathBuf>,
    /// Longer side of the views, pixels
    #[arg(long, default_value_t = 1080, value_name = "PIXELS", value_parser = clap::value_parser!(u16).range(64..=8192))]
    size: u16,
    /// Also write the tables as Markdown
    #[arg(short, long, value_name = "FILE.md")]
    out: Option<PathBuf>,
    /// Replace an existing file
    #[arg(short, long)]
    force: bool,
}

/// `--method`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MethodName(usize);

/// Every method's name, in the order of the tables.
const METHODS: [&str; 6] = ["bicubic", "barycentric", "cubic", "learned", "multiview", "learned-on-multiview"];

impl MethodName {
    fn name(self) -> &'static str {
        METHODS[self.0]
    }

    fn method(self) -> Method {
        match self.0 {
            0 => Method::bicubic(),
            1 => Method::barycentric(),
            2 => Method::cubic(),
            3 => Method::barycentric().learned(),
            4 => Method::multiview(),
            _ => Method::multiview().learned(),
        }
    }
}

fn parse_method(text: &str) -> Result<MethodName, String> {
    METHODS.iter().position(|m| *m == text).map(MethodName).ok_or_else(|| METHODS.join(", "))
}

/// `--measure`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Measure {
    Rays,
    Edges,
    Lines,
    Raw,
    Holes,
}

fn parse_measure(text: &str) -> Result<Measure, String> {
    match text {
        "rays" => Ok(Measure::Rays),
        "edges" => Ok(Measure::Edges),
        "lines" => Ok(Measure::Lines),
        "raw" => Ok(Measure::Raw),
        "holes" => Ok(Measure::Holes),
        _ => Err("rays, edges, lines, raw or holes".into()),
    }
}

impl Args {
    fn takes(&self, measure: Measure) -> bool {
        match (measure, self.measure.is_empty()) {
            (_, false) => self.measure.contains(&measure),
            (Measure::Holes, true) => false,
            (Measure::Raw, true) => self.compares_calibrations(),
            (_, true) => true,
        }
    }

    fn compares_calibrations(&self) -> bool {
        self.calibration.len() > 1 || !self.white.is_empty() || !self.from_captures.is_empty()
    }

    fn check(&self) -> anyhow::Result<()> {
        if self.takes(Measure::Raw) && !self.compares_calibrations() {
            let text = "--measure raw compares calibrations: name several, or white images (--white) or captures \
                        (--from-captures) to calibrate from";
            return Err(Usage(text.into()).into());
        }
        if self.lines.is_some() && !self.takes(Measure::Lines) {
            return Err(Usage("--lines goes with --measure lines".into()).into());
        }
        if let Some(out) = &self.out {
            let given = self.captures.iter().chain(&self.calibration).chain(&self.white).chain(&self.from_captures);
            let inputs: Vec<&Path> = given.chain(&self.lines).map(PathBuf::as_path).collect();
            output::check_target(out, Kind::File, self.force, &inputs)?;
        }
        Ok(())
    }

    /// The methods, each once, in the order of the tables; barycentric, which others are compared with, always.
    fn methods(&self) -> Vec<MethodName> {
        let named = |m: &MethodName| self.method.contains(m) || m.name() == "barycentric";
        (0..METHODS.len()).map(MethodName).filter(named).collect()
    }
}

impl Args {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> Vec<(&Path, Input)> {
        each(&self.captures, Input::CaptureFile)
            .chain(each(&self.calibration, Input::Calibrations))
            .chain(each(&self.white, Input::WhiteImage))
            .chain(each(&self.from_captures, Input::CaptureFile))
            .chain(self.lines.as_deref().map(|p| (p, Input::Text)))
            .collect()
    }
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    args.check()?;
    let lines = args.lines.as_deref().map(read_lines).transpose()?;
    let mut calibrations = Calibrations::open(&args.calibration, context)?;
    if args.compares_calibrations() && args.calibration.is_empty() {
        let (files, white) = if args.white.is_empty() { (&args.from_captures, false) } else { (&args.white, true) };
        let all = args.takes(Measure::Raw);
        calibrations.calibrate(files, white, args.profile.as_deref(), all, context)?;
    }
    let mut done = Vec::new();
    for path in &args.captures {
        context.progress.check()?;
        let found = assess_capture(args, path, &mut calibrations, lines.as_deref(), context);
        done.push(found.with_context(|| path.display().to_string())?);
    }
    let text = done.iter().map(table::to_markdown).collect::<Vec<_>>().join("\n");
    if let Some(out) = &args.out {
        output::write_file(out, args.force, format!("# Assessment\n\n{text}").as_bytes())?;
    }
    let mut all: Vec<_> = done.iter().map(table::to_json).collect();
    let json = if all.len() == 1 { all.remove(0) } else { json!({ "captures": all }) };
    Ok(Outcome { json, text: text.trim_end().to_owned() })
}

fn read_lines(path: &Path) -> anyhow::Result<Vec<Vec<[f64; 2]>>> {
    let shown = || path.display().to_string();
    let bytes = lenslet_core::input::read_regular(path, MAX_LINES).with_context(shown)?;
    let text = String::from_utf8(bytes).map_err(|_| anyhow::anyhow!("{}: no text", path.display()))?;
    parse_lines(&text).with_context(shown)
}

/// Measures one capture.
fn assess_capture(
    args: &Args,
    path: &Path,
    calibrations: &mut Calibrations,
    lines: Option<&[Vec<[f64; 2]>]>,
    context: &Context,
) -> anyhow::Result<Assessment> {
    let progress = &context.progress;
    let capture: Capture = container::open_capture(path, args.profile.as_deref())?;
    for warning in &capture.warnings {
        progress.note(&format!("{}: {warning}", path.display()));
    }
    let (calibration, reason) = calibrations.first(&capture, context)?;
    let options = decode::Options { steps: decode::steps_for(&capture), ..decode::Options::default() };
    let samples = decode::sample_views(&capture, calibration, &options, progress)?;
    let size = samples.sensor.with_longer_side(args.size.into());
    let wanted = Wanted {
        rays: args.takes(Measure::Rays),
        edges: args.takes(Measure::Edges),
        lines: args.takes(Measure::Lines),
        holes: args.takes(Measure::Holes),
        given: lines,
    };
    let name = path.file_name().map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned());
    let mut found = Assessment::new(name, reason, size);
    if wanted.any() {
        let methods: Vec<(&'static str, Method)> = args.methods().iter().map(|m| (m.name(), m.method())).collect();
        measure_methods(&samples, &size, &methods, &wanted, &mut found, progress)?;
    }
    drop(samples);
    if args.takes(Measure::Raw) {
        let named = calibrations.all(&capture)?;
        let each: Vec<_> = named.iter().map(|c| c.1).collect();
        let scores = compare_calibrations(&capture, &each, args.size.into(), progress)?;
        found.raw = named.iter().map(|c| c.0.clone()).zip(scores).collect();
    }
    Ok(found)
}
