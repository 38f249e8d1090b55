//! A run from its capture to its scores: calibrate, decode, render as the chain says, compare.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use lenslet_core::calibration::{self, Variant};
use lenslet_core::container::{self, Capture};
use lenslet_core::decode::{self, HexSamples};
use lenslet_core::dictionary::{Base, Dictionary, Footprint};
use lenslet_core::lightfield::{ColourSpace, colour};
use lenslet_core::progress::Observer;
use lenslet_data_gen::simulate::Kind;
use ndarray::{Array3, Axis};
use sha2::{Digest, Sha256};

use super::matrix::{Chain, Experiment, Run, Way};
use super::record::Scored;
use super::world::Worlds;
use super::{Settings, dictionaries, picture, scores};
use crate::infer;
use crate::resample::{Target, barycentric, bicubic, cubic, multiview};

/// Share of lenslets hidden on real captures.
const HIDDEN: f64 = 0.1;

/// A simulated scene, scored against its truth.
pub(super) fn simulated(
    run: &Run,
    kind: Kind,
    settings: &Settings,
    worlds: &mut Worlds,
    out: &Path,
    observer: &dyn Observer,
) -> Result<Scored> {
    let chain = &run.chain;
    let mut scored = Scored::default();
    let dictionary = dictionary(chain, run.seed, settings, worlds, &mut scored, observer)?;
    let world = worlds.get(kind, run.seed, chain.noise, observer)?;
    let variant: Variant = chain.calibration.parse().map_err(anyhow::Error::msg)?;
    let calibration = world.calibration(variant, observer)?.clone();
    let samples = decode::samples(&world.simulation.capture, &calibration, &options(chain)?, observer)?;
    let target = Target { width: world.size.0, height: world.size.1 };

    // The middle view, one at the rim of the micro-images, and the corner, where little light is left.
    let (n, middle) = (chain.views, chain.views / 2);
    let wanted = [(middle, middle), (middle, n - 1), (0, 0)];
    let begun = Instant::now();
    let images = render(&samples, &target, chain.way, &wanted, dictionary.as_ref(), observer)?;
    scored.step_seconds = begun.elapsed().as_secs_f64();

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
        scored.pictures = picture::save(out, &run.key(), &images[0], &truths[0], crop)?;
    }
    Ok(scored)
}

/// A real capture, scored on hidden lenslets.
pub(super) fn captured(run: &Run, path: &Path, settings: &Settings, observer: &dyn Observer) -> Result<Scored> {
    let chain = &run.chain;
    let mut scored = Scored::default();
    let capture = open(path)?;
    let whites: Vec<Capture> = settings.whites.iter().map(|w| open(w)).collect::<Result<_>>()?;
    for (file, source) in
        std::iter::once((path, &capture)).chain(settings.whites.iter().map(PathBuf::as_path).zip(&whites))
    {
        let name = file.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        scored.hashes.insert(name, source.source_sha256.clone());
    }
    let variant: Variant = chain.calibration.parse().map_err(anyhow::Error::msg)?;
    let options_ = calibration::Options { variant, ..calibration::Options::default() };
    let calibration = calibration::calibrate(&whites, &options_, observer)?;
    let samples = decode::samples(&capture, &calibration, &options(chain)?, observer)?;
    let target = Target::longer(samples.sensor, 1080);
    let middle = chain.views / 2;
    let dictionary = needs_dictionary(chain.way).then(embedded).transpose()?;
    let begun = Instant::now();
    let score = multiview::hidden_score(&samples, &target, HIDDEN, run.seed, (middle, middle), &mut |rest| {
        let mut images = render(rest, &target, chain.way, &[(middle, middle)], dictionary.as_ref(), observer)?;
        images.pop().context("no view was rendered")
    })?;
    scored.step_seconds = begun.elapsed().as_secs_f64();
    scored.scores.insert("hidden_psnr".into(), score.psnr);
    Ok(scored)
}

fn open(path: &Path) -> Result<Capture> {
    // A bare mosaic does not name its camera; the F01 is the one most have.
    container::open(path, None).or_else(|_| container::open(path, Some("lytro-f01"))).map_err(Into::into)
}

fn options(chain: &Chain) -> Result<decode::Options> {
    Ok(decode::Options { views: chain.views, steps: chain.steps()?, ..decode::Options::default() })
}

fn needs_dictionary(way: Way) -> bool {
    matches!(way, Way::Learned | Way::LearnedMultiview)
}

fn embedded() -> Result<Dictionary> {
    infer::embedded().context("the embedded dictionary")
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
        return needs_dictionary(chain.way).then(embedded).transpose();
    };
    let trained = dictionaries::trained(training, seed, settings, worlds.trained(), observer)?;
    scored.scores.insert("train_seconds".into(), trained.seconds);
    let bytes = lenslet_core::dictionary::to_bytes(&trained.dictionary)?;
    let digest: String = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
    scored.hashes = BTreeMap::from([("dictionary".to_owned(), digest)]);
    Ok(Some(trained.dictionary.clone()))
}

/// Renders the wanted views, linear light.
fn render(
    samples: &HexSamples,
    target: &Target,
    way: Way,
    wanted: &[(usize, usize)],
    dictionary: Option<&Dictionary>,
    observer: &dyn Observer,
) -> Result<Vec<Array3<f32>>> {
    let values = |&(v, u): &(usize, usize)| samples.values.index_axis(Axis(0), v * samples.views + u);
    match way {
        Way::Bicubic => {
            let prepared = bicubic::prepare(samples, target)?;
            wanted.iter().map(|at| bicubic::view(&prepared, values(at))).collect()
        }
        Way::Barycentric => {
            let prepared = barycentric::prepare(samples, target)?;
            wanted.iter().map(|at| barycentric::view(&prepared, values(at))).collect()
        }
        Way::Cubic => {
            let prepared = cubic::prepare(samples, target)?;
            wanted.iter().map(|at| cubic::view(&prepared, values(at))).collect()
        }
        Way::Multiview => {
            let options = multiview::Options { views: Some(wanted.to_vec()), ..multiview::Options::default() };
            let mut images = vec![None; wanted.len()];
            let mut sink = |v: usize, u: usize, image: &Array3<f32>| {
                for (slot, _) in images.iter_mut().zip(wanted).filter(|(_, at)| **at == (v, u)) {
                    *slot = Some(image.clone());
                }
                Ok(())
            };
            multiview::render(samples, target, &options, &mut sink, observer)?;
            images.into_iter().map(|image| image.context("a view was not rendered")).collect()
        }
        Way::Learned | Way::LearnedMultiview => {
            let dictionary = dictionary.context("a learned way needs a dictionary")?;
            // The truth is what a lenslet sees, so a sample is the truth at a point.
            let options = infer::Options { footprint: Footprint::Point, ..infer::Options::default() };
            let reconstructor = infer::Reconstructor::new(dictionary, &options)?;
            let base = match (way, reconstructor.model().base) {
                (Way::LearnedMultiview, _) => Way::Multiview,
                (_, Base::Barycentric) => Way::Barycentric,
                (_, Base::Cubic) => Way::Cubic,
                (_, Base::Bicubic) => Way::Bicubic,
                (_, Base::Multiview) => Way::Multiview,
            };
            let low = render(samples, target, base, wanted, None, observer)?;
            low.into_iter()
                .map(|mut view| {
                    ensure!(!observer.cancelled(), super::Interrupted);
                    colour::convert(&mut view, ColourSpace::Linear, ColourSpace::Srgb);
                    view.mapv_inplace(|x| x.clamp(0.0, 1.0));
                    let mut sharp = reconstructor.view(&view)?;
                    colour::convert(&mut sharp, ColourSpace::Srgb, ColourSpace::Linear);
                    Ok(sharp)
                })
                .collect()
        }
    }
}
