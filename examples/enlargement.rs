//! Light fields made smaller and enlarged again, against themselves:
//! `cargo run --release --example enlargement -- LIGHT_FIELD --scale 2 --crop 120,120,264`. Each view's luminance is averaged
//! over squares of `scale` pixels; every view is then enlarged by bicubic interpolation, by least squares with samples for
//! points, and by the joint fit. Prints one JSON object: PSNR of luminance (dB) over all views, 15 pixels of border left
//! out: mean, middle and worst view; seconds.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, ensure};
use clap::Parser as _;
use lenslet_core::geometry::Size;
use lenslet_core::lightfield::{self, ColourSpace, LightField, Meta, ReadOptions};
use lenslet_core::progress::Silent;
use lenslet_core::sampling::bicubic;
use lenslet_views::multiview::{Fit, Options, RefinedViews, SampleSet};
use ndarray::{Array3, Array5, s};
use serde_json::{Map, Value, json};

/// Pixels of border that scores leave out.
const BORDER: usize = 15;

/// Light fields made smaller and enlarged again, against themselves
#[derive(clap::Parser)]
struct Arguments {
    field: PathBuf,
    /// Side of the squares that are averaged, pixels
    #[arg(long, default_value_t = 2)]
    scale: usize,
    /// Part of every view that is used: first row, first column, side
    #[arg(long, value_delimiter = ',')]
    crop: Option<Vec<usize>>,
    /// Views a side, around the middle
    #[arg(long, default_value_t = 7)]
    views: usize,
    /// Rows and columns of views are numbered the other way round
    #[arg(long)]
    transpose: bool,
    /// Only the middle view
    #[arg(long)]
    middle: bool,
}

/// Luminance of BT.601 in the range of video, 16 to 235 of 255, as tables of super-resolution have it.
fn video_luminance(rgb: &[f32]) -> f32 {
    match rgb {
        [r, g, b] => (65.481 * r + 128.553 * g + 24.966 * b + 16.0) / 255.0,
        [grey, ..] => *grey,
        [] => 0.0,
    }
}

/// The part of the light field that is used, one channel.
fn truth(arguments: &Arguments) -> anyhow::Result<Array5<f32>> {
    let field = lightfield::load(&arguments.field, &ReadOptions::default())?;
    let (rows, columns, height, width, _) = field.data.dim();
    let n = arguments.views;
    ensure!(n >= 1 && n <= rows.min(columns), "there are only {rows}x{columns} views");
    let (top, left, side) = match arguments.crop.as_deref() {
        Some(&[t, s, side]) => (t, s, side),
        Some(_) => anyhow::bail!("--crop takes three numbers: row, column, side"),
        None => (0, 0, height.min(width)),
    };
    ensure!(top + side <= height && left + side <= width, "the crop leaves views of {width}x{height}");
    let side = side / arguments.scale * arguments.scale;
    let (v0, u0) = ((rows - n) / 2, (columns - n) / 2);
    Ok(Array5::from_shape_fn((n, n, side, side, 1), |(v, u, t, s, _)| {
        let (v, u) = if arguments.transpose { (u, v) } else { (v, u) };
        let pixel = field.data.slice(s![v0 + v, u0 + u, top + t, left + s, ..]);
        video_luminance(&pixel.to_vec())
    }))
}

fn psnr(image: &Array3<f32>, truth: ndarray::ArrayView3<f32>) -> f64 {
    let (h, w, _) = image.dim();
    let inner = s![BORDER..h - BORDER, BORDER..w - BORDER, 0];
    let (a, b) = (image.slice(inner), truth.slice(inner));
    let squares: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a.clamp(0.0, 1.0) - b).powi(2)).sum();
    -10.0 * (squares / a.len() as f64).log10()
}

#[allow(clippy::print_stdout)]
fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let scale = arguments.scale;
    ensure!((1..=8).contains(&scale), "--scale must be 1 to 8");
    let truth = truth(&arguments)?;
    let (n, _, side, ..) = truth.dim();
    ensure!(side > 2 * BORDER, "views of {side} pixels are too small");
    let low = side / scale;
    let data = Array5::from_shape_fn((n, n, low, low, 1), |(v, u, t, s, _)| {
        let square = truth.slice(s![v, u, t * scale..(t + 1) * scale, s * scale..(s + 1) * scale, 0]);
        square.mean().unwrap_or(0.0)
    });
    let field = LightField { meta: Meta::new([n, n], [low, low], 1, ColourSpace::Srgb), data };
    let wanted: Vec<(usize, usize)> =
        if arguments.middle { vec![(n / 2, n / 2)] } else { (0..n * n).map(|k| (k / n, k % n)).collect() };
    let mut out = Map::new();
    let mut report = |method: &str, scores: &[f64], seconds: f64| {
        let at = wanted.iter().position(|&p| p == (n / 2, n / 2)).unwrap_or(0);
        let mean = scores.iter().sum::<f64>() / scores.len() as f64;
        let worst = scores.iter().copied().fold(f64::INFINITY, f64::min);
        let value: Value = json!({ "mean": mean, "middle": scores[at], "worst": worst, "seconds": seconds });
        out.insert(method.into(), value);
    };
    let began = Instant::now();
    let mut scores = Vec::new();
    for &(v, u) in &wanted {
        let image = bicubic::resize_bicubic(field.data.slice(s![v, u, .., .., ..]), side, side)?;
        scores.push(psnr(&image, truth.slice(s![v, u, .., .., ..])));
    }
    report("bicubic", &scores, began.elapsed().as_secs_f64());
    for (name, fit) in [("least-squares", Fit::Smooth), ("joint", Fit::for_enlargement(scale as f64))] {
        let began = Instant::now();
        let set = SampleSet::rectangular(&field, &Size::new(side, side))?;
        let refined = RefinedViews::estimate(set, &Options { fit, ..Options::default() }, &Silent)?;
        let mut scores = Vec::new();
        let mut keep = |v: usize, u: usize, image: Array3<f32>| -> Result<(), lenslet_views::Error> {
            scores.push(psnr(&image, truth.slice(s![v, u, .., .., ..])));
            Ok(())
        };
        refined.render_views(&wanted, &mut keep, &Silent).context("refinement")?;
        report(name, &scores, began.elapsed().as_secs_f64());
    }
    println!("{}", Value::Object(out));
    Ok(())
}
