//! `lenslet view`: a page to play with.

use std::path::{Path, PathBuf};

use lenslet::apps::viewer::{self, ViewerContent};
use lenslet::image_io::shrink;
use lenslet_core::output::{self, Kind};
use lenslet_core::progress::Observer;
use lenslet_views::disparity::{self, DepthOrder};
use lenslet_views::multiview::depth_order_of;
use ndarray::Array2;
use serde_json::json;

use super::refocus::load;
use super::values::parse_views;
use super::written::check_output;
use super::{Context, Outcome, Usage};

/// One HTML file to refocus and move around in, offline, in any browser
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet view decoded/ --out page.html
         lenslet view barycentric/ multiview/ learned/ --out compare.html

Several light fields of one capture get a button each. page.html#focus=-0.5,aperture=0.4,depth,epi opens with
these settings.")]
pub struct Args {
    /// The light field; more of the same capture to switch between
    #[arg(required = true, num_args = 1..=8)]
    light_fields: Vec<PathBuf>,
    /// Where to write
    #[arg(long, value_name = "PAGE.html")]
    out: PathBuf,
    /// Heading (default: the light field's name)
    #[arg(long)]
    title: Option<String>,
    /// Longer side of the views in the page, pixels
    #[arg(long, default_value_t = 720, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(16..=4096))]
    side: u32,
    /// JPEG quality of the views; lowered where the page would get too large
    #[arg(long, default_value_t = 88, value_name = "1..100", value_parser = clap::value_parser!(u8).range(1..=100))]
    quality: u8,
    /// Largest size of the page, megabytes (up to 1000)
    #[arg(long, default_value_t = 20.0, value_name = "MB")]
    max_mb: f64,
    /// Views (N or ROWSxCOLUMNS) of files that do not hold their number
    #[arg(long, value_name = "N", value_parser = parse_views)]
    views: Option<[usize; 2]>,
    /// Replace what is there
    #[arg(long)]
    force: bool,
}

fn name(path: &Path) -> String {
    path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    if !(args.max_mb > 0.0 && args.max_mb <= 1000.0) {
        return Err(Usage("--max-mb must be above 0 and at most 1000".into()).into());
    }
    let inputs: Vec<&Path> = args.light_fields.iter().map(PathBuf::as_path).collect();
    check_output(&args.out, Kind::File, args.force, &inputs)?;
    let mut side = args.side as usize;
    let mut sets = Vec::new();
    let mut views = (0, 0);
    let mut relief: Option<(Array2<f32>, DepthOrder)> = None;
    for path in &args.light_fields {
        context.progress.begin("reading", 0);
        let field = load(path, args.views)?;
        context.progress.check()?;
        let [rows, columns] = field.meta.views;
        if relief.is_none() {
            views = (rows, columns);
            let longer = field.meta.size[0].max(field.meta.size[1]).max(1);
            side = side.min(longer);
            let options = disparity::Options::shown();
            let found = disparity::estimate_disparity(&field.data.view(), &options, &context.progress)?;
            let order = depth_order_of(&field.data.view(), &found.disparity)?;
            relief = Some((found.disparity, order));
        }
        sets.push(viewer::shrink_views(
            &field.meta.method.clone().map_or_else(|| name(path), String::from),
            &field.data.view(),
            side,
        ));
    }
    let Some((disparity, order)) = relief else { return Err(Usage("no light field given".into()).into()) };
    // Buttons of the same name could not be distinguished.
    for k in 0..sets.len() {
        if sets.iter().filter(|s| s.name == sets[k].name).count() > 1 {
            sets[k].name = format!("{} {}", name(&args.light_fields[k]), k + 1);
        }
    }
    let scaled = |map: &Array2<f32>, side: usize| {
        let small = shrink(&map.view().insert_axis(ndarray::Axis(2)), side);
        let factor = small.dim().1 as f32 / map.dim().1 as f32;
        small.index_axis(ndarray::Axis(2), 0).mapv(|d| d * factor)
    };
    let title = args.title.clone().unwrap_or_else(|| name(&args.light_fields[0]));
    context.progress.begin("writing the page", 0);
    let content = ViewerContent { title, views, disparity: scaled(&disparity, side), sets, order };
    let html = viewer::viewer_page(&content, args.quality, (args.max_mb * 1e6) as usize)?;
    output::write_file(&args.out, args.force, html.as_bytes())?;
    let megabytes = html.len() as f64 / 1e6;
    let text = format!(
        "{}: {megabytes:.1} MB, {} light field(s), views of {side} pixels",
        args.out.display(),
        content.sets.len()
    );
    let json = json!({ "out": args.out, "bytes": html.len(), "side": side, "sets": content.sets.len() });
    Ok(Outcome { json, text })
}
