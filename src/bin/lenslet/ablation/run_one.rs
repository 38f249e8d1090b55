//! A run from its capture to its scores: calibrate, decode, render and score by its [`Chain`].

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context as _, Result};
use lenslet_core::calibration::CalibrationVariant;
use lenslet_core::decode::{self, HexSamples};
use lenslet_core::dictionary::Dictionary;
use lenslet_core::digest::sha256_hex;
use lenslet_core::geometry::Size;
use lenslet_core::progress::Observer;
use lenslet_data_gen::simulate::SceneName;
use ndarray::Array3;

use super::chain::Chain;
use super::experiment::Experiment;
use super::matrix::{Run, Subject};
use super::measured_capture::{MeasuredCapture, WITHHELD};
use super::method::Method;
use super::real_capture::RealCaptures;
use super::record::Scored;
use super::render::{RenderCache, base, keep_view, render};
use super::settings::Settings;
use super::simulated_capture::SimulatedCaptures;
use super::simulated_scene::SimulatedScene;
use super::{crops, dictionaries, peers, scores};

/// Longer side of real captures' views, pixels.
/// Source: paper section 4.
const SIDE: usize = 1080;

/// What runs share, so that nothing is made twice in a call.
pub(super) struct Caches {
    simulated: SimulatedCaptures,
    real: RealCaptures,
    rendered: RenderCache,
    measured: MeasuredCapture,
}

impl Caches {
    pub(super) fn new(settings: &Settings) -> Self {
        Caches {
            simulated: SimulatedCaptures::new(settings),
            real: RealCaptures::default(),
            rendered: RenderCache::default(),
            measured: MeasuredCapture::default(),
        }
    }
}

/// Makes the views of a run and scores them.
pub(super) fn run_one(
    run: &Run,
    settings: &Settings,
    caches: &mut Caches,
    out: &Path,
    observer: &dyn Observer,
) -> Result<Scored> {
    match &run.subject {
        Subject::Scene(kind) => run_simulated(run, *kind, settings, caches, out, observer),
        Subject::Capture(path) => run_captured(run, path, settings, caches, out, observer),
        Subject::Peer(name, path) => peers::score_peer(name, path, settings, out, run),
    }
}

/// A simulated scene, scored against its truth.
fn run_simulated(
    run: &Run,
    kind: SimulatedScene,
    settings: &Settings,
    caches: &mut Caches,
    out: &Path,
    observer: &dyn Observer,
) -> Result<Scored> {
    let chain = &run.chain;
    let Caches { simulated, rendered, .. } = caches;
    let mut scored = Scored::default();
    let dictionary = dictionary_of(chain, run.seed, settings, simulated, &mut scored, observer)?;
    let capture = simulated.get(kind, run.seed, chain.noise, observer)?;
    let calibration = capture.calibration(chain.calibration, observer)?.clone();
    let target = capture.size;

    // The middle view, one at the rim of the micro-images, and the corner, where little light is left.
    let (n, middle) = (chain.views, chain.views / 2);
    let wanted = [(middle, middle), (middle, n - 1), (0, 0)];
    let steps = steps_to_samples(chain)?;
    rendered.enter(&format!("{} {} {}", kind.name(), run.seed, chain.noise), "");
    let (samples, kept) = rendered.decoded(&steps, || {
        Ok(decode::sample_views(&capture.simulation.capture, &calibration, &decode_options(chain), observer)?)
    })?;
    let views = render((&steps, samples), &target, chain.method, &wanted, dictionary.as_ref(), kept, observer)?;
    scored.step_seconds = views.seconds;
    let images = views.images;

    if matches!(run.experiment, Experiment::Calibration | Experiment::Subpixel | Experiment::Noise | Experiment::Paper)
    {
        let centres: Vec<[f64; 2]> = calibration.lenslets.iter().map(|l| [l.x, l.y]).collect();
        scored.scores.insert("centres_rms".into(), scores::centres_rms(&centres, &capture.simulation.centres));
    }
    let truth = run.experiment.truth();
    let truths: Vec<Array3<f32>> = wanted.iter().map(|&(v, u)| capture.truth(truth, v, u, n).clone()).collect();
    scores::score_against_truth(&images, &truths, &mut scored.scores)?;
    if let SimulatedScene::Drawn(SceneName::Chart | SceneName::Flat | SceneName::Slanted) = kind {
        let steps = ((n - 1 - middle) as f64, 0.0);
        scores::score_agreement(&images, &capture.disparity(), steps, &mut scored.scores)?;
    }
    let chart = kind == SceneName::Chart.into();
    if chart {
        scores::score_chart(&images[0], &truths[0], &capture.scenes.sharp.regions, capture.pitch(), &mut scored.scores);
    }
    if run.seed == 1 {
        let crop = crops::corner_in_scene(chart, &capture.scenes.sharp.regions, capture.size);
        scored.pictures = crops::save_crops(out, &run.key(), &images[0], Some(&truths[0]), crop)?;
    }
    Ok(scored)
}

/// A real capture, measured without a ground truth.
fn run_captured(
    run: &Run,
    path: &Path,
    settings: &Settings,
    caches: &mut Caches,
    out: &Path,
    observer: &dyn Observer,
) -> Result<Scored> {
    let chain = &run.chain;
    let Caches { real, rendered, measured, .. } = caches;
    let mut scored = Scored::default();
    if matches!(run.experiment, Experiment::Calibration | Experiment::Subpixel) {
        let (capture, all) = real.get(path, &settings.calibrated_by, &CalibrationVariant::ALL, observer)?;
        let scores = measured.calibration_scores(path, capture, &all, SIDE, observer)?;
        let at = CalibrationVariant::ALL.iter().position(|v| *v == chain.calibration).unwrap_or_default();
        scored.scores.extend(scores[at].clone());
    }
    let (capture, calibrations) = real.get(path, &settings.calibrated_by, &[chain.calibration], observer)?;
    let target = Size::new(capture.mosaic.width, capture.mosaic.height).with_longer_side(SIDE);
    let middle = chain.views / 2;
    let wanted = [(middle, middle)];
    let dictionary = settings.dictionaries.of(chain.method).map(|d| &d.dictionary);
    let steps = steps_to_samples(chain)?;
    rendered.enter(&path.to_string_lossy(), chain.calibration.name());
    let mut options = decode_options(chain);
    // The steps on samples that `decode` takes for this capture.
    options.steps.view = decode::steps_for(capture).view;
    let (samples, kept) =
        rendered.decoded(&steps, || Ok(decode::sample_views(capture, calibrations[0], &options, observer)?))?;
    let mut made = render((&steps, samples), &target, chain.method, &wanted, dictionary, kept, observer)?;
    scored.step_seconds = made.seconds;
    let image = made.images.pop().context("no view was rendered")?;
    if run.experiment == Experiment::Resampling {
        let methods = measured.method_measures(path, samples, &target, observer)?;
        let mut again = |steps: &str, samples: &HexSamples| -> Result<Array3<f32>> {
            if steps == WITHHELD {
                let base = base(chain.method, dictionary)?;
                keep_view(kept, steps, base, || methods.refined_withheld(samples, base.fit(), observer))?;
            }
            let mut made = render((steps, samples), &target, chain.method, &wanted, dictionary, kept, observer)?;
            made.images.pop().context("no view was rendered")
        };
        scored.scores.extend(methods.scores_of(samples, &image, chain.method.uses_other_views(), &mut again)?);
    }
    let crop = crops::corner_in_capture(&capture.mosaic, target);
    scored.pictures = crops::save_crops(out, &run.key(), &image, None, crop)?;
    scored.hashes = real.hashes(&settings.calibrated_by);
    Ok(scored)
}

/// Names all of a chain's steps up to the samples.
fn steps_to_samples(chain: &Chain) -> Result<String> {
    let same = Chain { method: Method::Barycentric, training: None, ..chain.clone() };
    Ok(serde_json::to_string(&same)?)
}

fn decode_options(chain: &Chain) -> decode::Options {
    decode::Options {
        views: chain.views,
        rotate_raw: chain.rotate_raw,
        steps: chain.steps(),
        ..decode::Options::default()
    }
}

/// The dictionary of the run: trained for it, or one of the settings where its method needs one.
fn dictionary_of(
    chain: &Chain,
    seed: u64,
    settings: &Settings,
    simulated: &mut SimulatedCaptures,
    scored: &mut Scored,
    observer: &dyn Observer,
) -> Result<Option<Dictionary>> {
    let Some(training) = &chain.training else {
        let used = settings.dictionaries.of(chain.method);
        scored.hashes.extend(used.map(|d| ("dictionary".to_owned(), d.sha256.clone())));
        return Ok(used.map(|d| d.dictionary.clone()));
    };
    let trained = dictionaries::train_once(training, seed, settings, simulated.trained(), observer)?;
    scored.scores.insert("train_seconds".into(), trained.seconds);
    let bytes = lenslet_core::dictionary::to_bytes(&trained.dictionary)?;
    scored.hashes = BTreeMap::from([("dictionary".to_owned(), sha256_hex(&bytes))]);
    Ok(Some(trained.dictionary.clone()))
}
