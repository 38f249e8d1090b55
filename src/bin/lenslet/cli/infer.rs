//! `lenslet infer`: learned reconstruction of a light field.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use lenslet_core::dictionary::{Footprint, Model};
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::{self, Meta, ViewOrigin};
use lenslet_core::progress::Observer;
use lenslet_views::multiview::Fit;
use lenslet_views::reconstruct::{self, Available, Enlargement, Options, Reconstructor};
use serde_json::json;

use super::belong;
use super::inputs::Input;
use super::learned::LearnedArgs;
use super::source::{SourceArgs, absent_places, but_absent, file_name, measured_samples};
use super::written::Written;
use super::{Context, Outcome, Usage, dict};

/// Learned reconstruction of a light field
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet infer barycentric.lf --out learned.lf
         lenslet infer other-tool/ --out sharp/ --scale 3
         lenslet infer rectified.eslf.png --views 14 --out sharp.npy --fast

Light fields decoded by lenslet have their final size already, and results are back-projected onto the measured samples
beside them (samples.npz). Those of other tools are enlarged first, bicubically, by --scale (default: the dictionary's
pitch, rounded), as if each of their pixels were a sample; their embedded dictionary is x2 or x3, by --scale.")]
pub struct Args {
    #[command(flatten)]
    source: SourceArgs,
    #[command(flatten)]
    written: Written,
    /// Factor by which the views are enlarged first, 1 to 16 [default: 1, or the dictionary's own for a light field of
    /// another tool]
    #[arg(value_parser = super::values::finite::<f64>, long, value_name = "N")]
    scale: Option<f64>,
    /// Do not use the measured samples (samples.npz) beside the light field
    #[arg(long, conflicts_with = "noise")]
    without_samples: bool,
    #[command(flatten)]
    learned: LearnedArgs,
}

impl Args {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> Vec<(&Path, Input)> {
        std::iter::once(self.source.as_input()).chain(self.learned.inputs()).collect()
    }
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    if args.scale.is_some_and(|s| !(1.0..=16.0).contains(&s)) {
        return Err(Usage("--scale must be 1 to 16".into()).into());
    }
    args.learned.check()?;
    let mut inputs = vec![args.source.input.as_path()];
    inputs.extend(args.learned.dictionary.as_deref());
    args.written.check(&inputs)?;
    // A dictionary that cannot be used ends the run before anything is read or noted.
    let given = args.learned.dictionary.as_deref().map(dict::find).transpose()?;
    let source = args.source.open(context)?;
    belong::refuse_learned(source.meta(), &args.source.input)?;
    let absent = absent_places(&*source)?.len();
    let mut meta = source.meta().clone();
    let footprint = args.learned.footprint();
    // Pixels of another tool are points of a rectangular grid.
    let plain = meta.pitch.is_none() && footprint == Footprint::Point;
    let grid = if plain && args.learned.dictionary.is_none() { dict::for_grid(args.scale) } else { None };
    let (name, footprint) = match (&args.learned.dictionary, grid) {
        (Some(name), _) => (name.clone(), footprint),
        (None, Some(grid)) => (grid.to_path_buf(), Footprint::Grid),
        (None, None) => (PathBuf::from(embedded_name(&meta)), footprint),
    };
    let found = given.map_or_else(|| dict::find(&name), Ok)?;
    let options = Options { footprint, ..args.learned.options() };
    let mode = options.mode.name();
    // Samples belong to views of the size that they were interpolated at.
    let enlarged = args.scale.map_or(meta.pitch.is_none(), |scale| scale != 1.0);
    let of_samples = matches!(meta.method, Some(ViewOrigin::Interpolated(i)) if i != Interpolation::Bicubic);
    let samples = if of_samples && !enlarged {
        measured_samples(&args.source.input, &*source, args.without_samples)?
    } else {
        None
    };
    let available = if samples.is_some() { Available::Samples } else { Available::ViewAlone };
    let reconstructor =
        Reconstructor::with(&found, &options, available).with_context(|| format!("dictionary {}", name.display()))?;
    let predictor = reconstructor.plan().to_string();
    context.progress.note(&format!("views are reconstructed by: {predictor} (dictionary {})", name.display()));
    let model = reconstructor.model();
    if model.footprint != footprint && args.learned.names_footprint() {
        context
            .progress
            .note(&format!("the dictionary has no model for {footprint} samples; {} is used", model.footprint));
    }
    if let Some(note) = note_of_other_fit(&meta, model) {
        context.progress.note(&note);
    }

    let scale = match (args.scale, meta.pitch) {
        (Some(scale), _) => scale,
        (None, Some(_)) => 1.0,
        (None, None) => model.pitch.round().max(1.0),
    };
    let pitch = scale * meta.pitch.unwrap_or(1.0);
    if (pitch / model.pitch - 1.0).abs() > 0.15 {
        context.progress.note(&format!(
            "samples lie {pitch:.2} pixels apart, the dictionary was trained for {:.2}: expect lower quality; choose --scale {:.2}",
            model.pitch,
            scale * model.pitch / pitch
        ));
    }
    let enlargement = if scale == 1.0 { Enlargement::None } else { Enlargement::Bicubic(scale) };
    meta.size = enlargement.size(meta.size);
    meta.pitch = Some(pitch);
    meta.colour = args.written.colour();
    meta.method = Some(ViewOrigin::Learned);
    meta.predictor = Some(predictor.clone());
    meta.provenance.push(json!({
        "tool": "lenslet", "version": env!("CARGO_PKG_VERSION"), "command": "infer",
        "input": args.source.name(),
        "dictionary": file_name(&name), "mode": mode, "predictor": predictor, "footprint": model.footprint, "scale": scale,
    }));
    let format = args.written.format()?;
    let mut sink = lightfield::create(&args.written.out, meta.clone(), format, args.written.force)?;
    let began = std::time::Instant::now();
    reconstruct::reconstruct_light_field(
        &*source,
        &mut *sink,
        meta.colour,
        &reconstructor,
        enlargement,
        samples.as_ref().map(|s| (s, args.learned.noise)),
        &context.progress,
    )?;
    let seconds = began.elapsed().as_secs_f64();
    context.progress.check()?;
    sink.finish()?;
    let ([rows, columns], [height, width]) = (meta.views, meta.size);
    let out = args.written.out.display().to_string();
    let text = format!(
        "{out}: {rows}x{columns} views{} of {width}x{height} (enlarged by {scale}) by {predictor}, {seconds:.1} s",
        but_absent(absent)
    );
    let json = json!({
        "out": out, "views": meta.views, "size": meta.size, "scale": scale, "seconds": seconds,
        "absent": absent, "footprint": model.footprint, "mode": mode, "predictor": predictor,
        "samples": samples.is_some(),
        "dictionary": name.display().to_string(),
    });
    Ok(Outcome { json, text })
}

/// What to say where refined views were made by another fit than those that the model was made for. Earlier descriptions
/// name the fit only where it was asked for: least squares was usual.
fn note_of_other_fit(meta: &Meta, model: &Model) -> Option<String> {
    if meta.method != Some(Interpolation::Multiview.into()) || model.base != Interpolation::Multiview {
        return None;
    }
    let made = meta.provenance.iter().rev().find(|step| step["command"] == "decode" || step["command"] == "refine")?;
    let by = made["fit"].as_str().unwrap_or(Fit::LeastSquares.name());
    let made_for = Fit::for_dictionary(model.footprint);
    Some(format!("{}; decode or refine with --fit {}", made_for.note_of_other(by)?, made_for.name()))
}

/// The embedded dictionary for views made as the description has it.
fn embedded_name(meta: &Meta) -> &'static str {
    let refined = meta.method == Some(Interpolation::Multiview.into());
    reconstruct::embedded_name_for(if refined { Interpolation::Multiview } else { Interpolation::Barycentric })
}
