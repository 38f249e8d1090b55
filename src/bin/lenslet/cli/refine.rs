//! `lenslet refine`: multi-view refinement of a light field.

use std::path::Path;
use std::time::Instant;

use anyhow::Context as _;
use lenslet_core::decode::{HexSamples, find_samples_file};
use lenslet_core::geometry::Size;
use lenslet_core::lightfield::{self, ColourSpace, LightField, colour};
use lenslet_core::progress::Observer as _;
use lenslet_views::inverse::SampleFootprint;
use lenslet_views::multiview::{Fit, Options, RefinedViews, SampleSet};
use lenslet_views::reconstruct::Enlargement;
use lenslet_views::view_pitch;
use ndarray::Array3;
use serde_json::json;

use super::belong;
use super::inputs::Input;
use super::source::{SourceArgs, absent_places, but_absent, measured_samples, need_middle, note_dark};
use super::values::{FitName, RangeArgs};
use super::written::Written;
use super::{Context, Outcome, Usage};

/// Refine every view of a light field with the samples of all the other views
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet refine barycentric.lf --out multiview.lf
         lenslet refine other-tool/ --out large/ --scale 3

The samples that decode left beside a light field (samples.npz) are used at their exact places. Of light fields without
them, other tools' for instance, every pixel of every view is a sample, and the views can be enlarged by --scale: each
pixel then counts as the mean over the pixels of the result that it covers.")]
pub struct Args {
    #[command(flatten)]
    source: SourceArgs,
    #[command(flatten)]
    written: Written,
    /// Factor by which the views are enlarged, 1 to 8 (default: 1 where there are measured samples, else 2)
    #[arg(value_parser = super::values::finite::<f64>, long, value_name = "N")]
    scale: Option<f64>,
    /// How the samples become pixels (default: joint; least-squares for a light field that is not enlarged)
    #[arg(long, value_enum)]
    fit: Option<FitName>,
    /// What a sample averages, for the joint fit (default: box, the pixels of the result that it covers; of measured
    /// samples disc, one lenslet)
    #[arg(long, value_enum)]
    footprint: Option<FootprintName>,
    /// Do not use the measured samples (samples.npz) beside the light field
    #[arg(long)]
    without_samples: bool,
    #[command(flatten)]
    range: RangeArgs,
}

/// What is refined.
enum Given {
    Samples(HexSamples),
    Field(LightField),
}

impl Args {
    /// The fit asked for, or the usual one; `pitch`: pixels of the result between samples.
    fn chosen_fit(&self, given: &Given, scale: f64, pitch: f64) -> anyhow::Result<Fit> {
        let footprint = self.footprint.map(|name| match name {
            FootprintName::Point => SampleFootprint::Point,
            FootprintName::Box => SampleFootprint::Box { width: pitch, height: pitch },
            FootprintName::Disc => SampleFootprint::Disc { diameter: pitch },
        });
        match (self.fit.map(Fit::from), footprint) {
            (None | Some(Fit::Joint(_)), Some(footprint)) => Ok(Fit::Joint(Some(footprint))),
            (Some(_), Some(_)) => Err(Usage("--footprint belongs to --fit joint".into()).into()),
            (Some(fit), None) => Ok(fit),
            (None, None) => Ok(match given {
                Given::Samples(_) => Fit::default(),
                Given::Field(_) => Fit::for_enlargement(scale),
            }),
        }
    }
}

/// What a sample averages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum FootprintName {
    /// Nothing: the picture at one place
    Point,
    /// The pixels of the result that it covers
    Box,
    /// A disc as wide as samples are apart
    Disc,
}

impl Args {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> Vec<(&Path, Input)> {
        vec![self.source.as_input()]
    }
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    if args.scale.is_some_and(|s| !(1.0..=8.0).contains(&s)) {
        return Err(Usage("--scale must be 1 to 8".into()).into());
    }
    args.written.check(&[&args.source.input])?;
    let source = args.source.open(context)?;
    let described = source.meta().clone();
    let given = match measured_samples(&args.source.input, &*source, args.without_samples)? {
        Some(samples) => Given::Samples(samples),
        None => {
            belong::refuse_refined(&described, &args.source.input)?;
            need_middle(&*source, &args.source.input)?;
            Given::Field(lightfield::read_all(&*source, &args.source.input, 0)?)
        }
    };
    // From samples every view is made, also one whose picture is absent.
    let absent = if matches!(given, Given::Field(_)) { absent_places(&*source)? } else { Vec::new() };
    drop(source);
    let (mut meta, from, usual) = match &given {
        Given::Samples(_) => (described, ColourSpace::Linear, 1.0),
        Given::Field(field) => (described, field.meta.colour, 2.0),
    };
    let scale = args.scale.unwrap_or(usual);
    let pitch = match &given {
        Given::Samples(samples) => scale * view_pitch(samples, meta.size[1]),
        Given::Field(_) => scale,
    };
    let fit = args.chosen_fit(&given, scale, pitch)?;
    let [rows, columns] = meta.views;
    meta.size = Enlargement::Bicubic(scale).size(meta.size);
    meta.pitch = Some(scale * meta.pitch.unwrap_or(1.0));
    meta.colour = args.written.colour();
    meta.method = Some("multiview".into());
    meta.predictor = None;
    meta.provenance.push(json!({
        "tool": "lenslet", "version": env!("CARGO_PKG_VERSION"), "command": "refine",
        "input": args.source.name(), "scale": scale, "fit": fit.name(),
    }));
    let target = Size { width: meta.size[1], height: meta.size[0] };
    let set = match &given {
        Given::Samples(samples) => SampleSet::hexagonal(samples, &target),
        Given::Field(field) => SampleSet::rectangular(field, &target),
    }
    .with_context(|| match &given {
        Given::Samples(_) => find_samples_file(&args.source.input).unwrap_or_default().display().to_string(),
        Given::Field(_) => args.source.input.display().to_string(),
    })?;
    let mut sink = lightfield::create(&args.written.out, meta.clone(), args.written.format()?, args.written.force)?;
    let began = Instant::now();
    let to = meta.colour;
    let mut keep = |v: usize, u: usize, mut pixels: Array3<f32>| -> Result<(), lenslet_views::Error> {
        colour::convert(&mut pixels, from, to);
        Ok(sink.write(v, u, &pixels)?)
    };
    let there = (0..rows * columns).filter(|k| absent.binary_search(k).is_err());
    let all: Vec<_> = there.map(|k| (k / columns, k % columns)).collect();
    let mut options = Options { fit, ..Options::default() };
    // Stated in pixels of the views that are there, searched in those of the result.
    options.disparity.range = args.range.range.map(|(a, b)| (a * scale as f32, b * scale as f32));
    let refined = RefinedViews::estimate(set, &options, &context.progress)?;
    args.range.note(&refined.disparities().middle, scale as f32).iter().for_each(|note| context.progress.note(note));
    note_dark(&args.source.input, refined.dark(), rows * columns, context);
    refined.render_views(&all, &mut keep, &context.progress)?;
    let seconds = began.elapsed().as_secs_f64();
    context.progress.check()?;
    sink.finish()?;
    let [height, width] = meta.size;
    let out = args.written.out.display().to_string();
    let text = format!(
        "{out}: {rows}x{columns} views{} of {width}x{height} (enlarged by {scale}), {seconds:.1} s",
        but_absent(absent.len())
    );
    let json = json!({
        "out": out, "views": meta.views, "size": meta.size, "scale": scale, "seconds": seconds,
        "absent": absent.len(), "samples": matches!(given, Given::Samples(_)), "fit": fit.name(),
    });
    Ok(Outcome { json, text })
}
