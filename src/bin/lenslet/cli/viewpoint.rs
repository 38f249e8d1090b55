//! `lenslet viewpoint`: an animation of the viewpoint moving.

use std::path::{Path, PathBuf};

use lenslet::apps::fill_dark_views;
use lenslet::apps::viewpoint::{self, ViewpointPath};
use lenslet::image_io::{Picture, shrink};
use lenslet_core::progress::Observer;
use lenslet_views::disparity;
use lenslet_views::multiview::depth_order_of;
use serde_json::json;

use super::inputs::Input;
use super::refocus::{check_pictures, ending, write_pictures};
use super::source::ReadArgs;
use super::values::RangeArgs;
use super::written::check_animation_name;
use super::{Context, Outcome, Usage};

/// Move the viewpoint: an animation along a circle or a line
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet viewpoint decoded/ --path circle --out wiggle.gif

Views between the measured ones follow each pixel's disparity. The ending of --out selects the format: .gif an
animation of 256 colours, .apng one of all colours, anything else a directory of numbered PNGs.")]
pub struct Args {
    /// The light field
    light_field: PathBuf,
    /// How the viewpoint moves
    #[arg(long, value_enum, default_value = "circle")]
    path: ViewpointPath,
    /// How far, in view steps (default: to the outermost views)
    #[arg(value_parser = super::values::finite::<f32>, long, value_name = "STEPS")]
    radius: Option<f32>,
    /// Pictures in the animation
    #[arg(long, default_value_t = 24, value_name = "N", value_parser = clap::value_parser!(u16).range(2..=1000))]
    frames: u16,
    /// Surfaces of this disparity do not move in the picture (default: the median)
    #[arg(value_parser = super::values::finite::<f32>, long, value_name = "D", allow_hyphen_values = true)]
    hold: Option<f32>,
    /// Make the longer side at most this many pixels
    #[arg(long, default_value_t = 720, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..))]
    side: u32,
    #[command(flatten)]
    range: RangeArgs,
    #[command(flatten)]
    read: ReadArgs,
    /// Where to write
    #[arg(long, value_name = "FILE.gif|FILE.apng|DIR")]
    out: PathBuf,
    /// Replace what is there
    #[arg(long)]
    force: bool,
}

impl Args {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> Vec<(&Path, Input)> {
        vec![(self.light_field.as_path(), Input::LightField)]
    }
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    if ending(&args.out) == "png" {
        return Err(
            Usage("an animation needs an --out that is a .gif, an .apng or a directory, not one .png".into()).into()
        );
    }
    if args.radius.is_some_and(|r| !(r.is_finite() && r > 0.0)) || args.hold.is_some_and(|d| d.abs() >= 1e5) {
        return Err(Usage("--radius must be above 0, --hold a disparity below 100000".into()).into());
    }
    check_animation_name(&args.out, false)?;
    check_pictures(&args.out, args.force, &args.light_field)?;
    let (mut field, light) = args.read.load_light(&args.light_field, true, context)?;
    let [rows, columns] = field.meta.views;
    // Of an even number of views the middle one has fewer to its right and below.
    let (wide, high) = ((columns - 1 - columns / 2) as f32, (rows - 1 - rows / 2) as f32);
    let most = match args.path {
        ViewpointPath::Horizontal => wide,
        ViewpointPath::Vertical => high,
        ViewpointPath::Circle => wide.min(high),
    };
    let radius = args.radius.unwrap_or(most);
    if radius > most || most == 0.0 {
        return Err(Usage(format!(
            "the viewpoint can move at most {most} view steps that way in {rows}x{columns} views"
        ))
        .into());
    }
    let options = disparity::Options {
        range: args.range.range,
        weights: Some(light.iter().copied().collect()),
        ..disparity::Options::shown()
    };
    let found = disparity::estimate_disparity(&field.data.view(), &options, &context.progress)?;
    args.range.note(&found, 1.0).iter().for_each(|note| context.progress.note(note));
    let order = depth_order_of(&field.data.view(), &found.disparity)?;
    fill_dark_views(&mut field, &light, &found.disparity, order);
    let hold = args.hold.unwrap_or_else(|| {
        let mut list: Vec<f32> = found.disparity.iter().copied().collect();
        list.sort_unstable_by(f32::total_cmp);
        list[list.len() / 2]
    });
    let list = viewpoint::viewpoints_along(args.path, radius, args.frames.into());
    context.progress.begin("moving", list.len() as u64);
    let mut pictures = Vec::with_capacity(list.len());
    for at in &list {
        context.progress.check()?;
        let image = viewpoint::render_between_views(&field.data.view(), &found.disparity, order, *at, hold)?;
        pictures.push(Picture::from_linear(&shrink(&image.view(), args.side as usize).view()));
        context.progress.advance(1);
    }
    write_pictures(&args.out, args.force, &pictures, 6, "frame")?;
    let text = format!("{} frames, radius {radius} view steps: {}", pictures.len(), args.out.display());
    let json = json!({ "out": args.out, "frames": pictures.len(), "radius": radius, "hold": hold });
    Ok(Outcome { json, text })
}
