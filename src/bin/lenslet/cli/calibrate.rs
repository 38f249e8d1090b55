//! `lenslet calibrate`: white images (or ordinary captures, or a camera's whole bundle) to calibration files.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use lenslet::image_io::Picture;
use lenslet_core::calibration::{self, Calibration, CalibrationOptions, CalibrationVariant, paper};
use lenslet_core::container::Capture;
use lenslet_core::container::whites::{self, CalibrationImage, ExposureClass};
use lenslet_core::output::{self, Kind};
use lenslet_core::progress::{Observer, Silent};
use serde_json::{Value, json};

use super::inputs::{Input, each};
use super::written::check_file_name;
use super::{Context, Outcome};
use crate::report::calibration_figures;

/// Black images of a camera that are used, at most.
/// Source: chosen.
const MOST_BLACKS: usize = 8;

/// Calibrate a camera: find the centre of every lenslet in white images
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet calibrate white-00.lfp white-01.lfp --out cam.calib

White images are captures of an evenly lit white surface; several of one camera, zoom and focus are averaged. Accepted are
.lfp containers, .raw with the .txt or .json beside it, and mosaics as png, tif or jpg. Of several images, unusable ones are left out
with a note.")]
pub struct Args {
    /// White images of one camera
    #[arg(required_unless_present_any = ["from_captures", "bundle"], value_name = "WHITE")]
    whites: Vec<PathBuf>,
    /// Ordinary captures of one camera instead of white images: five are typical; from two on every lenslet is
    /// measured, from one only the lattice
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with = "whites")]
    from_captures: Vec<PathBuf>,
    /// A camera's calibration folder, data.C.n bundle or .tar: calibrates every zoom and focus in it; --out is a folder
    /// then
    #[arg(long, value_name = "DIR", conflicts_with_all = ["whites", "from_captures", "picture", "dump"])]
    bundle: Option<PathBuf>,
    /// Black images (taken with the lens covered): their hot pixels are left out here and in decoding
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with = "bundle")]
    black: Vec<PathBuf>,
    /// The calibration file (with --bundle: folder) to write
    #[arg(short, long, value_name = "CAM.calib")]
    out: PathBuf,
    /// Replace an existing file
    #[arg(short, long)]
    force: bool,
    /// Camera profile (a name or a TOML file), where the files do not name their camera
    #[arg(long, value_name = "NAME")]
    profile: Option<String>,
    /// Which centres to write, for comparison: full, paper, integer, rotation-only or none
    #[arg(long, value_name = "NAME", default_value_t)]
    variant: CalibrationVariant,
    /// Also draw centres and triangulation over the white image: OUT.png whole, OUT-close.png enlarged,
    /// OUT-residuals.png how far the lenslets lie from the regular lattice
    #[arg(long, value_name = "OUT.png")]
    picture: Option<PathBuf>,
    /// Also write the images of the paper's own steps (figures 4 to 6) into a new folder
    #[arg(long, value_name = "DIR")]
    dump: Option<PathBuf>,
}

impl Args {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> Vec<(&Path, Input)> {
        let files = each(&self.whites, Input::WhiteImage);
        let files =
            files.chain(each(&self.from_captures, Input::CaptureFile)).chain(each(&self.black, Input::WhiteImage));
        files.chain(self.bundle.as_deref().map(|p| (p, Input::Bundle))).collect()
    }
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    if let Some(place) = &args.bundle {
        return bundle(args, place, context);
    }
    let pictures = args.picture.as_deref().map(pictures_of).unwrap_or_default();
    let whites = args.from_captures.is_empty();
    let given = if whites { &args.whites } else { &args.from_captures };
    let inputs: Vec<&Path> = given.iter().chain(&args.black).map(PathBuf::as_path).collect();
    check_file_name(&args.out, &["calib"])?;
    for path in pictures.iter().chain([&args.out]) {
        output::check_target(path, Kind::File, args.force, &inputs)?;
    }
    if let Some(folder) = &args.dump {
        output::check_target(folder, Kind::Directory, args.force, &inputs)?;
    }
    let (paths, captures) = calibration::open_captures(given, args.profile.as_deref(), &context.progress)?;
    let options = CalibrationOptions {
        variant: args.variant,
        hot_pixels: hot_pixels_of_files(args, &captures[0], context)?,
        names: paths.iter().map(|p| p.display().to_string()).collect(),
        ..CalibrationOptions::default()
    };
    let found = if whites {
        calibration::calibrate(&captures, &options, &context.progress)
    } else {
        calibration::calibrate_from_captures(&captures, &options, &context.progress)
    };
    let found = found.map_err(|e| e.in_file_of(&paths))?;
    calibration::save(&args.out, &found, args.force)?;
    if !pictures.is_empty() {
        let [whole, close] = calibration_figures::draw_centres(&found);
        let far = calibration_figures::residual_scale(&found);
        let residuals = calibration_figures::draw_residuals(&found, far);
        context.progress.note(&format!("residual map: full brightness is {far:.3} px off the regular lattice"));
        for (path, picture) in pictures.iter().zip([whole, close, residuals]) {
            write_picture(path, args.force, picture)?;
        }
    }
    if let Some(folder) = &args.dump {
        // What is left out has been noted.
        let kept = calibration::screen_captures(&captures, &options, &Silent).map_err(|e| e.in_file_of(&paths))?;
        let kept: Vec<&Capture> = kept.into_iter().map(|k| k.1).collect();
        let stages = paper::run_algorithm1(&kept, &context.progress).map_err(|e| e.in_file_of(&paths))?;
        let pending = output::Pending::directory(folder, args.force)?;
        for (name, picture) in calibration_figures::draw_algorithm1(&stages, kept[0].cfa) {
            write_picture(&pending.path().join(name), false, picture)?;
        }
        pending.commit()?;
    }
    let json = summary(&found);
    let text = format!("{}\n{}", args.out.display(), describe(&found));
    Ok(Outcome { json, text })
}

/// The names of the three pictures.
fn pictures_of(path: &Path) -> Vec<PathBuf> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let named = |what: &str| path.with_file_name(format!("{stem}-{what}.png"));
    vec![path.to_path_buf(), named("close"), named("residuals")]
}

fn write_picture(path: &Path, force: bool, picture: Picture) -> anyhow::Result<()> {
    Ok(output::write_file(path, force, &picture.to_png()?)?)
}

/// One calibration for each body, zoom and focus among the white images of a folder, bundle or archive.
fn bundle(args: &Args, place: &Path, context: &Context) -> anyhow::Result<Outcome> {
    output::check_target(&args.out, Kind::Directory, args.force, &[place])?;
    let found = whites::list_calibration_images(place)?;
    for warning in &found.warnings {
        context.progress.note(warning);
    }
    type Key = (Option<String>, Option<i64>, Option<i64>);
    let mut groups: BTreeMap<Key, Vec<&CalibrationImage>> = BTreeMap::new();
    for candidate in found.images.iter().filter(|c| c.class == ExposureClass::White) {
        let camera = &candidate.frame.camera;
        groups.entry((camera.serial.clone(), camera.zoom_step, camera.focus_step)).or_default().push(candidate);
    }
    let bodies: BTreeSet<&str> = groups.keys().filter_map(|k| k.0.as_deref()).collect();
    if bodies.len() > 1 {
        let list: Vec<&str> = bodies.into_iter().collect();
        anyhow::bail!(
            "{}: white images of several cameras ({}); give the folder or archive of one",
            place.display(),
            list.join(", ")
        );
    }
    if groups.is_empty() {
        let there = found.images.len();
        anyhow::bail!(
            "{}: no white image bright enough to calibrate from ({there} images there are black, dark or saturated)",
            place.display()
        );
    }
    let pending = output::Pending::directory(&args.out, args.force)?;
    let mut hot: BTreeMap<&Option<String>, Vec<u32>> = BTreeMap::new();
    let (mut list, mut text) = (Vec::new(), String::new());
    for (number, ((serial, zoom, focus), candidates)) in groups.iter().enumerate() {
        let name = file_name(serial.as_deref(), *zoom, *focus, number);
        let (mut captures, mut labels) = (Vec::new(), Vec::new());
        for candidate in candidates {
            match candidate.load() {
                Ok(capture) => {
                    captures.push(capture);
                    labels.push(PathBuf::from(candidate.member.label()));
                }
                Err(e) => context.progress.note(&format!("{e}: left out")),
            }
            context.progress.check()?;
        }
        let Some(white) = captures.first() else { continue };
        let hot_pixels = match hot.get(serial) {
            Some(known) => known.clone(),
            None => {
                let blacks = whites::black_images(&found, &white.camera);
                let known = hot_pixels(&blacks, white, context)?;
                hot.entry(serial).or_insert(known).clone()
            }
        };
        let names = labels.iter().map(|l| l.display().to_string()).collect();
        let options = CalibrationOptions { variant: args.variant, hot_pixels, names, ..CalibrationOptions::default() };
        match calibration::calibrate(&captures, &options, &context.progress) {
            Ok(calibration) => {
                calibration::save(&pending.path().join(&name), &calibration, false)?;
                let mut json = summary(&calibration);
                json["file"] = name.clone().into();
                list.push(json);
                text.push_str(&format!("{name}: {} white images\n{}\n", captures.len(), describe(&calibration)));
            }
            Err(e @ calibration::Error::Interrupted(_)) => return Err(e.into()),
            // A pair that cannot be calibrated is noted; the others are kept.
            Err(e) => context.progress.note(&e.in_file_of(&labels).to_string()),
        }
    }
    if list.is_empty() {
        anyhow::bail!("{}: none of its white images could be calibrated", place.display());
    }
    pending.commit()?;
    Ok(Outcome { json: json!({ "calibrations": list }), text })
}

/// A file name of what distinguishes the calibrations of a bundle; `number` where nothing does.
fn file_name(serial: Option<&str>, zoom: Option<i64>, focus: Option<i64>, number: usize) -> String {
    let mut parts = Vec::new();
    // A serial number comes from a file: only harmless characters of it may become part of a name.
    let tame: String = serial.unwrap_or("").chars().filter(char::is_ascii_alphanumeric).take(40).collect();
    if !tame.is_empty() {
        parts.push(tame);
    }
    parts.extend(zoom.map(|z| format!("zoom{z}")));
    parts.extend(focus.map(|f| format!("focus{f}")));
    if parts.is_empty() {
        parts.push(format!("camera{number}"));
    }
    parts.join("-") + ".calib"
}

/// Hot pixels of the files given with --black, for the camera of `white`.
fn hot_pixels_of_files(args: &Args, white: &Capture, context: &Context) -> anyhow::Result<Vec<u32>> {
    let (paths, blacks) = match args.black.as_slice() {
        [] => return Ok(Vec::new()),
        some => calibration::open_captures(some, args.profile.as_deref(), &context.progress)?,
    };
    for (path, black) in paths.iter().zip(&blacks) {
        anyhow::ensure!(
            same_sensor(black, white),
            "{}: the black image is not of the camera of the others ({}x{}, serial {})",
            path.display(),
            white.mosaic.width,
            white.mosaic.height,
            white.camera.serial.as_deref().unwrap_or("unknown")
        );
    }
    let hot = calibration::find_hot_pixels(&blacks).map_err(|e| e.in_file_of(&paths))?;
    context.progress.note(&format!("{} hot pixels in {} black images", hot.len(), blacks.len()));
    Ok(hot)
}

/// Hot pixels of the black images of a calibration folder or bundle, for the camera of `white`; black images that
/// cannot be used are passed over with a note.
pub fn hot_pixels(candidates: &[&CalibrationImage], white: &Capture, context: &Context) -> anyhow::Result<Vec<u32>> {
    let (mut paths, mut blacks) = (Vec::new(), Vec::new());
    for candidate in candidates.iter().take(MOST_BLACKS) {
        match candidate.load() {
            Ok(black) if same_sensor(&black, white) => {
                paths.push(PathBuf::from(candidate.member.label()));
                blacks.push(black);
            }
            Ok(_) => {}
            Err(e) => context.progress.note(&format!("{e}: left out")),
        }
        context.progress.check()?;
    }
    match calibration::find_hot_pixels(&blacks) {
        Ok(hot) => {
            if !blacks.is_empty() {
                context.progress.note(&format!("{} hot pixels in {} black images", hot.len(), blacks.len()));
            }
            Ok(hot)
        }
        Err(e) => {
            context.progress.note(&format!("{}: hot pixels not known", e.in_file_of(&paths)));
            Ok(Vec::new())
        }
    }
}

/// Whether two captures can be of one sensor.
fn same_sensor(a: &Capture, b: &Capture) -> bool {
    let size = |c: &Capture| (c.mosaic.width, c.mosaic.height);
    let serials = (&a.camera.serial, &b.camera.serial);
    size(a) == size(b) && !matches!(serials, (Some(a), Some(b)) if a != b)
}

/// A calibration as JSON; `info` prints the same keys.
pub fn summary(c: &Calibration) -> Value {
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
        "hot_pixels": c.hot_pixels.len(),
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
