//! `lenslet dict`: dictionaries shown and exported.

use std::path::{Path, PathBuf};

use lenslet_core::dictionary::{self, Dictionary};
use lenslet_core::output::{self, Kind};
use lenslet_views::reconstruct;
use serde_json::{Value, json};

use super::inputs::Input;
use super::{Context, Outcome, Usage};

/// Look into dictionaries and export them
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// Show what a dictionary holds and how it was made
    #[command(visible_alias = "info", after_help = "Example: lenslet dict show default")]
    Show {
        /// Dictionary file, or a name (default: the embedded one)
        dictionary: PathBuf,
    },
    /// Write a dictionary in another format
    #[command(
        visible_alias = "convert",
        after_help = "\
Example: lenslet dict export default --out default.safetensors
         lenslet dict export default.safetensors --out default.lfd
         lenslet dict export mine.lfd --out mine-npy/

A .lfd or .safetensors file, which every command reads, or a folder of .npy files with dictionary.json. Matrices are
named MODEL.PREDICTOR.MATRIX, as point.lasso.low_atoms."
    )]
    Export {
        /// Dictionary file, or a name (default: the embedded one)
        dictionary: PathBuf,
        /// What to write: a name ending in .lfd or .safetensors, or a folder
        #[arg(long, value_name = "PATH")]
        out: PathBuf,
        /// Replace what is at --out
        #[arg(long)]
        force: bool,
    },
}

/// A dictionary by name or file. A file that exists is taken before a name; those of
/// [`reconstruct::embedded_names`] are inside the program; another name without folders is
/// also looked for as NAME.lfd and NAME.safetensors in `dictionaries/` here and beside the program.
pub fn find(name: &Path) -> anyhow::Result<Dictionary> {
    if name.is_file() {
        return Ok(dictionary::load(name)?);
    }
    if let Some(found) = name.to_str().and_then(reconstruct::embedded_by_name) {
        return Ok(found?);
    }
    if name.components().count() == 1 {
        let program = std::env::current_exe().ok().and_then(|p| p.parent().map(Path::to_path_buf));
        for place in [Some(PathBuf::new()), program].into_iter().flatten() {
            for ending in ["lfd", "safetensors"] {
                let file = place.join("dictionaries").join(name).with_extension(ending);
                if file.is_file() {
                    return Ok(dictionary::load(&file)?);
                }
            }
        }
        if name.extension().is_none() {
            let known: Vec<&str> = reconstruct::embedded_names().collect();
            anyhow::bail!(
                "there is no dictionary {}: give a file, one of {}, or a name in dictionaries/",
                name.display(),
                known.join(", ")
            );
        }
    }
    Ok(dictionary::load(name)?)
}

/// The dictionary inside the program for rectangular grids enlarged by `scale` (3 when it is not said), where there is
/// one.
pub fn for_grid(scale: Option<f64>) -> Option<&'static Path> {
    reconstruct::embedded_name_for_grid(scale.unwrap_or(3.0)).map(Path::new)
}

/// A dictionary as `dict show` and `info` print it: JSON and text.
pub fn describe(dictionary: &Dictionary) -> (Value, String) {
    let mut text = format!(
        "{}, {}, seed {}, {} photos\n",
        dictionary.recipe.tool,
        dictionary.recipe.algorithm,
        dictionary.recipe.seed,
        dictionary.recipe.photos.len()
    );
    let mut models = Vec::new();
    for model in &dictionary.models {
        let parts = &model.patch_model;
        let anchors = parts.anchored.as_ref().map_or(0, |a| a.anchors.nrows());
        text.push_str(&format!(
            "{} on {}, pitch {:.4}: {} atoms, {} features of {}x{} pixels, patches of {}x{}, λ {}, {anchors} anchors\n",
            model.footprint,
            model.base,
            model.pitch,
            parts.low.nrows(),
            parts.low.ncols(),
            parts.support,
            parts.support,
            parts.patch,
            parts.patch,
            parts.lambda
        ));
        // Kept for readers of earlier versions: a list of one pass, and `with_linear`, always false.
        let pass = json!({
            "atoms": parts.low.nrows(), "features": parts.low.ncols(), "support": parts.support, "patch": parts.patch,
            "lambda": parts.lambda, "floor": parts.floor, "with_linear": false, "anchors": anchors,
        });
        models.push(json!({
            "footprint": model.footprint, "base": model.base, "pitch": model.pitch, "passes": [pass],
        }));
    }
    for (name, score) in &dictionary.recipe.scores {
        text.push_str(&format!("{name}: {score}\n"));
    }
    let json = json!({ "kind": "dictionary", "models": models, "recipe": dictionary.recipe });
    (json, text)
}

impl Args {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> Vec<(&Path, Input)> {
        match &self.action {
            Action::Show { dictionary } | Action::Export { dictionary, .. } => vec![(dictionary, Input::Dictionary)],
        }
    }
}

pub fn run(args: &Args, _context: &Context) -> anyhow::Result<Outcome> {
    match &args.action {
        Action::Show { dictionary } => {
            let (json, text) = describe(&find(dictionary)?);
            Ok(Outcome { json, text })
        }
        Action::Export { dictionary, out, force } => {
            let found = find(dictionary)?;
            let ending = out.extension().map(|e| e.to_string_lossy().to_lowercase());
            match ending.as_deref() {
                Some("lfd" | "safetensors") => {
                    output::check_target(out, Kind::File, *force, &[dictionary])?;
                    dictionary::save(out, &found, *force)?;
                }
                None => {
                    output::check_target(out, Kind::Directory, *force, &[dictionary])?;
                    dictionary::export_npy(out, &found, *force)?;
                }
                Some("npy") if out.extension().is_some() => {
                    return Err(
                        Usage("--out: .npy files go into a folder; give its name without an ending".into()).into()
                    );
                }
                Some(other) => {
                    return Err(
                        Usage(format!("--out ends in .{other}: give NAME.lfd, NAME.safetensors, or a folder")).into()
                    );
                }
            }
            let out = out.display().to_string();
            Ok(Outcome { json: json!({ "out": out }), text: out })
        }
    }
}
