//! `lenslet convert`: a light field from one format to another.

use lenslet_core::lightfield::{self, colour};
use lenslet_core::progress::Observer;
use serde_json::json;
use std::path::Path;

use super::inputs::Input;
use super::source::{SourceArgs, but_absent};
use super::values::parse_views;
use super::written::Written;
use super::{Context, Outcome, Usage};

/// Convert a light field from one format to another
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet convert antinous/ --out antinous.npy
         lenslet convert rectified.eslf.png --views 14 --out lf/ --crop-views 7

Reads: lenslet's directory, .npy (float32, float64, uint8, uint16; v,u,t,s,c), folders of numbered pictures
(input_Cam042.png, view_3_5.png, view_-1_2.bmp, IMG_0001_017_02_04.png), ESLF / lenslet pictures (with --views), MATLAB .mat of
level 5 (variable LF). Writes: dir (16-bit PNG a view), npy (float32), mat (LF, single), eslf (16-bit PNG).")]
pub struct Args {
    #[command(flatten)]
    source: SourceArgs,
    #[command(flatten)]
    written: Written,
    /// Keep only the N (or ROWSxCOLUMNS) views in the middle
    #[arg(long, value_name = "N", value_parser = parse_views)]
    crop_views: Option<[usize; 2]>,
}

impl Args {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> Vec<(&Path, Input)> {
        vec![self.source.as_input()]
    }
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    args.written.check(&[&args.source.input])?;
    let source = args.source.open(context)?;
    let mut meta = source.meta().clone();
    let [rows, columns] = args.crop_views.unwrap_or(meta.views);
    if rows > meta.views[0] || columns > meta.views[1] {
        let [r, c] = meta.views;
        return Err(Usage(format!("--crop-views {rows}x{columns}: there are only {r}x{c} views")).into());
    }
    // An even number cannot be cut from an odd one around the middle; the upper left of the two choices is taken.
    let first = [(meta.views[0] - rows) / 2, (meta.views[1] - columns) / 2];
    let from = meta.colour;
    if let Some(weights) = &meta.weights {
        let line = |v: usize| &weights[(first[0] + v) * meta.views[1] + first[1]..][..columns];
        meta.weights = Some((0..rows).flat_map(line).copied().collect());
    }
    meta.views = [rows, columns];
    meta.colour = args.written.colour();
    let format = args.written.format()?;
    meta.provenance.push(json!({
        "tool": "lenslet", "version": env!("CARGO_PKG_VERSION"), "command": "convert",
        "input": args.source.name(), "first_view": first, "order": source.order().map(|read| read.order.to_string()),
    }));

    let mut absent = 0;
    let mut sink = lightfield::create(&args.written.out, meta.clone(), format, args.written.force)?;
    context.progress.begin("converting views", (rows * columns) as u64);
    for v in 0..rows {
        for u in 0..columns {
            context.progress.check()?;
            let (row, column) = (first[0] + v, first[1] + u);
            if source.is_absent(row, column)? {
                absent += 1;
                context.progress.advance(1);
                continue;
            }
            let mut view = source.read(row, column)?;
            colour::convert(&mut view, from, meta.colour);
            sink.write(v, u, &view)?;
            context.progress.advance(1);
        }
    }
    anyhow::ensure!(
        absent < rows * columns,
        "{}: all of these {rows}x{columns} views are absent",
        args.source.input.display()
    );
    sink.finish()?;

    let [height, width] = meta.size;
    let out = args.written.out.display().to_string();
    let text = format!(
        "{out}: {rows}x{columns} views{} of {width}x{height}, {} channels, {format}",
        but_absent(absent),
        meta.channels
    );
    let json = json!({
        "out": out, "format": format.to_string(), "views": meta.views, "size": meta.size,
        "absent": absent, "channels": meta.channels, "colour": meta.colour,
    });
    Ok(Outcome { json, text })
}
