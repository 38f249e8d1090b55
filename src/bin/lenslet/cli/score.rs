//! `lenslet score`: PSNR and SSIM of a light field against another, view by view and in the mean.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use lenslet_core::geometry::Size;
use lenslet_core::lightfield::{self, ColourSpace, ViewSource, colour};
use lenslet_core::metrics::{Alignment, Scores, Window};
use lenslet_core::progress::Observer;
use ndarray::Array3;
use serde_json::{Map, Value, json};

use super::inputs::Input;
use super::source::{ReadArgs, absent_places};
use super::values::SsimName;
use super::{Context, Outcome, Usage};

/// Score a light field (or picture) against a reference: PSNR of colour and luminance, SSIM of luminance
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet score decoded/ truth/sharp/ --border 12

Values are compared as sRGB-encoded 0..1 (two linear light fields: as they are). `mean` is the mean over views of
each view's score. A view equal to its reference has no finite PSNR: it is null, marked `identical`, and left out of
the mean. SSIM is that of scikit-image with gaussian_weights=True, sigma=1.5, use_sample_covariance=False.")]
pub struct Args {
    /// The light field or picture to score
    result: PathBuf,
    /// The reference: a light field or picture of the same views and size
    reference: PathBuf,
    /// Leave out this many pixels on each side
    #[arg(long, default_value_t = 0, value_name = "PIXELS")]
    border: usize,
    /// Window of SSIM: gaussian (11x11, sigma 1.5) or uniform (7x7, scikit-image's default)
    #[arg(long, value_enum, default_value = "gaussian")]
    ssim: SsimName,
    /// First register the result onto the reference (affine map, gain and offset of each channel, found on the middle
    /// view): for results of tools with another geometry or exposure. The sizes may differ. The alignment is reported
    #[arg(long)]
    align: bool,
    #[command(flatten)]
    read: ReadArgs,
}

impl Args {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> Vec<(&Path, Input)> {
        [&self.result, &self.reference].map(|p| (p.as_path(), Input::LightField)).to_vec()
    }
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    let result = args.read.open(&args.result, context)?;
    let reference = args.read.open(&args.reference, context)?;
    comparable(result.as_ref(), reference.as_ref(), args)?;
    if let Some(note) = note_of_gathered_truth(result.meta(), reference.meta(), &args.reference) {
        context.progress.note(&note);
    }
    let window = Window::without_border(args.border).with_ssim(args.ssim.into());
    let both_linear = [&result, &reference].iter().all(|l| l.meta().colour == ColourSpace::Linear);
    let [rows, columns] = result.meta().views;

    let read = |source: &dyn ViewSource, v: usize, u: usize| -> anyhow::Result<Array3<f32>> {
        let mut view = source.read(v, u)?;
        if !both_linear {
            colour::convert(&mut view, source.meta().colour, ColourSpace::Srgb);
        }
        Ok(view)
    };
    let absent = absent_from_either(result.as_ref(), reference.as_ref())?;
    // The view nearest to the middle that both have.
    let off = |k: &usize| (k / columns).abs_diff(rows / 2).pow(2) + (k % columns).abs_diff(columns / 2).pow(2);
    let Some(middle) = (0..rows * columns).filter(|k| !absent.contains(k)).min_by_key(off) else {
        anyhow::bail!(
            "{} and {} have no view in common: of each place one of them is absent",
            args.result.display(),
            args.reference.display()
        );
    };
    let alignment = if args.align {
        let (v, u) = (middle / columns, middle % columns);
        let (a, b) = (read(result.as_ref(), v, u)?, read(reference.as_ref(), v, u)?);
        Some(
            Alignment::estimate(a.view(), b.view())
                .with_context(|| format!("cannot align {}", args.result.display()))?,
        )
    } else {
        None
    };
    context.progress.begin("scoring views", (rows * columns) as u64);
    let mut views = Vec::new();
    for v in 0..rows {
        for u in 0..columns {
            context.progress.check()?;
            if absent.contains(&(v * columns + u)) {
                context.progress.advance(1);
                continue;
            }
            let mut view = read(result.as_ref(), v, u)?;
            let truth = read(reference.as_ref(), v, u)?;
            if let Some(alignment) = &alignment {
                view = alignment.apply(view.view(), Size::new(truth.dim().1, truth.dim().0));
            }
            let scores = Scores::between(view.view(), truth.view(), &window)
                .with_context(|| format!("view ({v}, {u}) of {}", args.result.display()))?;
            views.push((v, u, scores));
            context.progress.advance(1);
        }
    }
    Ok(outcome(&views, absent.len(), if both_linear { "linear" } else { "srgb" }, alignment.as_ref(), args))
}

/// Refuses two light fields that cannot be compared, with the reason.
fn comparable(result: &dyn ViewSource, reference: &dyn ViewSource, args: &Args) -> anyhow::Result<()> {
    let (a, b) = (result.meta(), reference.meta());
    let tell = |path: &Path, m: &lightfield::Meta| {
        let [rows, columns] = m.views;
        let [height, width] = m.size;
        format!("{} has {rows}x{columns} views of {width}x{height}", path.display())
    };
    if a.views != b.views || (a.size != b.size && !args.align) {
        anyhow::bail!(
            "{}, but {}; they can be scored only when both agree{}",
            tell(&args.result, a),
            tell(&args.reference, b),
            if a.views == b.views { ", or with --align" } else { "" }
        );
    }
    if 2 * args.border.min(usize::MAX / 2) >= b.size[0].min(b.size[1]) {
        let [height, width] = b.size;
        return Err(Usage(format!("--border {} leaves nothing of {width}x{height} pixels", args.border)).into());
    }
    Ok(())
}

/// What to say where sharp views are compared with what lenslets gather of the scene.
fn note_of_gathered_truth(result: &lightfield::Meta, reference: &lightfield::Meta, path: &Path) -> Option<String> {
    let gathered = reference.provenance.iter().any(|step| step["truth"] == "gathered");
    let sharp = result.provenance.iter().any(|step| step["fit"] == "joint" || step["footprint"] == "lenslet");
    (gathered && sharp).then(|| {
        format!(
            "{} is the scene blurred as lenslets gather it; these views are made to reach the sharp one and score less here: compare \
             them with truth/sharp beside it",
            path.display()
        )
    })
}

/// Places that either of them lacks.
fn absent_from_either(result: &dyn ViewSource, reference: &dyn ViewSource) -> anyhow::Result<BTreeSet<usize>> {
    let mut absent: BTreeSet<usize> = absent_places(result)?.into_iter().collect();
    absent.extend(absent_places(reference)?);
    Ok(absent)
}

/// Mean of the finite values, null when there is none.
fn mean(values: impl Iterator<Item = f64>) -> Value {
    let finite: Vec<f64> = values.filter(|x| x.is_finite()).collect();
    if finite.is_empty() { Value::Null } else { json!(finite.iter().sum::<f64>() / finite.len() as f64) }
}

fn outcome(
    views: &[(usize, usize, Scores)],
    absent: usize,
    compared: &str,
    alignment: Option<&Alignment>,
    args: &Args,
) -> Outcome {
    let identical = views.iter().filter(|v| v.2.psnr_rgb.is_infinite()).count();
    let of = |pick: fn(&Scores) -> f64| mean(views.iter().map(|v| pick(&v.2)));
    let mean = json!({"psnr_rgb": of(|s| s.psnr_rgb), "psnr_y": of(|s| s.psnr_y), "ssim_y": of(|s| s.ssim_y)});
    let list: Vec<Value> = views
        .iter()
        .map(|(v, u, s)| {
            // serde_json writes an infinite number as null.
            let mut one = json!({"v": v, "u": u, "psnr_rgb": s.psnr_rgb, "psnr_y": s.psnr_y, "ssim_y": s.ssim_y});
            if let (true, Some(one)) = (s.psnr_rgb.is_infinite(), one.as_object_mut()) {
                one.insert("identical".into(), json!(true));
            }
            one
        })
        .collect();
    let mut object = Map::new();
    object.insert("mean".into(), mean.clone());
    object.insert("views".into(), json!(list));
    object.insert("absent".into(), json!(absent));
    object.insert("compared".into(), json!(compared));
    object.insert("ssim".into(), json!(args.ssim));
    object.insert("border".into(), json!(args.border));
    if let Some(alignment) = alignment {
        object.insert("alignment".into(), json!(alignment));
    }
    let show = |key: &str, unit: &str, digits: usize| match mean[key].as_f64() {
        Some(x) => format!("{x:.digits$}{unit}"),
        None => "equal".into(),
    };
    let mut text = format!(
        "mean of {} views: PSNR {} (colour), {} (luminance), SSIM {} (luminance)",
        views.len(),
        show("psnr_rgb", " dB", 2),
        show("psnr_y", " dB", 2),
        show("ssim_y", "", 4)
    );
    if absent > 0 {
        text = format!("{text}\n{absent} of {} views are absent and not scored", views.len() + absent);
    }
    if identical > 0 {
        let note = format!("{identical} of {} views equal their reference; the mean PSNR leaves them out", views.len());
        text = format!("{text}\n{note}");
        object.insert("note".into(), json!(note));
    }
    if let Some(Alignment { affine: a, .. }) = alignment {
        text = format!(
            "{text}\naligned: x = {:.5} s {:+.5} t {:+.3}, y = {:.5} s {:+.5} t {:+.3}",
            a[0], a[1], a[2], a[3], a[4], a[5]
        );
    }
    Outcome { json: Value::Object(object), text }
}
