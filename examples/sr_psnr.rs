//! Scores plain super-resolution of rectangular grids as publications do:
//! `cargo run --release --example sr_psnr -- --dictionary FILE [--scale N] [--step N] [--ensemble N] [--lambda L] IMAGE…`
//!
//! Luminance is that of ITU-R BT.601 in studio range (Y of MATLAB's rgb2ycbcr, grey images as they are), in 8 bits; sides are
//! cut to multiples of the scale (default: the dictionary's pitch), shrunk by antialiased bicubic interpolation (a = −½),
//! not rounded, enlarged bicubically, reconstructed, rounded to 8 bits; a border as wide as the scale is left out, the
//! peak is 255. Prints one JSON object: mean PSNR in dB and wall seconds an image by method, and the images.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Context, ensure};
use clap::Parser as _;
use image::DynamicImage;
use lenslet_core::dictionary::{self, Footprint, PatchPredictor};
use lenslet_core::geometry::Size;
use lenslet_core::sampling::bicubic;
use lenslet_data_gen::photo::{ReductionKernel, reduce_plane};
use lenslet_views::reconstruct::{Mode, Options, Reconstructor};
use ndarray::{Array2, Axis, s};
use serde_json::{Value, json};

/// Scores plain super-resolution of rectangular grids
#[derive(clap::Parser)]
struct Arguments {
    /// Dictionary file
    #[arg(long)]
    dictionary: PathBuf,
    /// Enlargement (default: the dictionary's pitch)
    #[arg(long)]
    scale: Option<usize>,
    /// Pixels between patches
    #[arg(long)]
    step: Option<usize>,
    /// Copies averaged: 1, 2 or 4
    #[arg(long)]
    ensemble: Option<usize>,
    /// λ instead of the trained one
    #[arg(long)]
    lambda: Option<f32>,
    /// Photos
    #[arg(required = true)]
    images: Vec<PathBuf>,
}

/// Luminance in whole 8-bit steps, 0 to 255.
fn luminance(photo: &DynamicImage) -> Array2<f32> {
    let size = (photo.height() as usize, photo.width() as usize);
    if photo.color().has_color() {
        let rgb = photo.to_rgb8();
        Array2::from_shape_fn(size, |(y, x)| {
            let [r, g, b] = rgb.get_pixel(x as u32, y as u32).0.map(f32::from);
            (16.0 + (65.481 * r + 128.553 * g + 24.966 * b) / 255.0).round()
        })
    } else {
        let grey = photo.to_luma8();
        Array2::from_shape_fn(size, |(y, x)| f32::from(grey.get_pixel(x as u32, y as u32).0[0]))
    }
}

/// PSNR of a plane of 0..1 against one of 0..255, the border left out.
fn psnr(result: &Array2<f32>, truth: &Array2<f32>, border: usize) -> f64 {
    let (h, w) = truth.dim();
    let inner = s![border..h - border, border..w - border];
    let square = |(a, t): (&f32, &f32)| f64::from((255.0 * a).round().clamp(0.0, 255.0) - t).powi(2);
    let (result, truth) = (result.slice(inner), truth.slice(inner));
    let mean = result.iter().zip(truth).map(square).sum::<f64>() / truth.len() as f64;
    10.0 * (255.0f64.powi(2) / mean.max(1e-10)).log10()
}

#[allow(clippy::print_stdout)]
fn main() -> anyhow::Result<()> {
    let a = Arguments::parse();
    let dictionary = dictionary::load(&a.dictionary)?;
    let Arguments { step, ensemble, lambda, .. } = a;
    let options = Options { footprint: Footprint::Grid, step, ensemble, lambda, ..Options::default() };
    // `learned` is the LASSO codes, `fast` the anchored regressors; no codes leave the bicubic enlargement as it is.
    let modes = [
        ("ridge", Mode::Only(PatchPredictor::Ridge)),
        ("fast", Mode::Fast),
        ("learned", Mode::Learned),
        ("best", Mode::Best),
    ];
    let mut methods = Vec::new();
    for (name, mode) in modes {
        methods.push((name, Reconstructor::new(&dictionary, &Options { mode, ..options.clone() })?));
    }
    let scale = a.scale.unwrap_or(methods[0].1.model().pitch.round() as usize);
    ensure!((2..=8).contains(&scale), "--scale {scale} is out of range (2 to 8)");
    let mut sums: BTreeMap<&str, [f64; 2]> = BTreeMap::new();
    let mut images = Vec::new();
    for path in &a.images {
        let photo = image::open(path).with_context(|| format!("cannot read {}", path.display()))?;
        let whole = luminance(&photo);
        let (h, w) = (whole.nrows() / scale * scale, whole.ncols() / scale * scale);
        ensure!(h.min(w) > 8 * scale, "{}: {w}x{h} pixels are too few", path.display());
        let truth = whole.slice(s![..h, ..w]).to_owned();
        let small = reduce_plane(truth.mapv(|v| v / 255.0).view(), h / scale, w / scale, ReductionKernel::Bicubic)?;
        let low =
            bicubic::resize_bicubic(small.insert_axis(Axis(2)).view(), Size::new(w, h))?.index_axis_move(Axis(2), 0);
        let mut entry = serde_json::Map::new();
        entry.insert("file".into(), path.display().to_string().into());
        let mut add = |name: &'static str, result: &Array2<f32>, seconds: f64| {
            let score = psnr(result, &truth, scale);
            entry.insert(name.into(), json!(score));
            let sum = sums.entry(name).or_default();
            sum[0] += score / a.images.len() as f64;
            sum[1] += seconds / a.images.len() as f64;
        };
        add("bicubic", &low, 0.0);
        for (name, method) in &methods {
            let began = std::time::Instant::now();
            let result = method.reconstruct_plane(low.view(), &[])?;
            add(name, &result, began.elapsed().as_secs_f64());
        }
        images.push(Value::Object(entry));
    }
    let mean: serde_json::Map<String, Value> = sums
        .into_iter()
        .map(|(name, [psnr, seconds])| (name.to_string(), json!({ "psnr": psnr, "seconds": seconds })))
        .collect();
    println!("{}", json!({ "scale": scale, "mean": mean, "images": images }));
    Ok(())
}
