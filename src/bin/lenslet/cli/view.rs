//! `lenslet view`: a page to play with.

use std::path::{Path, PathBuf};

use lenslet::apps::fill_dark_views;
use lenslet::apps::viewer::{self, ViewerContent};
use lenslet_core::lightfield::Meta;
use lenslet_core::output::{self, Kind};
use lenslet_core::progress::Observer;
use lenslet_views::disparity;
use lenslet_views::multiview::depth_order_of;
use serde_json::json;

use super::inputs::{Input, each};
use super::source::ReadArgs;
use super::values::RangeArgs;
use super::written::check_page_name;
use super::{Context, Outcome, Usage};

/// One HTML file to refocus and move around in, offline, in any browser
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet view decoded/ --out page.html
         lenslet view barycentric/ multiview/ learned/ --out compare.html

Several light fields get a button each, by their names; each has its own depth. page.html#focus=-0.5,aperture=0.4,depth,epi opens with
these settings.")]
pub struct Args {
    /// The light field; more of the same size to switch between
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
    #[arg(value_parser = super::values::finite::<f64>, long, default_value_t = 20.0, value_name = "MB")]
    max_mb: f64,
    #[command(flatten)]
    range: RangeArgs,
    #[command(flatten)]
    read: ReadArgs,
    /// Replace what is there
    #[arg(long)]
    force: bool,
}

fn name(path: &Path) -> String {
    path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// What each light field is called: its name, with the folder it lies in where others have the same name, and a number
/// where that is the same too.
fn labels(paths: &[PathBuf]) -> Vec<String> {
    let folder = |path: &Path| {
        let whole = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
        whole.parent().and_then(Path::file_name).map(|n| n.to_string_lossy().into_owned())
    };
    let repeated = |list: &[String], k: usize| list.iter().filter(|n| **n == list[k]).count() > 1;
    let short: Vec<String> = paths.iter().map(|p| name(p)).collect();
    let longer: Vec<String> = (0..paths.len())
        .map(|k| match folder(&paths[k]) {
            Some(folder) if repeated(&short, k) => format!("{folder}/{}", short[k]),
            _ => short[k].clone(),
        })
        .collect();
    (0..paths.len())
        .map(|k| if repeated(&longer, k) { format!("{} {}", longer[k], k + 1) } else { longer[k].clone() })
        .collect()
}

/// How views were made, as a button has it: the method, and the predictor of learned ones.
fn made_by(meta: &Meta) -> Option<String> {
    let method = meta.method.as_ref()?.name();
    Some(meta.predictor.as_ref().map_or_else(|| method.to_owned(), |predictor| format!("{method}: {predictor}")))
}

impl Args {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> Vec<(&Path, Input)> {
        each(&self.light_fields, Input::LightField).collect()
    }
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    if !(args.max_mb > 0.0 && args.max_mb <= 1000.0) {
        return Err(Usage("--max-mb must be above 0 and at most 1000".into()).into());
    }
    check_page_name(&args.out)?;
    let inputs: Vec<&Path> = args.light_fields.iter().map(PathBuf::as_path).collect();
    output::check_target(&args.out, Kind::File, args.force, &inputs)?;
    let mut side = args.side as usize;
    let mut sets = Vec::new();
    let mut views = (0, 0);
    for (path, label) in args.light_fields.iter().zip(labels(&args.light_fields)) {
        let (mut field, light) = args.read.load_light(path, true, context)?;
        let [rows, columns] = field.meta.views;
        if sets.is_empty() {
            views = (rows, columns);
            side = side.min(field.meta.size[0].max(field.meta.size[1]).max(1));
        }
        let options = disparity::Options {
            range: args.range.range,
            weights: Some(light.iter().copied().collect()),
            ..disparity::Options::shown()
        };
        // Each light field has its own depth: it may be another scene.
        let found = disparity::estimate_disparity(&field.data.view(), &options, &context.progress)?;
        args.range
            .note(&found, 1.0)
            .iter()
            .for_each(|note| context.progress.note(&format!("{}: {note}", path.display())));
        let order = depth_order_of(&field.data.view(), &found.disparity)?;
        fill_dark_views(&mut field, &light, &found.disparity, order);
        let label = match made_by(&field.meta) {
            Some(made) if !label.contains(&made) => format!("{label} ({made})"),
            _ => label,
        };
        sets.push(viewer::shrink_views(&label, &field.data.view(), side, &found.disparity, order));
    }
    let title = args.title.clone().unwrap_or_else(|| name(&args.light_fields[0]));
    context.progress.begin("writing the page", 0);
    let content = ViewerContent { title, views, sets };
    let html = viewer::viewer_page(&content, args.quality, (args.max_mb * 1e6) as usize)?;
    output::write_file(&args.out, args.force, html.as_bytes())?;
    // With the mark that says who wrote it.
    let bytes = std::fs::metadata(&args.out).map_or(html.len() as u64, |m| m.len());
    let megabytes = bytes as f64 / 1e6;
    let text = format!(
        "{}: {megabytes:.1} MB, {} light field(s), views of {side} pixels",
        args.out.display(),
        content.sets.len()
    );
    let json = json!({ "out": args.out, "bytes": bytes, "side": side, "sets": content.sets.len() });
    Ok(Outcome { json, text })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_fields_are_told_apart_by_name_folder_and_number() {
        let of = |paths: &[&str]| labels(&paths.iter().map(PathBuf::from).collect::<Vec<_>>());
        assert_eq!(of(&["a/x.lf", "y.npy"]), ["x", "y"]);
        assert_eq!(of(&["a/x", "b/x", "c"]), ["a/x", "b/x", "c"]);
        assert_eq!(of(&["a/x", "a/x"]), ["a/x 1", "a/x 2"]);
    }
}
