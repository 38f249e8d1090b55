//! `lenslet refocus`: focus chosen after the fact.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use lenslet::apps::refocus::{self, ApertureShape};
use lenslet::image_io::{self, Picture, shrink};
use lenslet_core::output::{self, Kind};
use lenslet_core::progress::Observer;
use lenslet_views::disparity;
use ndarray::{Array2, Array3};
use serde_json::json;

use super::inputs::Input;
use super::source::ReadArgs;
use super::values::RangeArgs;
use super::written::check_animation_name;
use super::{Context, Outcome, Usage};

/// Refocus a light field: one picture, a focal stack, or everything in focus
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet refocus decoded/ --at 540,700 --out sharp-there.png
         lenslet refocus decoded/ --sweep=-1.5:1.5:31 --out stack.gif

Disparity is the shift of a scene point between neighbouring views, in pixels. The ending of --out selects what is
written: .png a picture, .gif or .apng an animation, anything else a directory with one numbered PNG a slice.")]
pub struct Args {
    /// The light field
    light_field: PathBuf,
    /// Focus on this disparity (pixels per view step)
    #[arg(value_parser = super::values::finite::<f32>, long, value_name = "D", allow_hyphen_values = true)]
    disparity: Option<f32>,
    /// Focus on N disparities, evenly from FROM to TO
    #[arg(long, value_name = "FROM:TO:N", allow_hyphen_values = true)]
    sweep: Option<String>,
    /// Focus on what is seen at column X, row Y of the middle view
    #[arg(long, value_name = "X,Y")]
    at: Option<String>,
    /// Everything in focus, each pixel by its own disparity
    #[arg(long)]
    all_in_focus: bool,
    /// Aperture: 1 all views, 0 the middle view alone
    #[arg(value_parser = super::values::finite::<f32>, long, default_value_t = 1.0, value_name = "0..1")]
    aperture: f32,
    /// Its shape
    #[arg(long, value_enum, default_value = "round")]
    shape: ApertureShape,
    /// Make the longer side at most this many pixels
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..))]
    side: Option<u32>,
    #[command(flatten)]
    range: RangeArgs,
    #[command(flatten)]
    read: ReadArgs,
    /// Where to write
    #[arg(long, value_name = "FILE|DIR")]
    out: PathBuf,
    /// Replace what is there
    #[arg(long)]
    force: bool,
}

/// What to focus on.
enum Focus {
    Disparities(Vec<f32>),
    Point(f32, f32),
    Everything,
}

fn focus(args: &Args) -> Result<Focus, Usage> {
    let usage = |text: String| Usage(text);
    let number = |text: &str| text.trim().parse::<f32>().ok().filter(|x| x.is_finite() && x.abs() < 1e5);
    match (args.disparity, &args.sweep, &args.at, args.all_in_focus) {
        (Some(d), None, None, false) if d.is_finite() && d.abs() < 1e5 => Ok(Focus::Disparities(vec![d])),
        (Some(_), None, None, false) => Err(usage("--disparity is out of range".into())),
        (None, Some(text), None, false) => {
            let parts: Vec<&str> = text.split(':').collect();
            let parsed = match parts[..] {
                [from, to, n] => number(from).zip(number(to)).zip(n.trim().parse::<usize>().ok()),
                _ => None,
            };
            match parsed {
                Some(((from, to), n)) if (2..=1000).contains(&n) => {
                    Ok(Focus::Disparities((0..n).map(|k| from + (to - from) * k as f32 / (n - 1) as f32).collect()))
                }
                _ => {
                    Err(usage(format!("--sweep {text} is not FROM:TO:N with N from 2 to 1000, as in --sweep=-1:1:21")))
                }
            }
        }
        (None, None, Some(text), false) => match text.split_once(',').and_then(|(x, y)| number(x).zip(number(y))) {
            Some((x, y)) => Ok(Focus::Point(x, y)),
            None => Err(usage(format!("--at {text} is not X,Y, as in --at 540,700"))),
        },
        (None, None, None, true) => Ok(Focus::Everything),
        _ => Err(usage("give one of --disparity, --sweep, --at, --all-in-focus".into())),
    }
}

/// The file name's ending, in small letters.
pub fn ending(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// Whether [`write_pictures`] may write there, before the work for it.
pub fn check_pictures(out: &Path, force: bool, input: &Path) -> Result<(), output::Error> {
    let kind = if matches!(ending(out).as_str(), "gif" | "apng" | "png") { Kind::File } else { Kind::Directory };
    output::check_target(out, kind, force, &[input])
}

/// Writes pictures as one PNG, an animation (GIF, APNG), or a directory of numbered PNGs, by the ending of the name.
pub fn write_pictures(out: &Path, force: bool, pictures: &[Picture], delay: u16, name: &str) -> anyhow::Result<()> {
    match ending(out).as_str() {
        "gif" => output::write_file(out, force, &image_io::gif(pictures, delay)?)?,
        "apng" => output::write_file(out, force, &image_io::apng(pictures, delay)?)?,
        "png" => {
            let [one] = pictures else { anyhow::bail!("{} pictures do not fit into one PNG", pictures.len()) };
            output::write_file(out, force, &one.to_png()?)?;
        }
        _ => {
            let pending = output::Pending::directory(out, force)?;
            for (k, p) in pictures.iter().enumerate() {
                let file = pending.path().join(format!("{name}_{k:03}.png"));
                output::write_part(&file, &p.to_png()?).with_context(|| format!("cannot write {}", file.display()))?;
            }
            pending.commit()?;
        }
    }
    Ok(())
}

impl Args {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> Vec<(&Path, Input)> {
        vec![(self.light_field.as_path(), Input::LightField)]
    }
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    let focus = focus(args)?;
    if !(0.0..=1.0).contains(&args.aperture) {
        return Err(Usage("--aperture must be from 0 to 1".into()).into());
    }
    let many = matches!(&focus, Focus::Disparities(list) if list.len() > 1);
    if many && ending(&args.out) == "png" {
        return Err(Usage("a sweep needs an --out that is a .gif, an .apng or a directory, not one .png".into()).into());
    }
    check_animation_name(&args.out, true)?;
    check_pictures(&args.out, args.force, &args.light_field)?;
    let from_middle = !matches!(focus, Focus::Disparities(_));
    let (field, light) = args.read.load_light(&args.light_field, from_middle, context)?;
    let data = field.data.view();
    let [rows, columns] = field.meta.views;
    let aperture = refocus::aperture_weights((rows, columns), args.aperture, args.shape) * &light;
    let options = disparity::Options {
        range: args.range.range,
        weights: Some(light.into_raw_vec_and_offset().0),
        ..disparity::Options::shown()
    };
    let (list, map): (Vec<f32>, Option<Array2<f32>>) = match focus {
        Focus::Disparities(list) => (list, None),
        Focus::Point(x, y) => (vec![refocus::disparity_at(&data, (x, y), &options, &context.progress)?], None),
        Focus::Everything => {
            let found = disparity::estimate_disparity(&data, &options, &context.progress)?;
            args.range.note(&found, 1.0).iter().for_each(|note| context.progress.note(note));
            (vec![], Some(found.disparity))
        }
    };
    let show = |image: Array3<f32>| {
        let image = match args.side {
            Some(side) => shrink(&image.view(), side as usize),
            None => image,
        };
        Picture::from_linear(&image.view())
    };
    let mut pictures = Vec::new();
    let mut seconds = 0.0;
    context.progress.begin("refocusing", list.len().max(1) as u64);
    if let Some(map) = &map {
        pictures.push(show(refocus::all_in_focus(&data, &map.view(), &aperture.view())?));
    }
    for &d in &list {
        context.progress.check()?;
        let start = std::time::Instant::now();
        let image = refocus::refocus(&data, d, &aperture.view())?;
        seconds += start.elapsed().as_secs_f64();
        pictures.push(show(image));
        context.progress.advance(1);
    }
    write_pictures(&args.out, args.force, &pictures, 8, "slice")?;
    let text = match list[..] {
        [] => format!("all in focus: {}", args.out.display()),
        [d] => format!("focused on disparity {d:.3}: {}", args.out.display()),
        _ => format!("{} slices: {}", list.len(), args.out.display()),
    };
    let mean = if list.is_empty() { None } else { Some(seconds / list.len() as f64) };
    let json = json!({ "out": args.out, "disparities": list, "pictures": pictures.len(), "seconds_each": mean });
    Ok(Outcome { json, text })
}
