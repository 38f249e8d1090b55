//! `lenslet infer`

use std::path::PathBuf;

use lenslet_core::decode::{HexSamples, npz};
use lenslet_core::dictionary::{Footprint, Interpolation};
use lenslet_core::lightfield::{self, ColourSpace, Meta, ReadOptions, ViewOrigin};
use lenslet_core::progress::Observer;
use lenslet_views::reconstruct::{self, Enlargement, Mode, Options, Reconstructor};
use serde_json::json;

use super::written::Written;
use super::{Context, Outcome, Usage, dict, score};

/// Learned reconstruction of a light field
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet infer barycentric.lf --out learned.lf
         lenslet infer other-tool/ --out sharp/ --scale 3
         lenslet infer rectified.eslf.png --views 14 --out sharp.npy --fast

Light fields decoded by lenslet have their final size already, and the samples measured beside them stay true. Those of
other tools are enlarged first, bicubically, by --scale (default: the dictionary's pitch, rounded), as if each of their
pixels were a sample.")]
pub struct Args {
    /// The light field, in any format that convert reads
    input: PathBuf,
    #[command(flatten)]
    written: Written,
    /// Dictionary: a file, or a name (default: the embedded one for views of this kind: default, or multiview for refined
    /// ones; for views of other tools x2 or x3, by --scale)
    #[arg(long, value_name = "NAME|FILE")]
    dictionary: Option<PathBuf>,
    /// Anchored regressors (the network for refined views), patches further apart: faster
    #[arg(long)]
    fast: bool,
    /// LASSO codes and network together, averaged over four mirrored copies of each view: slower
    #[arg(long, conflicts_with = "fast")]
    best: bool,
    /// How residuals are found, instead of LASSO codes for interpolated views and the network for refined ones
    #[arg(long, conflicts_with_all = ["fast", "best"], value_parser = ["lasso", "network", "anchored", "ridge"])]
    path: Option<String>,
    /// What a sample of the light field saw
    #[arg(long, default_value = "point", value_parser = ["point", "lenslet"])]
    footprint: String,
    /// Enlarge the views by this first
    #[arg(long, value_name = "N")]
    scale: Option<f64>,
    /// Pixels between patches
    #[arg(long, value_name = "N")]
    step: Option<usize>,
    /// λ instead of the trained one
    #[arg(long, value_name = "L")]
    lambda: Option<f32>,
    /// Standard deviation of the samples' noise (sRGB-encoded, 0..1), where they lie beside the light field [default: estimated]
    #[arg(long, value_name = "S")]
    noise: Option<f32>,
    /// Do not use the measured samples (samples.npz) beside the light field
    #[arg(long, conflicts_with = "noise")]
    without_samples: bool,
    /// Views (N or ROWSxCOLUMNS) of a lenslet picture, or of pictures numbered in a row
    #[arg(long, value_name = "N", value_parser = score::parse_views)]
    views: Option<[usize; 2]>,
    /// The input holds linear light, and does not say so itself
    #[arg(long)]
    input_linear: bool,
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    if args.scale.is_some_and(|s| !(1.0..=16.0).contains(&s)) {
        return Err(Usage("--scale must be 1 to 16".into()).into());
    }
    if args.lambda.is_some_and(|l| !(0.0..=1.0).contains(&l)) || args.step == Some(0) {
        return Err(Usage("--lambda must be 0 to 1, and --step at least 1".into()).into());
    }
    if args.noise.is_some_and(|s| !(0.0..=1.0).contains(&s)) {
        return Err(Usage("--noise must be 0 to 1".into()).into());
    }
    let colour = args.input_linear.then_some(ColourSpace::Linear);
    let source = lightfield::open(&args.input, &ReadOptions { views: args.views, colour, ..ReadOptions::default() })?;
    let mut meta = source.meta().clone();
    let footprint = if args.footprint == "point" { Footprint::Point } else { Footprint::Lenslet };
    // Pixels of another tool are points of a rectangular grid.
    let plain = meta.pitch.is_none() && footprint == Footprint::Point;
    let grid = if plain && args.dictionary.is_none() { dict::for_grid(args.scale) } else { None };
    let (name, footprint) = match (&args.dictionary, grid) {
        (Some(name), _) => (name.clone(), footprint),
        (None, Some(grid)) => (grid.to_path_buf(), Footprint::Grid),
        (None, None) => (PathBuf::from(own(&meta)), footprint),
    };
    let found = dict::find(&name)?;
    let mode = match (args.path.as_deref(), args.fast, args.best) {
        (Some("lasso"), ..) => Mode::Lasso,
        (Some("network"), ..) => Mode::Network,
        (Some("anchored"), ..) => Mode::Anchored,
        (Some(_), ..) => Mode::Ridge,
        (_, true, _) => Mode::Fast,
        (_, _, true) => Mode::Best,
        _ => Mode::Learned,
    };
    let options = Options { mode, footprint, step: args.step, lambda: args.lambda, ..Options::default() };
    let reconstructor = Reconstructor::new(&found, &options)?;
    let model = reconstructor.model();
    if model.footprint != footprint {
        context
            .progress
            .note(&format!("the dictionary has no model for {footprint} samples; {} is used", model.footprint));
    }

    let scale = match (args.scale, meta.pitch) {
        (Some(scale), _) => scale,
        (None, Some(_)) => 1.0,
        (None, None) => model.pitch.round().max(1.0),
    };
    let pitch = scale * meta.pitch.unwrap_or(1.0);
    if (pitch / model.pitch - 1.0).abs() > 0.15 {
        context.progress.note(&format!(
            "samples lie {pitch:.2} pixels apart, the dictionary learned {:.2}: expect less; choose --scale {:.2}",
            model.pitch,
            scale * model.pitch / pitch
        ));
    }
    let enlargement = if scale == 1.0 { Enlargement::None } else { Enlargement::Bicubic(scale) };
    meta.size = enlargement.size(meta.size);
    meta.pitch = Some(pitch);
    meta.colour = args.written.colour();
    meta.method = Some(ViewOrigin::Learned);
    let input = args.input.file_name().map(|n| n.to_string_lossy().into_owned());
    meta.provenance.push(json!({
        "tool": "lenslet", "version": env!("CARGO_PKG_VERSION"), "command": "infer", "input": input,
        "dictionary": name.file_name().map(|n| n.to_string_lossy().into_owned()),
        "mode": format!("{mode:?}").to_lowercase(), "footprint": model.footprint, "scale": scale,
    }));
    let samples = if scale == 1.0
        && matches!(source.meta().method, Some(ViewOrigin::Interpolated(i)) if i != Interpolation::Bicubic)
    {
        measured(args)?
    } else {
        None
    };
    let format = args.written.format();
    let mut sink = lightfield::create(&args.written.out, meta.clone(), format, args.written.force)?;
    let began = std::time::Instant::now();
    reconstruct::reconstruct_light_field(
        &*source,
        &mut *sink,
        meta.colour,
        &reconstructor,
        enlargement,
        samples.as_ref().map(|s| (s, args.noise)),
        &context.progress,
    )?;
    let seconds = began.elapsed().as_secs_f64();
    context.progress.check()?;
    sink.finish()?;
    let ([rows, columns], [height, width]) = (meta.views, meta.size);
    let out = args.written.out.display().to_string();
    let text = format!("{out}: {rows}x{columns} views of {width}x{height} (enlarged by {scale}), {seconds:.1} s");
    let json = json!({
        "out": out, "views": meta.views, "size": meta.size, "scale": scale, "seconds": seconds,
        "footprint": model.footprint, "mode": format!("{mode:?}").to_lowercase(),
        "samples": samples.is_some(),
        "dictionary": name.display().to_string(),
    });
    Ok(Outcome { json, text })
}

/// The dictionary inside the program for a light field that says how its views were made.
fn own(meta: &Meta) -> &'static str {
    let refined = meta.method == Some(Interpolation::Multiview.into());
    reconstruct::name_for(if refined { Interpolation::Multiview } else { Interpolation::Barycentric })
}

/// The samples that decode left with the light field.
fn measured(args: &Args) -> anyhow::Result<Option<HexSamples>> {
    match npz::beside(&args.input) {
        Some(path) if !args.without_samples => Ok(Some(npz::load(&path)?)),
        _ => Ok(None),
    }
}
