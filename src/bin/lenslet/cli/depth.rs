//! `lenslet depth`: the disparity of a light field's middle view.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use lenslet::apps::depth;
use lenslet::image_io::{self, Picture};
use lenslet_core::input::read_regular;
use lenslet_core::output::{self, Kind, Pending, write_part};
use lenslet_core::pfm;
use lenslet_core::progress::Observer;
use lenslet_views::disparity::{self, DepthOrder};
use lenslet_views::multiview::depth_order_of;
use ndarray::{Array2, s};
use ndarray_npy::ReadNpyExt as _;
use serde_json::{Value, json};

use super::inputs::Input;
use super::source::ReadArgs;
use super::values::RangeArgs;
use super::written::check_folder_name;
use super::{Context, Outcome, Usage};

/// Longest file of true disparities that is read, bytes.
/// Source: chosen.
const MAX_TRUTH: u64 = 1 << 30;

/// Disparity and confidence of a light field's middle view: PFM, 16-bit PNG, colour picture, point cloud
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet depth decoded/ --out depth/

Writes disparity.pfm, confidence.pfm, disparity.png (16 bits, from the smallest to the largest disparity found; see
depth.json), colours.png, points.ply. Confidence is the chance that a disparity is within 0.07 of the true one.
Disparity D: what is at x in the middle view is at x + D·u in the view u steps to the right. The HCI benchmark counts
it the other way round: compare with --truth gt.pfm --truth-scale=-1.")]
pub struct Args {
    /// The light field
    light_field: PathBuf,
    #[command(flatten)]
    range: RangeArgs,
    /// Fill patches up to this share of the picture's longer side whose disparity differs from all around; 0: leave
    /// them
    #[arg(value_parser = super::values::finite::<f32>, long, default_value_t = disparity::Options::shown().specks, value_name = "0..1")]
    specks: f32,
    /// Compare with this true disparity (.pfm or .npy of the view's size)
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Factor by which the truth is multiplied first
    #[arg(value_parser = super::values::finite::<f32>, long, default_value_t = 1.0, value_name = "FACTOR", allow_hyphen_values = true)]
    truth_scale: f32,
    /// Leave out this many pixels on each side when comparing
    #[arg(long, default_value_t = 15, value_name = "PIXELS")]
    border: usize,
    /// Leave points less confident than this out of the point cloud
    #[arg(value_parser = super::values::finite::<f32>, long, default_value_t = 0.6, value_name = "0..1")]
    confident: f32,
    #[command(flatten)]
    read: ReadArgs,
    /// Directory to write
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Replace what is there
    #[arg(long)]
    force: bool,
}

impl Args {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> Vec<(&Path, Input)> {
        let truth = self.truth.as_deref().map(|p| (p, Input::Map));
        std::iter::once((self.light_field.as_path(), Input::LightField)).chain(truth).collect()
    }
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    check_folder_name(&args.out)?;
    if !(0.0..=1.0).contains(&args.specks) {
        return Err(Usage(format!("--specks must be 0 to 1, not {}", args.specks)).into());
    }
    if !(0.0..=1.0).contains(&args.confident) {
        return Err(Usage(format!("--confident must be 0 to 1, not {}", args.confident)).into());
    }
    let mut inputs = vec![args.light_field.as_path()];
    inputs.extend(args.truth.as_deref());
    output::check_target(&args.out, Kind::Directory, args.force, &inputs)?;
    let (field, weights) = args.read.load_light(&args.light_field, true, context)?;
    let options = disparity::Options {
        range: args.range.range,
        specks: args.specks,
        weights: Some(weights.into_raw_vec_and_offset().0),
        ..disparity::Options::shown()
    };
    let start = std::time::Instant::now();
    let found = disparity::estimate_disparity(&field.data.view(), &options, &context.progress)?;
    let seconds = start.elapsed().as_secs_f64();
    let at_ends = args.range.note(&found, 1.0);
    at_ends.iter().for_each(|note| context.progress.note(note));
    let order = depth_order_of(&field.data.view(), &found.disparity)?;

    let [rows, columns] = field.meta.views;
    let middle = Picture::from_linear(&field.data.slice(s![rows / 2, columns / 2, .., .., ..]));
    let lo = found.disparity.iter().copied().fold(f32::INFINITY, f32::min);
    let hi = found.disparity.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let span = if hi > lo { hi - lo } else { 1.0 };
    // Near is bright.
    let near = found.disparity.mapv(|d| order.sign() * d);
    let ends = match order {
        DepthOrder::NearerIsSmaller => (-hi, -lo),
        DepthOrder::NearerIsLarger => (lo, hi),
    };
    let depth = 0.25 * middle.width as f32;
    let mean = f64::from(found.confidence.mean().unwrap_or(0.0));
    let mut json = json!({
        "out": args.out, "smallest": lo, "largest": hi, "nearer_is": if order == DepthOrder::NearerIsSmaller { "smaller" } else { "larger" },
        "mean_confidence": mean, "seconds": seconds, "searched": found.searched, "at_ends": found.share_at_ends(),
    });
    if let Some(path) = &args.truth {
        json["truth"] = compare(path, args, &found)?;
    }
    let pending = Pending::directory(&args.out, args.force)?;
    let write = |name: &str, bytes: Vec<u8>| {
        write_part(&pending.path().join(name), &bytes)
            .with_context(|| format!("cannot write {}", args.out.join(name).display()))
    };
    write("disparity.pfm", pfm::to_bytes(found.disparity.view()))?;
    write("confidence.pfm", pfm::to_bytes(found.confidence.view()))?;
    write("disparity.png", image_io::grey16_png(&found.disparity.mapv(|d| (d - lo) / span))?)?;
    write("colours.png", depth::colour_map(&near.view(), ends).to_png()?)?;
    write(
        "points.ply",
        depth::point_cloud_ply(&found.disparity, &found.confidence, &middle, order, depth, args.confident)?,
    )?;
    write("depth.json", serde_json::to_vec_pretty(&json)?)?;
    pending.commit()?;
    let mut text =
        format!("disparity {lo:.3} to {hi:.3}, mean confidence {mean:.2}, {seconds:.1} s: {}", args.out.display());
    if let Some(all) = json.get("truth").and_then(|t| t.get("all")) {
        text.push_str(&format!("\nagainst the truth: {all}"));
    }
    Ok(Outcome { json, text })
}

fn compare(path: &Path, args: &Args, found: &disparity::Disparity) -> anyhow::Result<Value> {
    let name = path.display();
    let mut truth = read_map(path)?;
    truth.mapv_inplace(|d| d * args.truth_scale);
    anyhow::ensure!(
        truth.dim() == found.disparity.dim(),
        "{name} has {:?} pixels, the views {:?}",
        truth.dim(),
        found.disparity.dim()
    );
    let (height, width) = truth.dim();
    if 2 * args.border.min(usize::MAX / 2) >= height.min(width) {
        return Err(Usage(format!("--border {} leaves nothing of {width}x{height} pixels", args.border)).into());
    }
    let told = |least: f32| {
        disparity::compare_with_truth(&found.disparity, &truth, args.border, 0.07, |t, s| {
            found.confidence[[t, s]] >= least
        })
        .map(|e| json!({ "bad_0.07": e.bad, "mse_x100": e.mse100, "median": e.median, "pixels": e.pixels }))
    };
    let curve: Vec<Value> = disparity::confidence_curve(found, &truth, args.border, 0.07)
        .iter()
        .map(|bin| json!({ "said": bin.said, "within": bin.within, "share": bin.share }))
        .collect();
    Ok(json!({
        "all": told(0.0), "confident_0.5": told(0.5), "confident_0.9": told(0.9), "confidence": curve
    }))
}

/// A map of disparities: PFM, or a .npy of two dimensions.
fn read_map(path: &Path) -> anyhow::Result<Array2<f32>> {
    let name = path.display();
    let bytes = read_regular(path, MAX_TRUTH).with_context(|| format!("cannot read {name}"))?;
    let length = bytes.len() as u64;
    let map = if bytes.starts_with(b"\x93NUMPY") {
        // Its numbers are in the file, whatever its header says.
        let text = String::from_utf8_lossy(&bytes[..bytes.len().min(256)]).into_owned();
        let claimed = text.split_once("'shape': (").and_then(|(_, s)| s.split_once(')')).map_or("", |(s, _)| s);
        let sides: Vec<u64> = claimed.split(',').filter_map(|n| n.trim().parse().ok()).collect();
        let count = sides.iter().try_fold(1u64, |a, &b| a.checked_mul(b));
        anyhow::ensure!(count.is_some_and(|n| n <= length), "{name}: it says {claimed}, more than it holds");
        if text.contains("<f8") {
            let map = Array2::<f64>::read_npy(&bytes[..])
                .with_context(|| format!("{name} is not an .npy of two dimensions"))?;
            map.mapv(|d| d as f32)
        } else {
            Array2::<f32>::read_npy(&bytes[..])
                .with_context(|| format!("{name} is not an .npy of two dimensions of f32 or f64"))?
        }
    } else {
        pfm::from_bytes(&bytes).with_context(|| format!("{name}"))?
    };
    let bad = map.iter().filter(|d| !d.is_finite()).count();
    if bad > 0 {
        let at = map.indexed_iter().find(|(_, d)| !d.is_finite()).map_or((0, 0), |(at, _)| at);
        anyhow::bail!(
            "{name}: {bad} of {} values are not finite numbers, the first at row {}, column {}",
            map.len(),
            at.0,
            at.1
        );
    }
    Ok(map)
}
