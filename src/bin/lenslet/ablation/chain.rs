//! A run from its capture to its scores: calibrate, decode, render as the chain says, compare.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context as _, Result};
use lenslet_core::calibration::CalibrationVariant;
use lenslet_core::container;
use lenslet_core::decode::{self, Step};
use lenslet_core::dictionary::{Dictionary, Interpolation};
use lenslet_core::digest::sha256_hex;
use lenslet_core::progress::Observer;
use lenslet_data_gen::simulate::Kind;
use ndarray::Array3;

use super::matrix::{Chain, Experiment, Run, Way};
use super::real::Real;
use super::record::Scored;
use super::render::{Kept, render};
use super::world::Worlds;
use super::{Settings, dictionaries, picture, scores};
use lenslet_views::reconstruct;
use lenslet_views::{Target, multiview};

/// Share of lenslets hidden on real captures.
const HIDDEN: f64 = 0.1;
/// Longer side of real captures' views, pixels.
const SIDE: usize = 1080;

/// What runs share, so that nothing is made twice in a call.
pub(super) struct Stock {
    worlds: Worlds,
    real: Real,
    kept: Kept,
}

impl Stock {
    pub(super) fn new(settings: &Settings) -> Self {
        Stock { worlds: Worlds::new(settings), real: Real::default(), kept: Kept::default() }
    }
}

/// A simulated scene, scored against its truth.
pub(super) fn simulated(
    run: &Run,
    kind: Kind,
    settings: &Settings,
    stock: &mut Stock,
    out: &Path,
    observer: &dyn Observer,
) -> Result<Scored> {
    let chain = &run.chain;
    let Stock { worlds, kept, .. } = stock;
    let mut scored = Scored::default();
    let dictionary = dictionary(chain, run.seed, settings, worlds, &mut scored, observer)?;
    let world = worlds.get(kind, run.seed, chain.noise, observer)?;
    let variant: CalibrationVariant = chain.calibration.parse().map_err(anyhow::Error::msg)?;
    let calibration = world.calibration(variant, observer)?.clone();
    let target = Target { width: world.size.0, height: world.size.1 };

    // The middle view, one at the rim of the micro-images, and the corner, where little light is left.
    let (n, middle) = (chain.views, chain.views / 2);
    let wanted = [(middle, middle), (middle, n - 1), (0, 0)];
    let steps = to_samples(chain)?;
    kept.enter(&format!("{} {} {}", kind.name(), run.seed, chain.noise), "");
    let (samples, views) = kept.decoded(&steps, || {
        Ok(decode::samples(&world.simulation.capture, &calibration, &options(chain)?, observer)?)
    })?;
    let rendered = render((&steps, samples), &target, chain.way, &wanted, dictionary.as_ref(), views, observer)?;
    scored.step_seconds = rendered.seconds;
    let images = rendered.images;

    if matches!(run.experiment, Experiment::Calibration | Experiment::Subpixel | Experiment::Noise) {
        let centres: Vec<[f64; 2]> = calibration.lenslets.iter().map(|l| [l.x, l.y]).collect();
        scored.scores.insert("centres_rms".into(), scores::centres_rms(&centres, &world.simulation.centres));
    }
    let truths: Vec<Array3<f32>> = wanted.iter().map(|&(v, u)| world.truth(v, u, n).clone()).collect();
    scores::against_truth(&images, &truths, &mut scored.scores)?;
    if matches!(kind, Kind::Chart | Kind::Flat | Kind::Slanted) {
        let steps = ((n - 1 - middle) as f64, 0.0);
        scores::agreement(&images, &world.disparity(), steps, &mut scored.scores)?;
    }
    if kind == Kind::Chart {
        scores::chart(&images[0], &truths[0], &world.scene.regions, world.pitch(), &mut scored.scores);
    }
    if run.seed == 1 {
        let crop = picture::place(kind, &world.scene.regions, world.size);
        scored.pictures = picture::save(out, &run.key(), &images[0], Some(&truths[0]), crop)?;
    }
    Ok(scored)
}

/// A real capture, scored on hidden lenslets.
pub(super) fn captured(
    run: &Run,
    path: &Path,
    settings: &Settings,
    stock: &mut Stock,
    out: &Path,
    observer: &dyn Observer,
) -> Result<Scored> {
    let chain = &run.chain;
    let Stock { real, kept, .. } = stock;
    let mut scored = Scored::default();
    let variant: CalibrationVariant = chain.calibration.parse().map_err(anyhow::Error::msg)?;
    let (capture, calibration) = real.get(path, &settings.whites, variant, observer)?;
    let target = Target::longer((capture.mosaic.width, capture.mosaic.height), SIDE);
    let middle = chain.views / 2;
    let wanted = [(middle, middle)];
    let dictionary = embedded(chain.way)?;
    let steps = to_samples(chain)?;
    kept.enter(&path.to_string_lossy(), &run.seed.to_string());
    let mut options = options(chain)?;
    // As `decode` does it: colours that went through a JPEG coder are calmed, and scores are of linear light.
    options.steps.retain(|s| !matches!(s, Step::Gamut));
    if container::is_jpeg(path) {
        let after = options.steps.iter().position(|s| matches!(s, Step::Demosaic(_))).map_or(0, |k| k + 1);
        options.steps.insert(after, Step::CalmColours);
    }
    let (samples, views) = kept.decoded(&steps, || Ok(decode::samples(capture, calibration, &options, observer)?))?;
    let mut image = None;
    let score = multiview::hidden_score::<anyhow::Error>(samples, &target, HIDDEN, run.seed, wanted[0], &mut |rest| {
        let mut rendered = render((&steps, rest), &target, chain.way, &wanted, dictionary.as_ref(), views, observer)?;
        scored.step_seconds = rendered.seconds;
        let view = rendered.images.pop().context("no view was rendered")?;
        Ok(image.insert(view).clone())
    })?;
    scored.scores.insert("hidden_psnr".into(), score.psnr);
    if let Some(image) = image.filter(|_| run.seed == 1) {
        let crop = picture::of_most_detail(&capture.mosaic, (target.width, target.height));
        scored.pictures = picture::save(out, &run.key(), &image, None, crop)?;
    }
    scored.hashes = real.hashes(&settings.whites);
    Ok(scored)
}

/// Names all of a chain's steps up to the samples.
fn to_samples(chain: &Chain) -> Result<String> {
    let same = Chain { way: Way::Barycentric, training: None, ..chain.clone() };
    Ok(serde_json::to_string(&same)?)
}

fn options(chain: &Chain) -> Result<decode::Options> {
    Ok(decode::Options { views: chain.views, steps: chain.steps()?, ..decode::Options::default() })
}

/// The embedded dictionary for a way that needs one.
fn embedded(way: Way) -> Result<Option<Dictionary>> {
    let base = match way {
        Way::Learned => Interpolation::Barycentric,
        Way::LearnedMultiview => Interpolation::Multiview,
        _ => return Ok(None),
    };
    reconstruct::embedded_for(base).map(Some).context("the embedded dictionary")
}

/// The dictionary of the run: trained for it, or the embedded one where its way needs one.
fn dictionary(
    chain: &Chain,
    seed: u64,
    settings: &Settings,
    worlds: &mut Worlds,
    scored: &mut Scored,
    observer: &dyn Observer,
) -> Result<Option<Dictionary>> {
    let Some(training) = &chain.training else {
        return embedded(chain.way);
    };
    let trained = dictionaries::trained(training, seed, settings, worlds.trained(), observer)?;
    scored.scores.insert("train_seconds".into(), trained.seconds);
    let bytes = lenslet_core::dictionary::to_bytes(&trained.dictionary)?;
    let digest = sha256_hex(&bytes);
    scored.hashes = BTreeMap::from([("dictionary".to_owned(), digest)]);
    Ok(Some(trained.dictionary.clone()))
}
