//! `lenslet extract`: what a container or calibration bundle holds, as files.

use std::path::{Path, PathBuf};

use lenslet_core::container::extract;
use lenslet_core::output::{self, Kind};
use lenslet_core::progress::Observer;
use serde_json::json;

use super::info::clean;
use super::inputs::Input;
use super::written::check_folder_name;
use super::{Context, Outcome};

/// Take out everything a container, calibration bundle (data.C.n) or .tar archive holds
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet extract IMG_0001-stk.lfp --out IMG_0001

Raw images come with their metadata beside them (image.raw, image.json), so that decode reads them; Lytro's refocus
slices as .jpg, its video blocks as .h264, its depth maps as .raw, .pfm and 16-bit .png. index.json lists them.")]
pub struct Args {
    /// The container, bundle or archive
    file: PathBuf,
    /// The folder to make
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// Replace an existing folder
    #[arg(short, long)]
    force: bool,
}

impl Args {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> Vec<(&Path, Input)> {
        vec![(self.file.as_path(), Input::Container)]
    }
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    check_folder_name(&args.out)?;
    output::check_target(&args.out, Kind::Directory, args.force, &[&args.file])?;
    let (files, warnings) = extract::extract(&args.file, &args.out, args.force, &context.progress)?;
    for warning in &warnings {
        context.progress.note(&clean(warning));
    }
    let mut text = String::new();
    for f in &files {
        text.push_str(&format!("{:>10}  {}  ({})\n", f.bytes, f.name, clean(&f.what)));
    }
    text.push_str(&format!("{} files in {}\n", files.len() + 1, args.out.display()));
    let list: Vec<_> = files
        .iter()
        .map(|f| json!({"file": f.name, "bytes": f.bytes, "what": f.what, "intact": f.intact, "facts": f.facts}))
        .collect();
    let json = json!({"out": args.out.display().to_string(), "files": list, "warnings": warnings});
    Ok(Outcome { json, text })
}
