//! What multi-view refinement gains, and learned reconstruction on top of it, against the truth or without one:
//! `cargo run --release --example multiview -- planes TRUTH_DIR SAMPLES.npz` a simulated capture (`lenslet simulate` writes
//! TRUTH_DIR/views, sharp and disparity.npy, `lenslet decode` SAMPLES.npz): disparity errors, PSNR and SSIM of each method
//! against the sharp truth and against the one that lenslets gather;
//! `… -- field LIGHT_FIELD [--pitch P] [--truth-disparity GT.pfm]` any light field, its views gathered by lenslets on a hexagonal
//! grid of pitch P (1080/328 pixels unless told), means over discs of one pitch, and recovered at their own size;
//! `… -- hidden SAMPLES.npz` a real capture: PSNR on hidden lenslets, and how well views agree.
//! Prints one JSON object. PSNR over all channels, SSIM of luminance, sRGB-encoded values, 12 pixels of border left out.
//! `--size N` longer side of the views (1080), `--save DIR` pictures, arrays (linear light) and epipolar images, `--all` times
//! all views, `--quick` leaves hidden lenslets and epipolar images out.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, ensure};
use clap::Parser as _;
use lenslet::apps::depth;
use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::{self, ColourSpace, ReadOptions, View, colour};
use lenslet_core::metrics::{self, BORDER, Scores, Window};
use lenslet_core::pfm;
use lenslet_core::progress::Silent;
use lenslet_core::sampling::{DEFAULT_PITCH, DEFAULT_ROTATION, Footprint};
use lenslet_views::multiview::{self, Fit, Options, RefinedViews, SampleSet};
use lenslet_views::{InterpolatedViews, LearnedViews, Method, RenderSamples as _, reconstruct};
use ndarray::{Array2, Array3, s};
use serde_json::{Map, Value, json};

const METHODS: [&str; 5] = ["barycentric", "cubic", "least squares", "joint", "learned"];

/// What multi-view refinement gains, and learned reconstruction on top of it
#[derive(clap::Parser)]
struct Arguments {
    #[command(subcommand)]
    task: Task,
    /// Longer side of the views, pixels
    #[arg(long, default_value_t = 1080, global = true)]
    size: usize,
    /// Write pictures, arrays and epipolar images
    #[arg(long, value_name = "DIR", global = true)]
    save: Option<PathBuf>,
    /// Time all views
    #[arg(long, global = true)]
    all: bool,
    /// Leave out hidden lenslets and epipolar images
    #[arg(long, global = true)]
    quick: bool,
}

#[derive(clap::Subcommand)]
enum Task {
    /// A simulated capture against its truth
    Planes { truth: PathBuf, samples: PathBuf },
    /// Views of any light field, gathered by lenslets on a hexagonal lattice and recovered at their own size
    Field {
        field: PathBuf,
        /// Pitch of the lattice, pixels
        #[arg(long, default_value_t = DEFAULT_PITCH)]
        pitch: f64,
        /// True disparity, of the HCI benchmark's sign
        #[arg(long, value_name = "GT.pfm")]
        truth_disparity: Option<PathBuf>,
    },
    /// A real capture without a truth
    Hidden { samples: PathBuf },
}

/// The views `wanted` by each method, and what was found on the way.
struct Rendered {
    views: Vec<Vec<View>>,
    /// Of the middle view, pixels per view step.
    disparity: Array2<f32>,
    /// Seconds for disparity, for the views.
    seconds: [f64; 2],
}

fn render(samples: &HexSamples, target: &Size, wanted: &[(usize, usize)]) -> anyhow::Result<Rendered> {
    let single = |interpolation| -> anyhow::Result<Vec<View>> {
        let prepared = InterpolatedViews::prepare(samples, interpolation, target, &Silent)?;
        wanted.iter().map(|&(v, u)| Ok(prepared.render_view(v, u)?)).collect()
    };
    let mut views = vec![single(Interpolation::Barycentric)?, single(Interpolation::Cubic)?];
    let (points, disparity, seconds) = refined(samples, target, wanted, Fit::LeastSquares)?;
    let (discs, ..) = refined(samples, target, wanted, Fit::Joint(None))?;
    let learned = learned(samples, target, wanted, &discs)?;
    views.extend([points, discs, learned]);
    Ok(Rendered { views, disparity, seconds })
}

/// Views refined by the others, the middle one's disparity, and seconds for it and for the views.
fn refined(
    samples: &HexSamples,
    target: &Size,
    wanted: &[(usize, usize)],
    fit: Fit,
) -> anyhow::Result<(Vec<View>, Array2<f32>, [f64; 2])> {
    let began = Instant::now();
    let options = Options { fit, ..Options::default() };
    let refined = RefinedViews::estimate(SampleSet::hexagonal(samples, target)?, &options, &Silent)?;
    let found = began.elapsed().as_secs_f64();
    let mut views = Vec::new();
    let mut keep = |_: usize, _: usize, pixels: Array3<f32>| -> anyhow::Result<()> {
        views.push(View::new(pixels));
        Ok(())
    };
    refined.render_views(wanted, &mut keep, &Silent)?;
    let seconds = [found, began.elapsed().as_secs_f64() - found];
    Ok((views, refined.disparities().middle.disparity.clone(), seconds))
}

/// Views of the joint fit reconstructed with the dictionary made for them.
fn learned(
    samples: &HexSamples,
    target: &Size,
    wanted: &[(usize, usize)],
    refined: &[View],
) -> anyhow::Result<Vec<View>> {
    let dictionary = reconstruct::embedded_dictionary_for(Interpolation::Multiview)?;
    let options = reconstruct::Options::default();
    let learned = LearnedViews::prepare(samples, Interpolation::Multiview, target, &dictionary, &options, &Silent)?;
    wanted.iter().zip(refined).map(|(&(v, u), view)| Ok(learned.reconstruct_view(view, v, u)?)).collect()
}

/// The middle view, the one at the end of its row, and a corner.
fn scored(views: usize) -> [(usize, usize); 3] {
    [(views / 2, views / 2), (views / 2, views - 1), (0, 0)]
}

const PLACES: [&str; 3] = ["middle", "rim", "corner"];

/// PSNR and SSIM of each method at each of the scored views.
fn scores(rendered: &Rendered, truths: &[Array3<f32>]) -> anyhow::Result<Value> {
    let mut out = Map::new();
    for (method, views) in METHODS.iter().zip(&rendered.views) {
        let mut places = Map::new();
        for ((place, view), truth) in PLACES.iter().zip(views).zip(truths) {
            let view = view.encode().into_pixels();
            let scores = Scores::between(view.view(), truth.view(), &Window::without_border(BORDER))?;
            places.insert((*place).into(), json!({ "psnr": scores.psnr_rgb, "ssim": scores.ssim_y }));
        }
        out.insert((*method).into(), places.into());
    }
    Ok(out.into())
}

/// PSNR of the rim and corner views moved onto the middle one by `disparity`, each method: do the views agree?
fn agreement(rendered: &Rendered, disparity: &Array2<f32>, views: usize) -> anyhow::Result<Value> {
    let reach = (views - 1 - views / 2) as f64;
    let largest = disparity.iter().fold(0f32, |m, d| m.max(d.abs()));
    let border = BORDER + (reach * f64::from(largest)).ceil() as usize;
    let mut out = Map::new();
    for (method, list) in METHODS.iter().zip(&rendered.views) {
        let list: Vec<Array3<f32>> = list.iter().map(|view| view.encode().into_pixels()).collect();
        let one = |k: usize, steps| {
            metrics::view_consistency(list[0].view(), list[k].view(), disparity.view(), steps, border)
        };
        let mut places = Map::new();
        places.insert("rim".into(), one(1, (reach, 0.0))?.into());
        let away = -((views / 2) as f64);
        places.insert("corner".into(), one(2, (away, away))?.into());
        out.insert((*method).into(), places.into());
    }
    Ok(out.into())
}

/// Errors of the disparity found: everywhere, and where the true view has texture (a gradient of 0.02 a pixel).
fn disparity_errors(found: &Array2<f32>, truth: &Array2<f32>, view: &Array3<f32>) -> Value {
    let (h, w) = truth.dim();
    let (fh, fw) = found.dim();
    let full = Array2::from_shape_fn((h, w), |(t, s)| {
        let place = |k: usize, n: usize, m: usize| (k * m / n).min(m - 1);
        found[[place(t, h, fh), place(s, w, fw)]]
    });
    let light = lenslet_core::colour::luminance(view.view());
    let textured = |t: usize, s: usize| {
        t > 0 && s > 0 && t + 1 < h && s + 1 < w && {
            let (x, y) = (light[[t, s + 1]] - light[[t, s - 1]], light[[t + 1, s]] - light[[t - 1, s]]);
            0.5 * x.hypot(y) > 0.02
        }
    };
    let told = |counts: &dyn Fn(usize, usize) -> bool| {
        lenslet_views::disparity::compare_with_truth(&full, truth, BORDER, 0.07, counts).map(
            |e| json!({ "median": e.median, "within_0.07": 1.0 - e.bad, "mse_x100": e.mse100, "pixels": e.pixels }),
        )
    };
    json!({ "textured": told(&textured), "all": told(&|_, _| true) })
}

fn simulated(truth: &Path, samples: &Path, a: &Arguments) -> anyhow::Result<Value> {
    let samples = HexSamples::load(samples)?;
    let disparity: Array2<f32> = ndarray_npy::read_npy(truth.join("disparity.npy"))?;
    let (h, w) = disparity.dim();
    let target = Size { width: w, height: h };
    let wanted = scored(samples.views);
    let truths = |folder: &str| -> anyhow::Result<Vec<Array3<f32>>> {
        let field = lightfield::load(&truth.join(folder), &ReadOptions::default())?;
        let view = |&(v, u): &(usize, usize)| {
            let mut view = field.data.slice(s![v, u, .., .., ..]).to_owned();
            colour::convert(&mut view, field.meta.colour, ColourSpace::Srgb);
            view
        };
        Ok(wanted.iter().map(view).collect())
    };
    let (gathered, sharp) = (truths("views")?, truths("sharp")?);
    let rendered = render(&samples, &target, &wanted)?;
    save(&rendered, Some(&sharp[0]), &samples, a)?;
    Ok(json!({
        "disparity": disparity_errors(&rendered.disparity, &disparity, &gathered[0]),
        "scores": { "sharp": scores(&rendered, &sharp)?, "gathered": scores(&rendered, &gathered)? },
        "agreement": agreement(&rendered, &disparity, samples.views)?,
        "seconds": { "disparity": rendered.seconds[0], "views": rendered.seconds[1] },
    }))
}

fn resampled(path: &Path, pitch: f64, truth_disparity: Option<&Path>, a: &Arguments) -> anyhow::Result<Value> {
    let mut field = lightfield::load(path, &ReadOptions::default())?;
    let wanted = scored(field.meta.views[0]);
    let mut truths = Vec::new();
    for &(v, u) in &wanted {
        let mut view = field.data.slice(s![v, u, .., .., ..]).to_owned();
        colour::convert(&mut view, field.meta.colour, ColourSpace::Srgb);
        truths.push(view);
    }
    colour::convert(&mut field.data, field.meta.colour, ColourSpace::Linear);
    field.meta.colour = ColourSpace::Linear;
    let (rows, columns, ..) = field.data.dim();
    ensure!(rows == columns && rows % 2 == 1, "{rows}x{columns} views; a square, odd number is needed");
    let seen = Footprint::Disc(pitch);
    let samples = HexSamples::of_views(field.data.view(), pitch, DEFAULT_ROTATION, [0.31, 0.47], seen)?;
    let target = samples.sensor;
    let rendered = render(&samples, &target, &wanted)?;
    save(&rendered, Some(&truths[0]), &samples, a)?;
    let mut out = json!({
        "lenslets": samples.centres.len(),
        "scores": scores(&rendered, &truths)?,
        "seconds": { "disparity": rendered.seconds[0], "views": rendered.seconds[1] },
    });
    if let Some(path) = truth_disparity {
        // The benchmark counts disparity the other way round.
        let truth = pfm::from_bytes(&std::fs::read(path)?)?.mapv(|d| -d);
        out["disparity"] = disparity_errors(&rendered.disparity, &truth, &truths[0]);
        out["agreement"] = agreement(&rendered, &truth, samples.views)?;
    }
    Ok(out)
}

fn real(path: &Path, a: &Arguments) -> anyhow::Result<Value> {
    let samples = HexSamples::load(path)?;
    let target = samples.sensor.with_longer_side(a.size);
    let wanted = scored(samples.views);
    let middle = wanted[0];
    let mut hidden = Map::new();
    for method in METHODS.into_iter().filter(|_| !a.quick) {
        let score = multiview::hidden_score::<anyhow::Error>(&samples, &target, 0.1, 1, middle, &mut |rest| {
            let views = match method.parse() {
                Ok(single) => InterpolatedViews::prepare(rest, single, &target, &Silent)?,
                Err(_) => {
                    let fit = if method == "least squares" { Fit::LeastSquares } else { Fit::Joint(None) };
                    InterpolatedViews::refined(rest, &Options { fit, ..Options::default() }, &target, &Silent)?
                }
            };
            let view = views.render_view(middle.0, middle.1)?;
            if method != "learned" {
                return Ok(view.into_pixels());
            }
            let view = learned(rest, &target, &[middle], &[view])?.pop().context("no view was reconstructed")?;
            Ok(view.into_pixels())
        })?;
        hidden.insert(method.into(), score.psnr.into());
    }
    let rendered = render(&samples, &target, &wanted)?;
    save(&rendered, None, &samples, a)?;
    let disparity = enlarged(&rendered.disparity, &target);
    Ok(json!({
        "hidden_psnr": hidden,
        "agreement": agreement(&rendered, &disparity, samples.views)?,
        "seconds": { "disparity": rendered.seconds[0], "views": rendered.seconds[1] },
    }))
}

fn enlarged(disparity: &Array2<f32>, target: &Size) -> Array2<f32> {
    let (h, w) = disparity.dim();
    Array2::from_shape_fn((target.height, target.width), |(t, s)| {
        disparity[[(t * h / target.height).min(h - 1), (s * w / target.width).min(w - 1)]]
    })
}

/// The middle view by each method and the disparity as pictures; epipolar images of the middle row of views, every view rendered.
fn save(rendered: &Rendered, truth: Option<&Array3<f32>>, samples: &HexSamples, a: &Arguments) -> anyhow::Result<()> {
    let Some(dir) = &a.save else { return Ok(()) };
    std::fs::create_dir_all(dir)?;
    let write = |name: String, view: &Array3<f32>| -> anyhow::Result<()> {
        let (h, w, c) = view.dim();
        let byte = |x: &f32| (255.0 * x.clamp(0.0, 1.0) + 0.5) as u8;
        let picture = image::RgbImage::from_fn(w as u32, h as u32, |x, y| {
            image::Rgb(std::array::from_fn(|k| byte(&view[[y as usize, x as usize, k.min(c - 1)]])))
        });
        picture.save(dir.join(name)).map_err(Into::into)
    };
    for (method, views) in METHODS.iter().zip(&rendered.views) {
        for (place, view) in PLACES.iter().zip(views) {
            write(format!("{method}-{place}.png"), view.encode().pixels())?;
            ndarray_npy::write_npy(dir.join(format!("{method}-{place}.npy")), view.pixels())?;
        }
    }
    if let Some(truth) = truth {
        write("truth-middle.png".into(), truth)?;
    }
    let d = &rendered.disparity;
    let ends = d.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &d| (a.min(d), b.max(d)));
    ndarray_npy::write_npy(dir.join("disparity.npy"), d)?;
    let picture = depth::colour_map(&d.view(), ends);
    std::fs::write(dir.join("disparity.png"), picture.to_png()?)?;
    if a.quick {
        return Ok(());
    }
    // Five lines of the picture, each followed through the middle row of views (eight pixels a view).
    let (h, w, c) = rendered.views[0][0].pixels().dim();
    let target = Size { width: w, height: h };
    let n = samples.views;
    let row: Vec<(usize, usize)> = (0..n).map(|u| (n / 2, u)).collect();
    let all = render(samples, &target, &row)?;
    for (method, views) in METHODS.iter().zip(&all.views) {
        let views: Vec<Array3<f32>> = views.iter().map(|view| view.encode().into_pixels()).collect();
        let lines: Vec<usize> = (1..6).map(|k| k * h / 6).collect();
        let epi = Array3::from_shape_fn((lines.len() * (8 * n + 6), w, c), |(y, x, k)| {
            let (line, u) = (y / (8 * n + 6), y % (8 * n + 6) / 8);
            if u < n { views[u][[lines[line], x, k]] } else { 1.0 }
        });
        write(format!("epi-{method}.png"), &epi)?;
    }
    Ok(())
}

/// Seconds for every view of the samples, nothing kept.
fn timed(path: &Path, a: &Arguments) -> anyhow::Result<Value> {
    let samples = HexSamples::load(path)?;
    let target = samples.sensor.with_longer_side(a.size);
    let began = Instant::now();
    let mut views = 0;
    samples.renderer(Method::multiview()).size(target).prepare()?.render_all(&mut |_, _, _| -> anyhow::Result<()> {
        views += 1;
        Ok(())
    })?;
    Ok(json!({ "views": views, "size": [target.width, target.height], "seconds": began.elapsed().as_secs_f64() }))
}

#[allow(clippy::print_stdout)]
fn main() -> anyhow::Result<()> {
    let a = Arguments::parse();
    let found = match &a.task {
        Task::Planes { samples: file, .. } | Task::Field { field: file, .. } | Task::Hidden { samples: file }
            if a.all =>
        {
            timed(file, &a)?
        }
        Task::Planes { truth, samples } => simulated(truth, samples, &a)?,
        Task::Field { field, pitch, truth_disparity } => resampled(field, *pitch, truth_disparity.as_deref(), &a)?,
        Task::Hidden { samples } => real(samples, &a)?,
    };
    println!("{found}");
    Ok(())
}
