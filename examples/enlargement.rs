//! Light fields made smaller and enlarged again, against themselves:
//! `cargo run --release --example enlargement -- LIGHT_FIELD --scale 2 --crop 120,120,264`. Each view's luminance is averaged
//! over squares of `scale` pixels; every view is then enlarged by bicubic interpolation, by least squares with samples for
//! points, and by the joint fit. With `--pitch 3.29` in place of the scale, samples are means over discs of one pitch on a
//! hexagonal lattice, in linear light, as lenslets gather them, and a view alone is interpolated by cubics. Prints one JSON
//! object: PSNR of luminance (dB) over all views, 15 pixels of border left out: mean, middle and worst view; seconds.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, ensure};
use clap::Parser as _;
use lenslet_core::colour::{srgb_decode, srgb_encode};
use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::{self, ColourSpace, LightField, Meta, ReadOptions};
use lenslet_core::progress::Silent;
use lenslet_core::random::standard_normal;
use lenslet_core::sampling::{DEFAULT_ROTATION, Footprint, bicubic};
use lenslet_views::InterpolatedViews;
use lenslet_views::multiview::{Fit, Options, RefinedViews, SampleSet};
use ndarray::{Array3, Array5, s};
use rand::{SeedableRng as _, rngs::ChaCha8Rng};
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
    /// Samples of lenslets this many pixels apart in place of squares
    #[arg(long)]
    pitch: Option<f64>,
    /// Standard deviation of the lenslets' noise, encoded values
    #[arg(long, default_value_t = 0.0)]
    noise: f32,
    /// Also print the score of every view
    #[arg(long)]
    each: bool,
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

/// A light field with fewer samples: pixels averaged over squares, or lenslets that average over discs.
enum Fewer {
    Squares(LightField),
    Lenslets(HexSamples),
}

/// Means over squares of `scale` pixels, encoded values.
fn squares(truth: &Array5<f32>, scale: usize) -> LightField {
    let (n, _, side, ..) = truth.dim();
    let low = side / scale;
    let data = Array5::from_shape_fn((n, n, low, low, 1), |(v, u, t, s, _)| {
        let square = truth.slice(s![v, u, t * scale..(t + 1) * scale, s * scale..(s + 1) * scale, 0]);
        square.mean().unwrap_or(0.0)
    });
    LightField { meta: Meta::new([n, n], [low, low], 1, ColourSpace::Srgb), data }
}

/// Means over discs of one pitch around the points of a hexagonal lattice, in linear light, with noise of the encoded
/// values.
fn lenslets(truth: &Array5<f32>, arguments: &Arguments, pitch: f64) -> anyhow::Result<HexSamples> {
    let linear = truth.mapv(srgb_decode);
    let disc = Footprint::Disc(pitch);
    let mut samples = HexSamples::of_views(linear.view(), pitch, DEFAULT_ROTATION, [0.31, 0.47], disc)?;
    let mut generator = ChaCha8Rng::seed_from_u64(5);
    for value in &mut samples.values {
        let noise = arguments.noise * standard_normal(&mut generator) as f32;
        *value = srgb_decode((srgb_encode(*value) + noise).max(0.0));
    }
    Ok(samples)
}

impl Fewer {
    fn of(truth: &Array5<f32>, arguments: &Arguments) -> anyhow::Result<Self> {
        Ok(match arguments.pitch {
            Some(pitch) => Fewer::Lenslets(lenslets(truth, arguments, pitch)?),
            None => Fewer::Squares(squares(truth, arguments.scale)),
        })
    }

    fn set(&self, size: &Size) -> Result<SampleSet<'_>, lenslet_views::Error> {
        match self {
            Fewer::Squares(field) => SampleSet::rectangular(field, size),
            Fewer::Lenslets(samples) => SampleSet::hexagonal(samples, size),
        }
    }

    /// The views `wanted` by interpolation of each alone, and the name of that.
    fn interpolated(&self, size: &Size, wanted: &[(usize, usize)]) -> anyhow::Result<(&'static str, Vec<Array3<f32>>)> {
        let mut views = Vec::new();
        Ok(match self {
            Fewer::Squares(field) => {
                for &(v, u) in wanted {
                    let view = field.data.slice(s![v, u, .., .., ..]);
                    views.push(bicubic::resize_bicubic(view, *size)?);
                }
                ("bicubic", views)
            }
            Fewer::Lenslets(samples) => {
                let prepared = InterpolatedViews::prepare(samples, Interpolation::Cubic, size, &Silent)?;
                for &(v, u) in wanted {
                    views.push(prepared.render_view(v, u)?.into_pixels());
                }
                ("cubic", views)
            }
        })
    }

    /// Values of a rendered view as those of the truth.
    fn encoded(&self, view: Array3<f32>) -> Array3<f32> {
        match self {
            Fewer::Squares(_) => view,
            Fewer::Lenslets(_) => view.mapv(srgb_encode),
        }
    }
}

#[allow(clippy::print_stdout)]
fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    ensure!((1..=8).contains(&arguments.scale), "--scale must be 1 to 8");
    let truth = truth(&arguments)?;
    let (n, _, side, ..) = truth.dim();
    ensure!(side > 2 * BORDER, "views of {side} pixels are too small");
    let (size, middle) = (Size::new(side, side), (n / 2, n / 2));
    let fewer = Fewer::of(&truth, &arguments)?;
    let wanted: Vec<(usize, usize)> =
        if arguments.middle { vec![middle] } else { (0..n * n).map(|k| (k / n, k % n)).collect() };
    let mut out = Map::new();
    let mut report = |method: &str, views: Vec<Array3<f32>>, seconds: f64| {
        let scored = wanted.iter().zip(views);
        let scores: Vec<f64> =
            scored.map(|(&(v, u), view)| psnr(&fewer.encoded(view), truth.slice(s![v, u, .., .., ..]))).collect();
        let at = wanted.iter().position(|&p| p == middle).unwrap_or(0);
        let mean = scores.iter().sum::<f64>() / scores.len() as f64;
        let worst = scores.iter().copied().fold(f64::INFINITY, f64::min);
        let mut value: Value = json!({ "mean": mean, "middle": scores[at], "worst": worst, "seconds": seconds });
        if arguments.each {
            value["views"] = json!(scores);
        }
        out.insert(method.into(), value);
    };
    let began = Instant::now();
    let (name, views) = fewer.interpolated(&size, &wanted)?;
    report(name, views, began.elapsed().as_secs_f64());
    for (name, fit) in [("least-squares", Fit::LeastSquares), ("joint", Fit::Joint(None))] {
        let began = Instant::now();
        let refined = RefinedViews::estimate(fewer.set(&size)?, &Options { fit, ..Options::default() }, &Silent)?;
        let mut views = Vec::new();
        let mut keep = |_: usize, _: usize, image: Array3<f32>| -> Result<(), lenslet_views::Error> {
            views.push(image);
            Ok(())
        };
        refined.render_views(&wanted, &mut keep, &Silent).context("refinement")?;
        report(name, views, began.elapsed().as_secs_f64());
    }
    println!("{}", Value::Object(out));
    Ok(())
}
