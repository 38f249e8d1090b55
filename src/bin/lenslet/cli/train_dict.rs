//! `lenslet train-dict`: dictionaries learned from photos.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use lenslet_core::dictionary::{self, Footprint};
use lenslet_core::input::read_text;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::output::{self, Kind};
use lenslet_core::progress::Observer;
use lenslet_data_gen::pairs::CameraLattice;
use lenslet_train::{
    Algorithm, Coupling, DictionaryParameters, KsvdUpdate, Parameters, train_dictionary, train_on_crops,
};
use serde_json::json;

use super::inputs::{Input, each};
use super::values::{AlgorithmName, FootprintName, KsvdUpdateName, TrainingBase};
use super::written::check_file_name;
use super::{Context, Outcome, Usage, train_report};

/// Longest file of parameters that is read, bytes.
/// Source: chosen.
const MAX_PARAMETERS: u64 = 1 << 20;

/// Learn a dictionary pair Dh/Dl from photos
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example: lenslet train-dict my-photos/ --out mine.lfd
         lenslet train-dict a.jpg b.jpg c.png --out small.lfd --atoms 256 --pairs 50000
         lenslet train-dict my-photos/ --out x3.lfd --grid 3
         lenslet train-dict my-photos/ --out mine.safetensors
         lenslet train-dict my-photos/ --out mine.lfd --resume     (goes on after an interruption)

Folders are searched for .jpg, .png, .tif, .ppm. A photo that cannot be used is noted and left out.
Beside --out, NAME.lfd.checkpoint holds the last whole epoch until training is finished, and NAME.lfd.log.jsonl
one line an epoch; at the end NAME.lfd.plot.svg shows how training went and NAME.lfd.atoms.png the atoms.")]
pub struct Args {
    /// Photos, or folders of photos
    #[arg(required = true, value_name = "PHOTO")]
    photos: Vec<PathBuf>,
    /// The dictionary to write
    #[arg(long, value_name = "NAME.lfd")]
    out: PathBuf,
    /// All parameters from a JSON file; options given here override it
    #[arg(long, value_name = "FILE")]
    parameters: Option<PathBuf>,
    /// Atoms
    #[arg(long, value_name = "K")]
    atoms: Option<usize>,
    /// Side of a patch, pixels
    #[arg(long, value_name = "P")]
    patch: Option<usize>,
    /// λ
    #[arg(value_parser = super::values::finite::<f32>, long, value_name = "L")]
    lambda: Option<f32>,
    /// Learning algorithm
    #[arg(long, value_enum)]
    algorithm: Option<AlgorithmName>,
    /// Update of an atom in K-SVD: exact (the leading singular pair), or approximate (one alternation; the default)
    #[arg(long, value_enum)]
    ksvd_update: Option<KsvdUpdateName>,
    /// Learn Dl alone, then Dh by least squares
    #[arg(long)]
    low_first: bool,
    /// Epochs of learning
    #[arg(long, value_name = "N")]
    epochs: Option<usize>,
    /// Epochs of refinement of Dl and Dh together
    #[arg(long, value_name = "N")]
    refine: Option<usize>,
    /// Training pairs
    #[arg(long, value_name = "N")]
    pairs: Option<usize>,
    /// Anchored regressors of the fast path (0: none)
    #[arg(long, value_name = "N")]
    anchors: Option<usize>,
    /// Factor by which photos are shrunk first (1 to 16)
    #[arg(value_parser = super::values::finite::<f64>, long, value_name = "F")]
    shrink: Option<f64>,
    /// Standard deviation of noise on the samples, of the range 0..1
    #[arg(value_parser = super::values::finite::<f32>, long, value_name = "S")]
    noise: Option<f32>,
    /// Footprints of the samples, one model each
    #[arg(long, value_delimiter = ',', value_enum)]
    footprint: Vec<FootprintName>,
    /// Rectangular grids enlarged bicubically by this factor (1.5 to 8), instead of hexagonal samples: for views of
    /// other tools
    #[arg(value_parser = super::values::finite::<f64>, long, value_name = "SCALE", conflicts_with_all = ["footprint", "calibration"])]
    grid: Option<f64>,
    /// Views that the dictionary is for: barycentric, or multiview, for which the photos are captured by a simulated
    /// camera, decoded and refined
    #[arg(long, value_enum, conflicts_with = "grid")]
    base: Option<TrainingBase>,
    /// Samples at the lenslets of this calibration (each at its own place), for views 1080 pixels wide; with --base
    /// multiview the simulated camera has them
    #[arg(long, value_name = "CAM.calib")]
    calibration: Option<PathBuf>,
    /// The photos hold linear light (default: sRGB-encoded values)
    #[arg(long)]
    linear_light: bool,
    /// GiB that pairs and crops may take (default: 4); fewer pairs where they would not fit
    #[arg(value_parser = super::values::finite::<f64>, long, value_name = "GIB")]
    pairs_memory: Option<f64>,
    /// Seed
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Go on from NAME.lfd.checkpoint
    #[arg(long)]
    resume: bool,
    /// Replace what an earlier training left: NAME.lfd and the files beside it
    #[arg(long)]
    force: bool,
}

fn parameters(args: &Args) -> anyhow::Result<Parameters> {
    let mut p = match &args.parameters {
        None => Parameters::default(),
        Some(path) => {
            let name = path.display();
            let text = read_text(path, MAX_PARAMETERS).with_context(|| format!("cannot read {name}"))?;
            serde_json::from_str(&text).with_context(|| format!("{name} holds no training parameters"))?
        }
    };
    fn set<T: Copy>(to: &mut T, from: Option<T>) {
        if let Some(value) = from {
            *to = value;
        }
    }
    set(&mut p.dictionary.atoms, args.atoms);
    set(&mut p.dictionary.patch, args.patch);
    if let Some(patch) = args.patch {
        p.dictionary.window = patch.clamp(3, 25);
        // A small window has few; the range of --patch itself is checked with all others.
        p.dictionary.features = p.dictionary.features.min(DictionaryParameters::most_features(p.dictionary.window));
    }
    set(&mut p.dictionary.lambda, args.lambda);
    set(&mut p.dictionary.epochs, args.epochs);
    set(&mut p.refinement.epochs, args.refine);
    set(&mut p.pairs.count, args.pairs);
    set(&mut p.anchors.count, args.anchors);
    set(&mut p.pairs.shrink, args.shrink);
    set(&mut p.degradation.noise, args.noise);
    set(&mut p.seed, args.seed);
    set(&mut p.pairs.memory, args.pairs_memory);
    p.pairs.linear_light |= args.linear_light;
    set(&mut p.dictionary.algorithm, args.algorithm.map(Algorithm::from));
    set(&mut p.dictionary.ksvd_update, args.ksvd_update.map(KsvdUpdate::from));
    if args.low_first {
        p.dictionary.coupling = Coupling::Low;
    }
    if !args.footprint.is_empty() {
        p.degradation.footprints.clear();
        for footprint in args.footprint.iter().copied().map(Footprint::from) {
            if p.degradation.footprints.contains(&footprint) {
                return Err(Usage(format!("--footprint names {footprint} twice")).into());
            }
            p.degradation.footprints.push(footprint);
        }
    }
    p.degradation.base = args.base.map(Interpolation::from).or(p.degradation.base);
    if p.degradation.base == Some(Interpolation::Multiview) {
        if args.footprint.is_empty() && p.degradation.footprints.len() != 1 {
            // Nobody said which: views by least squares, where a sample is the scene at a point, as lenslets gather it.
            p.degradation.footprints = vec![Footprint::Point];
        }
        if args.noise.is_some() || args.shrink.is_some() {
            return Err(Usage("--noise and --shrink do not go with --base multiview".into()).into());
        }
    }
    if let Some(path) = &args.calibration {
        let calibration = lenslet_core::calibration::load(path)?;
        let (w, h) = (calibration.width, calibration.height);
        p.degradation.pitch = calibration.lattice.pitch() * 1080.0 / w.max(h).max(1) as f64;
        p.degradation.rotation = calibration.lattice.rotation();
        p.degradation.lattice = Some(CameraLattice::of_calibration(&calibration, 1080)?);
    }
    if let Some(scale) = args.grid {
        if !(1.5..=8.0).contains(&scale) {
            return Err(Usage(format!("--grid {scale} is out of range (1.5 to 8)")).into());
        }
        (p.degradation.footprints, p.degradation.pitch, p.degradation.rotation) = (vec![Footprint::Grid], scale, 0.0);
    }
    p.check().map_err(|e| Usage(e.to_string()))?;
    Ok(p)
}

/// The log of a training: a line an epoch, all of it written again with each, so that it is whole at every moment.
struct EpochLog<'a> {
    path: &'a Path,
    replace: bool,
    text: String,
}

impl EpochLog<'_> {
    /// Adds an epoch. Nothing is written before there is a checkpoint, so that training that is stopped before its first
    /// one leaves nothing behind.
    fn add(&mut self, epoch: &lenslet_train::Epoch, checkpoint: &Path) -> anyhow::Result<()> {
        let mut line = serde_json::to_value(epoch)?;
        line["tool"] = concat!("lenslet ", env!("CARGO_PKG_VERSION")).into();
        self.text += &format!("{line}\n");
        if checkpoint.exists() { self.write() } else { Ok(()) }
    }

    fn write(&mut self) -> anyhow::Result<()> {
        output::write_file(self.path, self.replace, self.text.as_bytes())?;
        // From now on it is this run's own.
        self.replace = true;
        Ok(())
    }
}

impl Args {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> Vec<(&Path, Input)> {
        let parameters = self.parameters.as_deref().map(|p| (p, Input::Text));
        let calibration = self.calibration.as_deref().map(|p| (p, Input::CalibrationFile));
        each(&self.photos, Input::Photos).chain(parameters).chain(calibration).collect()
    }
}

pub fn run(args: &Args, context: &Context) -> anyhow::Result<Outcome> {
    check_file_name(&args.out, &["lfd", "safetensors"])?;
    let parameters = parameters(args)?;
    let beside = |ending: &str| {
        let mut name = args.out.clone().into_os_string();
        name.push(ending);
        PathBuf::from(name)
    };
    let (checkpoint, log) = (beside(".checkpoint"), beside(".log.jsonl"));
    if args.resume && !checkpoint.exists() {
        anyhow::bail!("{} does not exist: nothing to resume; start without --resume", checkpoint.display());
    }
    // Before minutes of training. A dictionary beside a checkpoint is of a run that was stopped between writing the one
    // and removing the other.
    let replace = args.force || args.resume;
    let (plot, mosaic) = (beside(".plot.svg"), beside(".atoms.png"));
    let mut inputs: Vec<&Path> = args.photos.iter().map(PathBuf::as_path).collect();
    inputs.extend(args.parameters.as_deref().into_iter().chain(args.calibration.as_deref()));
    if !replace && checkpoint.symlink_metadata().is_ok() {
        anyhow::bail!(
            "{} is of training that was interrupted: go on with --resume, or add --force to begin anew",
            checkpoint.display()
        );
    }
    for path in [&args.out, &checkpoint, &log, &plot, &mosaic] {
        output::check_target(path, Kind::File, replace, &inputs)?;
    }
    let mut lines = EpochLog { path: &log, replace, text: String::new() };
    let mut lost = None;
    let mut line = |epoch: &lenslet_train::Epoch| {
        if let Err(e) = lines.add(epoch, &checkpoint) {
            lost = Some(e);
        }
    };
    let progress = &context.progress;
    let outcome = if parameters.degradation.base == Some(Interpolation::Multiview) {
        let mut crops = |footprint, observer: &dyn lenslet_core::progress::Observer| {
            lenslet_train::captured_crops(&args.photos, &parameters, footprint, observer)
        };
        train_on_crops(&mut crops, &parameters, Some(&checkpoint), args.resume, progress, &mut line)
    } else {
        train_dictionary(&args.photos, &parameters, Some(&checkpoint), args.resume, progress, &mut line)
    };
    let outcome = outcome?;
    if let Err(e) = lines.write() {
        lost = Some(e);
    }
    dictionary::save(&args.out, &outcome.dictionary, replace)?;
    // Plots are optional: a note when they cannot be written.
    let pictures = output::write_file(&plot, replace, train_report::convergence(&outcome.trace).as_bytes())
        .map_err(anyhow::Error::from)
        .and_then(|()| Ok(output::write_file(&mosaic, replace, &train_report::mosaic(&outcome.dictionary)?.bytes)?));
    if let Err(e) = pictures {
        context.progress.note(&format!("no pictures of the run: {e:#}"));
    }
    // A checkpoint of a finished run would be resumed by mistake.
    let _ = std::fs::remove_file(&checkpoint);
    // Only now, so that the dictionary is kept although the log could not be written.
    if let Some(e) = lost {
        return Err(e.context(format!("cannot write {}", log.display())));
    }

    let bytes = std::fs::metadata(&args.out).map(|m| m.len()).unwrap_or(0);
    let scores = &outcome.dictionary.recipe.scores;
    let photos = outcome.dictionary.recipe.photos.len();
    let text = format!(
        "{}: {} atoms from {photos} photos ({} left out), {bytes} bytes\n{}",
        args.out.display(),
        parameters.dictionary.atoms,
        outcome.skipped.len(),
        serde_json::to_string(scores)?
    );
    let json = json!({
        "out": args.out.display().to_string(), "bytes": bytes, "photos": photos, "skipped": outcome.skipped,
        "parameters": parameters, "scores": scores, "epochs": outcome.trace,
        "log": log.display().to_string(), "plot": plot.display().to_string(), "atoms": mosaic.display().to_string(),
    });
    Ok(Outcome { json, text })
}
