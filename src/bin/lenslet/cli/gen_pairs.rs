//! `lenslet gen-pairs`: training pairs out of photos.

use std::path::{Path, PathBuf};

use lenslet_core::dictionary::{self, Footprint};
use lenslet_core::lightfield::ColourSpace;
use lenslet_core::output::{self, Kind};
use lenslet_core::progress::Observer;
use lenslet_data_gen::pairs::{self, Crop, CropOptions, Degradation, Manifest, PatchOptions};
use lenslet_data_gen::photo::PhotoSet;
use serde_json::json;

use super::inputs::{Input, each};
use super::values::FootprintName;
use super::written::check_folder_name;
use super::{Context, Outcome, Usage};

/// Cut training pairs out of photos
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet gen-pairs my-photos/ --out pairs/ --pairs 50000

Writes features.npy (N x m), residuals.npy (N x patch²), filters.npy (m x (window+4)²) and manifest.json. A feature
vector is filters times the window of the interpolated image; a residual is sharp minus interpolated. Neither is
normalised: training divides both by max(norm of the features, 0.05).")]
pub struct Args {
    /// Photos, or folders of photos
    #[arg(required = true, value_name = "PHOTO")]
    photos: Vec<PathBuf>,
    /// The folder to write
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Pairs, at most
    #[arg(long, default_value_t = 100_000, value_name = "N")]
    pairs: usize,
    /// Side of a patch, pixels
    #[arg(long, default_value_t = 9, value_name = "P")]
    patch: usize,
    /// Side of the window of the features, pixels
    #[arg(long, default_value_t = 9, value_name = "P")]
    window: usize,
    /// Features kept
    #[arg(long, default_value_t = 48, value_name = "M")]
    features: usize,
    /// Crops a photo
    #[arg(long, default_value_t = 6, value_name = "N")]
    crops: usize,
    /// Side of a crop, pixels
    #[arg(long, default_value_t = 256, value_name = "N")]
    crop: usize,
    /// Factor by which photos are shrunk first (1 to 1000)
    #[arg(value_parser = super::values::finite::<f64>, long, default_value_t = 1.5, value_name = "F")]
    shrink: f64,
    /// What a sample is: the mean over the lenslet, or a point
    #[arg(long, value_enum, default_value = "lenslet")]
    footprint: FootprintName,
    /// Standard deviation of noise on the samples, of the range 0..1
    #[arg(value_parser = super::values::finite::<f32>, long, default_value_t = 0.0, value_name = "S")]
    noise: f32,
    /// Seed
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
    /// Replace an existing folder
    #[arg(long)]
    force: bool,
}

impl Args {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> Vec<(&Path, Input)> {
        each(&self.photos, Input::Photos).collect()
    }
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    if !(1..=10_000_000).contains(&args.pairs)
        || !(1..=10_000).contains(&args.crops)
        || !(32..=4096).contains(&args.crop)
    {
        return Err(Usage("--pairs up to 10000000, --crops 1 to 10000, --crop 32 to 4096".into()).into());
    }
    let inputs: Vec<&Path> = args.photos.iter().map(PathBuf::as_path).collect();
    check_folder_name(&args.out)?;
    output::check_target(&args.out, Kind::Directory, args.force, &inputs)?;
    let footprint = Footprint::from(args.footprint);
    let degradation = Degradation { footprint, noise: args.noise, ..Degradation::default() };
    let options =
        CropOptions { size: args.crop, shrink: args.shrink, degradation: degradation.clone(), seed: args.seed };
    let mut crops: Vec<Crop> = Vec::new();
    let report = PhotoSet::find(&args.photos, ColourSpace::Srgb)?.for_each(&context.progress, |n, _, photo| {
        crops.extend(pairs::cut_crops(photo, n, args.crops, &options).map_err(usage)?);
        anyhow::Ok(())
    })?;
    context.progress.begin("pairs", 0);
    let (filters, kept) = pairs::learn_filters(&crops, args.window, args.features).map_err(usage)?;
    let options = PatchOptions {
        patch: args.patch,
        window: args.window,
        per_crop: args.pairs.div_ceil(crops.len()),
        seed: args.seed,
        ..PatchOptions::default()
    };
    let pairs = pairs::extract_pairs(&crops, &filters, &[filters.nrows()], &options).map_err(usage)?;
    let mut pairs_of_photo = vec![0; report.used.len()];
    pairs.photos.iter().for_each(|&p| pairs_of_photo[p as usize] += 1);
    let manifest = Manifest {
        version: 1,
        tool: format!("lenslet {}", env!("CARGO_PKG_VERSION")),
        pairs: pairs.features.nrows(),
        arrays: json!({
            "features.npy": "N x m, filters times the window of the interpolated luminance (sRGB-encoded, 0..1)",
            "residuals.npy": "N x patch², sharp minus interpolated, rows first",
            "filters.npy": "m x (window+4)², rows sum to zero",
            "normalisation": "none; training divides both by max(norm of the features, 0.05)",
        }),
        parameters: json!({
            "patch": args.patch, "window": args.window, "features": args.features, "energy_kept": kept,
            "crops": args.crops, "crop": args.crop, "shrink": args.shrink, "footprint": footprint,
            "base": degradation.base, "pitch": degradation.pitch, "rotation": degradation.rotation,
            "noise": args.noise, "flat": options.min_norm, "seed": args.seed, "generator": "ChaCha8",
        }),
        photos: report.used,
        pairs_of_photo,
        skipped: report.skipped,
    };
    context.progress.check()?;
    pairs::write_pairs(&args.out, &pairs, &filters, &manifest, args.force)?;
    let text = format!(
        "{}: {} pairs from {} photos ({} left out), {:.1} % of the gradients' energy in {} features",
        args.out.display(),
        manifest.pairs,
        manifest.photos.len(),
        manifest.skipped.len(),
        100.0 * kept,
        args.features
    );
    let json = json!({
        "out": args.out.display().to_string(), "pairs": manifest.pairs, "photos": manifest.photos.len(),
        "skipped": manifest.skipped, "energy_kept": kept,
    });
    Ok(Outcome { json, text })
}

/// A number out of range is wrong usage.
fn usage(error: pairs::Error) -> anyhow::Error {
    match error {
        pairs::Error::Parameter(why) | pairs::Error::Dictionary(dictionary::Error::Parameter(why)) => Usage(why).into(),
        other => other.into(),
    }
}
