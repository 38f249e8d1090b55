//! `lenslet calibrate`: white images (or ordinary captures) of a camera to its calibration file.

use std::path::{Path, PathBuf};

use lenslet_core::calibration::{self, Calibration, Options, Variant};
use lenslet_core::container::{self, Capture};
use lenslet_core::output;
use lenslet_core::progress::Observer;
use serde_json::{Value, json};

use super::{Context, Interrupted, Outcome};

/// Calibrate a camera: find the centre of every lenslet in white images
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet calibrate white-00.lfp white-01.lfp --out cam.calib

White images are captures of an evenly lit white surface; several of one camera, zoom and focus are averaged. Accepted are
.lfp containers, .raw with the .txt or .json beside it, and mosaics as png, tif or jpg.")]
pub struct Args {
    /// White images of one camera
    #[arg(required_unless_present = "from_captures", value_name = "WHITE")]
    whites: Vec<PathBuf>,
    /// Ordinary captures of one camera instead of white images: five are typical, two give lenslets of their own places
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with = "whites")]
    from_captures: Vec<PathBuf>,
    /// The calibration file to write
    #[arg(short, long, value_name = "CAM.calib")]
    out: PathBuf,
    /// Replace an existing file
    #[arg(short, long)]
    force: bool,
    /// Camera profile, where the files do not name their camera
    #[arg(long, value_name = "NAME")]
    profile: Option<String>,
    /// Which centres to give, for comparison: full, paper, integer, rotation-only or none
    #[arg(long, value_name = "NAME", default_value_t)]
    variant: Variant,
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    refuse_existing(&args.out, args.force)?;
    let options = Options { variant: args.variant, ..Options::default() };
    let whites = args.from_captures.is_empty();
    let paths = if whites { &args.whites } else { &args.from_captures };
    let captures = open(paths, args.profile.as_deref(), context)?;
    let found = if whites {
        calibration::calibrate(&captures, &options, &context.progress)
    } else {
        calibration::from_captures(&captures, &options, &context.progress)
    };
    let found = found.map_err(|e| failed(e, paths))?;
    calibration::save(&args.out, &found, args.force)?;
    let json = summary(&found);
    let text = format!("{}\n{}", args.out.display(), describe(&found));
    Ok(Outcome { json, text })
}

/// Says so before the work, not after it; `save` looks again.
fn refuse_existing(path: &Path, force: bool) -> anyhow::Result<()> {
    if !force && path.symlink_metadata().is_ok() {
        return Err(output::Error::Exists(path.to_path_buf()).into());
    }
    Ok(())
}

fn open(paths: &[PathBuf], profile: Option<&str>, context: &Context) -> anyhow::Result<Vec<Capture>> {
    let mut captures = Vec::new();
    for path in paths {
        let capture = container::open(path, profile)?;
        for warning in &capture.warnings {
            context.progress.note(&format!("{}: {warning}", path.display()));
        }
        captures.push(capture);
        context.progress.check()?;
    }
    Ok(captures)
}

/// An error with the file it is about.
fn failed(error: calibration::Error, paths: &[PathBuf]) -> anyhow::Error {
    use calibration::Error as E;
    let about = match &error {
        E::Interrupted => return Interrupted.into(),
        E::BadImage { index, .. } | E::SizesDiffer { index, .. } | E::CamerasDiffer { index, .. } => {
            paths.get(index - 1)
        }
        _ => paths.first(),
    };
    match about {
        Some(path) => anyhow::Error::new(error).context(path.display().to_string()),
        None => error.into(),
    }
}

/// What a calibration is, for machines; `info` prints the same words.
fn summary(c: &Calibration) -> Value {
    json!({
        "pitch": c.lattice.pitch(),
        "rotation": c.lattice.rotation(),
        "row_stretch": c.lattice.row_stretch(),
        "grid": c.lattice.grid,
        "count": c.lenslets.len(),
        "residual_rms": c.quality.residual_rms,
        "scatter": c.quality.scatter,
        "noise": c.quality.noise,
        "rejected": c.quality.rejected,
        "confidence": c.quality.confidence,
        "width": c.width,
        "height": c.height,
        "origin": c.origin,
    })
}

fn describe(c: &Calibration) -> String {
    format!(
        "{} lenslets, pitch {:.4} px, rotation {:.5} rad ({:.4} degrees), row stretch {:.5}\n\
         residual {:.4} px RMS (lenslets scatter {:.4} px, measured to {:.4} px an axis), {:.2} % rejected, confidence {:.2}",
        c.lenslets.len(),
        c.lattice.pitch(),
        c.lattice.rotation(),
        c.lattice.rotation().to_degrees(),
        c.lattice.row_stretch(),
        c.quality.residual_rms,
        c.quality.scatter,
        c.quality.noise,
        100.0 * c.quality.rejected,
        c.quality.confidence,
    )
}
