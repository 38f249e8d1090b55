//! What every method makes of pictures that nothing was trained on:
//! `cargo run --release --example held_out -- [--photos PATH…] [--fields LIGHT_FIELD…] [--seeds N] [--sensor N] [--table]`
//!
//! A set of photos is a folder; files are one set, called `photos`. Each photo is the background of a scene, the two after it
//! in its set stand before it at other depths (as `simulate --photo` does it); the simulated camera (another for every seed,
//! noise as in `simulate`) takes it, the capture is calibrated and decoded, and the middle view of 7×7 compared with the
//! sharp truth. Light fields rendered by others have their middle views (7×7, or the largest square that has all of them)
//! gathered by lenslets: means of linear light over discs of one pitch, 1080/328 pixels, on a hexagonal lattice at a phase by
//! the seed, without noise; they are recovered at their own size.
//! The seeds are 1 to N.
//!
//! Prints one JSON object: for each set and light field, of every method, PSNR of luminance and colour (dB, sRGB-encoded, 12
//! pixels of border left out): mean and standard deviation over captures, and of luminance the paired margin over no codes
//! on the same views. `--table`: the same as Markdown, a table each of luminance, of these margins and of colour.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use clap::Parser as _;
use lenslet_core::calibration::{self, CalibrationOptions};
use lenslet_core::decode::{self, HexSamples};
use lenslet_core::dictionary::{self, Dictionary, PatchPredictor};
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::{self, ColourSpace, LightField, ReadOptions, colour};
use lenslet_core::metrics::{BORDER, Scores, Window};
use lenslet_core::progress::Silent;
use lenslet_core::sampling::{DEFAULT_PITCH, DEFAULT_ROTATION, Footprint};
use lenslet_data_gen::simulate::{self, Camera, ScenePair, SimulationOptions};
use lenslet_views::reconstruct::{Mode, Options, embedded_dictionary_for};
use lenslet_views::{LearnedViews, RenderSamples as _};
use ndarray::{Array3, s};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde_json::{Map, Value, json};

/// Views a side.
const VIEWS: usize = 7;
/// Photos of a scene.
const PHOTOS: usize = 3;

/// What every method makes of pictures that nothing was trained on
#[derive(clap::Parser)]
struct Arguments {
    /// Photos, or folders of them; each photo is a scene's background
    #[arg(long, num_args = 1..)]
    photos: Vec<PathBuf>,
    /// Light fields of any format, square and odd; views may be absent
    #[arg(long, num_args = 1..)]
    fields: Vec<PathBuf>,
    /// Captures of each scene or light field
    #[arg(long, default_value_t = 2)]
    seeds: u64,
    /// Side of the simulated sensor, pixels
    #[arg(long, default_value_t = 820)]
    sensor: usize,
    /// A dictionary in the place of the one inside the program for its base
    #[arg(long)]
    dictionary: Option<PathBuf>,
    /// Print Markdown
    #[arg(long)]
    table: bool,
}

/// PSNR of luminance and of colour by method, in the order of the table.
type Row = Vec<(String, [f64; 2])>;

fn score(view: &Array3<f32>, truth: &Array3<f32>) -> anyhow::Result<[f64; 2]> {
    let scores = Scores::between(view.view(), truth.view(), &Window::without_border(BORDER))?;
    Ok([scores.psnr_y, scores.psnr_rgb])
}

/// What a sample is of the truth: the mean over a lenslet.
const FOOTPRINT: dictionary::Footprint = dictionary::Footprint::Lenslet;

/// Every method on the middle view.
fn row(
    samples: &HexSamples,
    target: Size,
    truth: &Array3<f32>,
    learned: &[(Interpolation, Dictionary)],
) -> anyhow::Result<Row> {
    let middle = samples.views / 2;
    let (mut row, mut low) = (Row::new(), BTreeMap::new());
    for interpolation in Interpolation::ALL {
        let view = samples.renderer(interpolation).size(target).prepare()?.view(middle, middle)?;
        row.push((interpolation.name().into(), score(view.encode().pixels(), truth)?));
        low.insert(interpolation, view);
    }
    for (base, dictionary) in learned {
        let on = if *base == Interpolation::Barycentric { String::new() } else { format!(" on {base}") };
        let model = dictionary.model(FOOTPRINT).context("an embedded dictionary is empty")?;
        for predictor in model.patch_model.predictors() {
            let options = Options { mode: Mode::Only(predictor), footprint: FOOTPRINT, ..Options::default() };
            let prepared = LearnedViews::prepare(samples, *base, &target, dictionary, &options, &Silent)?;
            let view = prepared.reconstruct_view(&low[base], middle, middle)?;
            row.push((format!("{predictor}{on}"), score(view.encode().pixels(), truth)?));
        }
    }
    Ok(row)
}

/// A capture of photos at depths.
fn photographed(
    photos: &[PathBuf],
    seed: u64,
    sensor: usize,
    learned: &[(Interpolation, Dictionary)],
) -> anyhow::Result<Row> {
    let camera = Camera::with_sensor(sensor).perturbed(seed);
    let scenes = ScenePair::draw(&camera, |camera| simulate::photo_scene(photos, camera, None, seed, &Silent))?;
    let options = SimulationOptions { seed, ..SimulationOptions::default() };
    let simulation = simulate::render_capture(&scenes.gathered, &camera, &options, &Silent)?;
    let Size { width, height } = simulate::output_size(&camera, (sensor * 1080 + 1640) / 3280);
    let mut truth = simulate::true_view(&scenes.sharp, &camera, [0.0; 2], Size::new(width, height));
    colour::convert(&mut truth, ColourSpace::Linear, ColourSpace::Srgb);
    let calibration = calibration::calibrate(&simulation.whites, &CalibrationOptions::default(), &Silent)?;
    let samples = decode::sample_views(&simulation.capture, &calibration, &decode::Options::default(), &Silent)?;
    row(&samples, Size { width, height }, &truth, learned)
}

/// The largest odd number of views a side, `VIEWS` at most, so that none of the middle ones is absent.
fn whole_square(field: &LightField) -> anyhow::Result<usize> {
    let (rows, columns, ..) = field.data.dim();
    ensure!(rows == columns && rows % 2 == 1, "{rows}x{columns} views: a square, odd number is needed");
    let present = |v: usize, u: usize| field.meta.weights.as_ref().is_none_or(|w| w[v * columns + u] > 0.0);
    let is_whole = |side: usize| {
        let middle = (rows - side) / 2..(rows + side) / 2;
        middle.clone().all(|v| middle.clone().all(|u| present(v, u)))
    };
    (1..=VIEWS.min(rows)).rev().step_by(2).find(|&side| is_whole(side)).context("the middle view is absent")
}

/// The middle views of a light field, gathered by lenslets of a hexagonal lattice.
fn sampled(field: &LightField, views: usize, seed: u64) -> anyhow::Result<HexSamples> {
    let first = (field.meta.views[0] - views) / 2;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let phase = [rng.random::<f64>(), rng.random::<f64>()];
    let middle = field.data.slice(s![first..first + views, first..first + views, .., .., ..]);
    Ok(HexSamples::of_views(middle, DEFAULT_PITCH, DEFAULT_ROTATION, phase, Footprint::Disc(DEFAULT_PITCH))?)
}

/// Captures of a light field rendered by others; its name says how many views were used.
fn rendered(path: &Path, seeds: u64, learned: &[(Interpolation, Dictionary)]) -> anyhow::Result<(String, Vec<Row>)> {
    let mut field = lightfield::load(path, &ReadOptions { partial: true, ..ReadOptions::default() })?;
    let views = whole_square(&field)?;
    let middle = field.meta.views[0] / 2;
    let mut truth = field.data.slice(s![middle, middle, .., .., ..]).to_owned();
    colour::convert(&mut truth, field.meta.colour, ColourSpace::Srgb);
    colour::convert(&mut field.data, field.meta.colour, ColourSpace::Linear);
    field.meta.colour = ColourSpace::Linear;
    let target = Size { width: field.meta.size[1], height: field.meta.size[0] };
    let rows = (1..=seeds).map(|seed| row(&sampled(&field, views, seed)?, target, &truth, learned));
    Ok((format!("{}, {views}x{views} views", file_name(path)), rows.collect::<anyhow::Result<_>>()?))
}

/// The sets of photos by name: a folder's pictures in the order of their names, and the files that are named singly.
fn photo_sets(paths: &[PathBuf]) -> anyhow::Result<Vec<(String, Vec<PathBuf>)>> {
    let (folders, files): (Vec<PathBuf>, Vec<PathBuf>) = paths.iter().cloned().partition(|p| p.is_dir());
    let mut sets = Vec::new();
    for folder in folders {
        let entries = std::fs::read_dir(&folder)?.map(|e| Ok(e?.path()));
        let mut pictures = entries.collect::<std::io::Result<Vec<_>>>()?;
        pictures.sort();
        sets.push((file_name(&folder), pictures));
    }
    sets.extend((!files.is_empty()).then(|| ("photos".to_owned(), files)));
    Ok(sets)
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
}

fn mean_and_spread(values: &[f64]) -> [f64; 2] {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    [mean, if values.len() > 1 { (squares / (n - 1.0)).sqrt() } else { 0.0 }]
}

/// Of every method: mean and spread, and the margin over no codes.
fn summary(rows: &[Row]) -> Value {
    let methods = rows.first().map_or(&[][..], Vec::as_slice).iter().map(|m| &m.0);
    let of = |row: &Row, name: &str, k: usize| row.iter().find(|m| m.0 == name).map(|m| m.1[k]);
    let methods = methods.map(|name| {
        let column = |k: usize| mean_and_spread(&rows.iter().filter_map(|r| of(r, name, k)).collect::<Vec<_>>());
        let no_codes = PatchPredictor::NoCodes.name();
        let refined = name.contains("multiview");
        let against = if refined { format!("{no_codes} on multiview") } else { no_codes.to_owned() };
        let margins: Vec<f64> = rows.iter().filter_map(|r| Some(of(r, name, 0)? - of(r, &against, 0)?)).collect();
        let value = json!({ "psnr_y": column(0), "psnr_rgb": column(1), "over_no_codes": mean_and_spread(&margins) });
        (name.clone(), value)
    });
    json!({ "captures": rows.len(), "methods": methods.collect::<Map<_, _>>() })
}

/// A table a score: a row a method, a column a set.
fn markdown(sets: &Map<String, Value>) -> String {
    let mut text = String::new();
    let head: String = sets.iter().map(|(name, s)| format!(" {name}, {} captures |", s["captures"])).collect();
    let Some(methods) = sets.values().next().and_then(|s| s["methods"].as_object()) else { return text };
    let scores = [
        ("luminance, dB", "psnr_y", false),
        ("over no codes, dB", "over_no_codes", true),
        ("colour, dB", "psnr_rgb", false),
    ];
    for (title, key, signed) in scores {
        text += &format!("| {title} |{head}\n|---|{}\n", "--:|".repeat(sets.len()));
        for method in methods.keys() {
            let cell = |set: &Value| {
                let part = |k: usize| set["methods"][method][key][k].as_f64().unwrap_or(f64::NAN);
                let mean = if signed { format!("{:+.2}", part(0)) } else { format!("{:.2}", part(0)) };
                format!(" {mean} ± {:.2} |", part(1))
            };
            text += &format!("| {method} |{}\n", sets.values().map(cell).collect::<String>());
        }
        text += "\n";
    }
    text
}

#[allow(clippy::print_stdout)]
fn main() -> anyhow::Result<()> {
    let a = Arguments::parse();
    ensure!(!a.photos.is_empty() || !a.fields.is_empty(), "name photos or light fields");
    let learned = [Interpolation::Barycentric, Interpolation::Multiview]
        .map(|base| Ok::<_, anyhow::Error>((base, embedded_dictionary_for(base)?)));
    let mut learned = learned.into_iter().collect::<anyhow::Result<Vec<_>>>()?;
    if let Some(file) = &a.dictionary {
        let given = dictionary::load(file)?;
        let base = given.models.first().map(|m| m.base);
        let place = learned.iter_mut().find(|(of, _)| Some(*of) == base);
        place.context("the dictionary is neither for barycentric nor for refined views")?.1 = given;
    }
    let mut out = Map::new();
    for (name, photos) in photo_sets(&a.photos)? {
        let mut rows = Vec::new();
        for (k, seed) in (0..photos.len()).flat_map(|k| (1..=a.seeds).map(move |seed| (k, seed))) {
            let count = PHOTOS.min(photos.len());
            let scene: Vec<PathBuf> = (0..count).map(|j| photos[(k + j) % photos.len()].clone()).collect();
            rows.push(photographed(&scene, seed, a.sensor, &learned)?);
        }
        out.insert(name, summary(&rows));
    }
    for field in &a.fields {
        let (name, rows) = rendered(field, a.seeds, &learned)?;
        out.insert(name, summary(&rows));
    }
    if a.table {
        print!("{}", markdown(&out));
    } else {
        println!("{}", Value::Object(out));
    }
    Ok(())
}
