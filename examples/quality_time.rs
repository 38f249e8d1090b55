//! Quality against time of learned reconstruction, a row for every predictor, step and λ:
//! `cargo run --release --example quality_time -- [--dictionary FILE] [--footprint point|lenslet] IMAGE…`
//!
//! Each image is cropped, sampled and interpolated as in `hex_psnr`. Times are CPU seconds a megapixel of all threads (Linux).
//! `bound` is the time of the product DᵀY alone (features of all patches with all atoms or anchors), measured here on the same
//! machine; `times_bound` is how far a row is from it. Prints one JSON object.

use std::path::PathBuf;

use anyhow::anyhow;
use clap::Parser as _;
use lenslet_core::dictionary::{self, Footprint, PatchPredictor, PlaneReconstructor, ReconstructionOptions};
use lenslet_core::geometry::Size;
use lenslet_core::lightfield::ColourSpace;
use lenslet_core::linalg;
use lenslet_core::metrics::{BORDER, Scores, Window};
use lenslet_core::sampling::{self, DEFAULT_PITCH, DEFAULT_ROTATION, Weights, lattice_samples};
use lenslet_data_gen::photo::load_luminance;
use lenslet_views::reconstruct::embedded_dictionary;
use ndarray::{Array2, Axis, s};
use serde_json::{Value, json};

const SIDE: usize = 1080;

/// Quality against time of learned reconstruction
#[derive(clap::Parser)]
struct Arguments {
    /// Dictionary file (default: the embedded one)
    #[arg(long)]
    dictionary: Option<PathBuf>,
    /// What a sample is: point or lenslet
    #[arg(long, default_value = "point", value_parser = parse_footprint)]
    footprint: Footprint,
    /// Photos
    #[arg(required = true)]
    images: Vec<PathBuf>,
}

fn parse_footprint(name: &str) -> Result<Footprint, String> {
    let known = [Footprint::Point, Footprint::Lenslet];
    known.into_iter().find(|f| f.to_string() == name).ok_or_else(|| "point or lenslet".to_owned())
}

/// Name, predictor, step, λ (the trained one where None), copies averaged.
type Row = (&'static str, PatchPredictor, usize, Option<f32>, usize);

fn rows() -> Vec<Row> {
    let mut rows: Vec<Row> = vec![("ridge", PatchPredictor::Ridge, 3, None, 1)];
    rows.extend([4, 3, 2, 1].map(|step| ("fast", PatchPredictor::Anchored, step, None, 1)));
    rows.extend([4, 3, 2, 1].map(|step| ("learned", PatchPredictor::Lasso, step, None, 1)));
    rows.extend([0.15, 0.3].map(|lambda| ("learned", PatchPredictor::Lasso, 2, Some(lambda), 1)));
    rows.push(("best", PatchPredictor::Lasso, 2, None, 4));
    rows.extend([4, 3, 2, 1].map(|step| ("network", PatchPredictor::Network, step, None, 1)));
    rows
}

/// CPU seconds of this process's threads (Linux; elsewhere 0).
fn cpu_seconds() -> f64 {
    let Ok(tasks) = std::fs::read_dir("/proc/self/task") else { return 0.0 };
    let spent = |task: std::fs::DirEntry| -> Option<f64> {
        let line = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
        line.split_whitespace().next()?.parse().ok()
    };
    tasks.filter_map(|task| spent(task.ok()?)).sum::<f64>() * 1e-9
}

/// CPU seconds of one multiply-and-add of a product of `n` signals of `m` values with `k` atoms.
fn product(n: usize, m: usize, k: usize) -> f64 {
    let signals = Array2::from_shape_fn((n, m), |(i, j)| ((7 * i + 3 * j) % 11) as f32 - 5.0);
    let atoms = Array2::from_shape_fn((k, m), |(i, j)| ((5 * i + j) % 13) as f32 - 6.0);
    let (mut least, mut sum) = (f64::INFINITY, 0.0f32);
    for _ in 0..5 {
        let began = cpu_seconds();
        sum += linalg::product(signals.view(), atoms.t(), linalg::Par::Seq)[[0, 0]];
        least = least.min(cpu_seconds() - began);
    }
    // The sum keeps the product from being left out.
    if sum.is_nan() { f64::NAN } else { least / (n * m * k) as f64 }
}

#[allow(clippy::print_stdout)]
fn main() -> anyhow::Result<()> {
    let Arguments { dictionary, footprint, images } = Arguments::parse();
    let dictionary = dictionary.map_or_else(embedded_dictionary, |file| dictionary::load(&file))?;
    let model = dictionary.model(footprint).ok_or_else(|| anyhow!("the dictionary holds no model"))?;

    let mut planes = Vec::new();
    let mut megapixels = 0.0;
    for path in &images {
        let photo = load_luminance(path, 2 * BORDER + 16, ColourSpace::Srgb)?;
        let (h, w) = photo.luminance.dim();
        let truth = photo.luminance.slice(s![..h.min(SIDE), ..w.min(SIDE)]).to_owned();
        let (h, w) = truth.dim();
        let seen = match footprint {
            Footprint::Lenslet => sampling::Footprint::Disc(DEFAULT_PITCH),
            _ => sampling::Footprint::Bilinear,
        };
        let image = truth.view().insert_axis(Axis(2));
        let (placed, values) = lattice_samples(image, DEFAULT_PITCH, DEFAULT_ROTATION, [0.4, 0.7], seen)?;
        let low = Weights::new(&placed.centres, Size::new(w, h), Size::new(w, h))?
            .apply(values.view())?
            .index_axis_move(Axis(2), 0);
        megapixels += (h * w) as f64 * 1e-6;
        planes.push((truth, low));
    }
    let psnr = |result: &Array2<f32>, truth: &Array2<f32>| -> anyhow::Result<f64> {
        let result = result.mapv(|v| v.clamp(0.0, 1.0)).insert_axis(Axis(2));
        let truth = truth.view().insert_axis(Axis(2));
        Ok(Scores::between(result.view(), truth, &Window::without_border(BORDER))?.psnr_y)
    };
    let mut before = 0.0;
    for (truth, low) in &planes {
        before += psnr(low, truth)? / planes.len() as f64;
    }

    let first = &model.patch_model;
    let (features, atoms) = (first.low.ncols(), first.low.nrows());
    let anchors = first.anchored.as_ref().map_or(0, |a| a.anchors.nrows());
    let each = product(20_000, features, atoms);
    let mut table: Vec<Value> = Vec::new();
    for (name, predictor, step, lambda, ensemble) in rows() {
        if !first.has(predictor) {
            continue;
        }
        let options = ReconstructionOptions { predictor, step, lambda, ensemble, ..ReconstructionOptions::default() };
        let reconstructor = PlaneReconstructor::new(model, &options)?;
        let (mut mean, mut seconds) = (0.0, 0.0);
        for (truth, low) in &planes {
            let began = cpu_seconds();
            let result = reconstructor.reconstruct_plane(low.view(), &[])?;
            seconds += cpu_seconds() - began;
            mean += psnr(&result, truth)? / planes.len() as f64;
        }
        let products = match (predictor, &first.network) {
            (PatchPredictor::Ridge | PatchPredictor::NoCodes, _) => 0,
            (PatchPredictor::Anchored, _) => features * anchors,
            (PatchPredictor::Network, Some(network)) => network.layers.iter().map(|l| l.weights.len()).sum(),
            (PatchPredictor::Lasso | PatchPredictor::Network, _) => features * atoms,
        };
        let patches = 1e6 / (step * step) as f64 * ensemble as f64;
        let bound = patches * products as f64 * each;
        let per = seconds / megapixels;
        table.push(json!({
            "mode": name, "predictor": predictor.name(), "step": step, "lambda": lambda.unwrap_or(first.lambda), "copies": ensemble, "psnr": mean,
            "cpu_seconds_per_megapixel": per, "bound": bound, "times_bound": (bound > 0.0).then_some(per / bound),
        }));
    }
    println!(
        "{}",
        json!({
            "images": images.len(), "megapixels": megapixels, "footprint": footprint, "atoms": atoms, "features": features,
            "anchors": anchors, "low_psnr": before, "gflop_per_cpu_second": 2e-9 / each, "rows": table,
        })
    );
    Ok(())
}
