//! Scores every method on photos sampled like a lenslet camera's view:
//! `cargo run --release --example hex_psnr -- [--dictionary FILE] [--footprint point|lenslet] [--seed N] IMAGE…`
//!
//! Crops each image to at most 1080×1080, samples its luminance on a hexagonal grid of pitch 1080/328 px, rotation 0.002
//! rad, random phase (`point`: bilinear at the lenslet centre; `lenslet`: mean over a disc one pitch wide), reconstructs by
//! every method, and prints one JSON object; 12 px of border are left out.
//! `learned` is the LASSO codes (`lasso` says the same), `fast` the anchored regressors 4 pixels apart (where there are any),
//! `best` the mean of LASSO and network; `NAME_true`: the measured samples put back, as `decode` does it; `no_codes`: the
//! samples put back into the barycentric image, and nothing learned.
//! For tables of quality against time: --only NAME,NAME --step N --ensemble N --lambda L.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::Parser as _;
use lenslet_core::dictionary::{self, Dictionary, Footprint, PatchPredictor};
use lenslet_core::geometry::Size;
use lenslet_core::lightfield::ColourSpace;
use lenslet_core::metrics::{BORDER, Scores, Window};
use lenslet_core::sampling::{self, Cubic, DEFAULT_PITCH, DEFAULT_ROTATION, Weights, bicubic, lattice_samples};
use lenslet_data_gen::photo::load_luminance;
use lenslet_views::reconstruct::{Mode, Options, Reconstructor, SamplingOperator, back_project, embedded_dictionary};
use ndarray::{Array2, ArrayView2, Axis, s};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde_json::{Value, json};

const SIDE: usize = 1080;

/// Scores every method on photos sampled like a lenslet camera's view
#[derive(clap::Parser)]
struct Arguments {
    /// Dictionary file (default: the embedded one)
    #[arg(long)]
    dictionary: Option<PathBuf>,
    /// What a sample is: point or lenslet
    #[arg(long, default_value = "point", value_parser = parse_footprint)]
    footprint: Footprint,
    /// Seed of the lattice's phase
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Pixels between patches
    #[arg(long)]
    step: Option<usize>,
    /// λ instead of the trained one
    #[arg(long)]
    lambda: Option<f32>,
    /// Copies averaged: 1, 2 or 4
    #[arg(long)]
    ensemble: Option<usize>,
    /// Only these methods
    #[arg(long, value_delimiter = ',')]
    only: Option<Vec<String>>,
    /// Photos
    #[arg(required = true)]
    images: Vec<PathBuf>,
}

fn parse_footprint(name: &str) -> Result<Footprint, String> {
    let known = [Footprint::Point, Footprint::Lenslet];
    known.into_iter().find(|f| f.to_string() == name).ok_or_else(|| "point or lenslet".to_owned())
}

impl Arguments {
    fn options(&self, mode: Mode) -> Options {
        let Arguments { footprint, step, lambda, ensemble, .. } = *self;
        Options { mode, footprint, step, lambda, ensemble, ..Options::default() }
    }
}

fn score(result: &Array2<f32>, truth: &Array2<f32>) -> anyhow::Result<(f64, f64)> {
    let result = result.mapv(|v| v.clamp(0.0, 1.0)).insert_axis(Axis(2));
    let truth = truth.view().insert_axis(Axis(2));
    let scores = Scores::between(result.view(), truth, &Window::without_border(BORDER))?;
    Ok((scores.psnr_y, scores.ssim_y))
}

fn plane(values: ndarray::Array3<f32>) -> Array2<f32> {
    values.index_axis_move(Axis(2), 0).as_standard_layout().into_owned()
}

/// Every method's result and the wall seconds it took.
fn methods(
    truth: ArrayView2<'_, f32>,
    a: &Arguments,
    dictionary: &Dictionary,
    index: u64,
) -> anyhow::Result<Vec<(String, Array2<f32>, f64)>> {
    let (h, w) = truth.dim();
    let mut rng = ChaCha8Rng::seed_from_u64(a.seed);
    rng.set_stream(index);
    let phase = [rng.random::<f64>(), rng.random::<f64>()];
    let footprint = match a.footprint {
        Footprint::Lenslet => sampling::Footprint::Disc(DEFAULT_PITCH),
        _ => sampling::Footprint::Bilinear,
    };
    let (placed, values) =
        lattice_samples(truth.insert_axis(Axis(2)), DEFAULT_PITCH, DEFAULT_ROTATION, phase, footprint)?;
    let wanted = |name: &str| a.only.as_ref().is_none_or(|only| only.iter().any(|o| o == name));
    let mut results = Vec::new();
    let mut add = |name: &str, make: &mut dyn FnMut() -> anyhow::Result<Array2<f32>>| -> anyhow::Result<()> {
        if wanted(name) {
            let began = std::time::Instant::now();
            let result = make()?;
            results.push((name.to_string(), result, began.elapsed().as_secs_f64()));
        }
        Ok(())
    };
    add("bicubic", &mut || {
        let native = |n: usize| ((n as f64 / DEFAULT_PITCH).round() as usize).max(1);
        let low =
            Weights::new(&placed.centres, Size::new(w, h), Size::new(native(w), native(h)))?.apply(values.view())?;
        Ok(plane(bicubic::resize_bicubic(low.view(), Size::new(w, h))?))
    })?;
    let low = plane(Weights::new(&placed.centres, Size::new(w, h), Size::new(w, h))?.apply(values.view())?);
    add("barycentric", &mut || Ok(low.clone()))?;
    add("cubic", &mut || {
        Ok(plane(Cubic::new(&placed.centres, Size::new(w, h), Size::new(w, h))?.apply(values.view())?))
    })?;
    let modes = [
        ("ridge", Mode::Only(PatchPredictor::Ridge)),
        ("anchored", Mode::Only(PatchPredictor::Anchored)),
        ("lasso", Mode::Only(PatchPredictor::Lasso)),
        ("learned", Mode::Learned),
        ("fast", Mode::Fast),
        ("network", Mode::Only(PatchPredictor::Network)),
        ("best", Mode::Best),
    ];
    for (name, mode) in modes {
        let reconstructor = match Reconstructor::new(dictionary, &a.options(mode)) {
            Ok(reconstructor) => reconstructor,
            // Not every dictionary has every predictor.
            Err(dictionary::Error::NoPredictor { .. } | dictionary::Error::NoSideInputs { .. }) => continue,
            Err(other) => return Err(other.into()),
        };
        add(name, &mut || Ok(reconstructor.reconstruct_plane(low.view(), &[])?))?;
    }
    // Again with the measured samples kept true, as decode does it.
    let again = ["learned", "fast", "best", "network"].map(|from| (format!("{from}_true"), from));
    for (name, from) in again.into_iter().chain([("no_codes".to_owned(), "")]) {
        let found = results.iter().find(|r| r.0 == from).map(|r| &r.1);
        let Some(before) = found.or((from.is_empty()).then_some(&low)).filter(|_| wanted(&name)) else { continue };
        let began = std::time::Instant::now();
        let measured = SamplingOperator::new(placed.centres.clone(), a.footprint, DEFAULT_PITCH, Size::new(w, h))?;
        let (result, _) = back_project(before, &measured, values.column(0), 3, &[])?;
        results.push((name, result, began.elapsed().as_secs_f64()));
    }
    Ok(results)
}

#[allow(clippy::print_stdout)]
fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let dictionary = match &arguments.dictionary {
        Some(file) => dictionary::load(file)?,
        None => embedded_dictionary()?,
    };
    let mut sums: BTreeMap<String, [f64; 3]> = BTreeMap::new();
    let mut order = Vec::new();
    let mut images = Vec::new();
    for (index, path) in arguments.images.iter().enumerate() {
        let photo = load_luminance(path, 2 * BORDER + 16, ColourSpace::Srgb)?;
        let (h, w) = photo.luminance.dim();
        let truth = photo.luminance.slice(s![..h.min(SIDE), ..w.min(SIDE)]).to_owned();
        let mut entry = serde_json::Map::new();
        entry.insert("file".into(), path.display().to_string().into());
        for (name, result, seconds) in methods(truth.view(), &arguments, &dictionary, index as u64)? {
            let (psnr, ssim) = score(&result, &truth)?;
            entry.insert(name.clone(), json!({ "psnr": psnr, "ssim": ssim }));
            let sum = sums.entry(name.clone()).or_insert_with(|| {
                order.push(name);
                [0.0; 3]
            });
            for (s, v) in sum.iter_mut().zip([psnr, ssim, seconds]) {
                *s += v / arguments.images.len() as f64;
            }
        }
        images.push(Value::Object(entry));
    }
    let mean: serde_json::Map<String, Value> = order
        .into_iter()
        .map(|name| {
            let [psnr, ssim, seconds] = sums[&name];
            (name, json!({ "psnr": psnr, "ssim": ssim, "seconds": seconds }))
        })
        .collect();
    println!("{}", json!({ "mean": mean, "images": images }));
    Ok(())
}
