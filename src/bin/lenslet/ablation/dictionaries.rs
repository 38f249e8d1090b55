//! Dictionaries trained for a run, each once.

use std::collections::HashMap;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context as _, Result};
use lenslet::image_io::Picture;
use lenslet_core::dictionary::{Dictionary, Footprint};
use lenslet_core::lightfield::{ColourSpace, colour};
use lenslet_core::progress::Observer;
use lenslet_data_gen::simulate::{self, Camera, Scene, SceneName};
use lenslet_train::{
    AnchorParameters, Coupling, DegradationParameters, DictionaryParameters, PairParameters, Parameters,
    RefinementParameters,
};

use super::chain::Training;
use super::settings::Settings;

/// Simulated pictures to train on where there are no photos.
/// Source: chosen.
const PICTURES: u64 = 6;
/// The first of their seeds; runs have other ones.
const FIRST_SEED: u64 = 9000;

/// A dictionary and the seconds its training took.
pub(super) struct Trained {
    pub(super) dictionary: Dictionary,
    pub(super) seconds: f64,
}

/// Dictionaries by training and seed.
#[derive(Default)]
pub(super) struct TrainedDictionaries {
    by_name: HashMap<String, Trained>,
    /// The pictures trained on, and the folder that holds simulated ones.
    pictures: Option<(Vec<PathBuf>, Option<tempfile::TempDir>)>,
}

/// The dictionary of a training under a seed.
pub(super) fn train_once<'a>(
    training: &Training,
    seed: u64,
    settings: &Settings,
    store: &'a mut TrainedDictionaries,
    observer: &dyn Observer,
) -> Result<&'a Trained> {
    let name = format!("{seed} {}", serde_json::to_string(training)?);
    if !store.by_name.contains_key(&name) {
        if store.pictures.is_none() {
            store.pictures = Some(if settings.photos.is_empty() {
                let (paths, folder) = simulate_pictures(observer)?;
                (paths, Some(folder))
            } else {
                (settings.photos.clone(), None)
            });
        }
        let (pictures, simulated) =
            store.pictures.as_ref().map(|(p, f)| (p.as_slice(), f.is_some())).unwrap_or_default();
        let mut parameters = parameters(training, seed, settings.quick);
        if simulated {
            // Simulated pictures are as sharp as their truth; photos are shrunk to be so.
            parameters.pairs.shrink = 1.0;
        }
        let begun = Instant::now();
        let outcome = lenslet_train::train_dictionary(pictures, &parameters, None, false, observer, &mut |_| {})?;
        let seconds = begun.elapsed().as_secs_f64();
        store.by_name.insert(name.clone(), Trained { dictionary: outcome.dictionary, seconds });
    }
    store.by_name.get(&name).context("the dictionary was just trained")
}

fn parameters(training: &Training, seed: u64, quick: bool) -> Parameters {
    let epochs = if quick { 1 } else { 3 };
    Parameters {
        dictionary: DictionaryParameters {
            atoms: training.atoms,
            patch: training.patch,
            lambda: training.lambda,
            features: training.features,
            algorithm: training.algorithm,
            coupling: if training.joint { Coupling::Joint } else { Coupling::Low },
            epochs,
            ..DictionaryParameters::default()
        },
        refinement: RefinementParameters { epochs, ..RefinementParameters::default() },
        pairs: PairParameters { count: training.pairs, held_out: 0, ..PairParameters::default() },
        degradation: DegradationParameters { footprints: vec![Footprint::Point], ..DegradationParameters::default() },
        anchors: AnchorParameters { count: 0, ..AnchorParameters::default() },
        seed,
        ..Parameters::default()
    }
}

/// Pictures of simulated scenes that no run is scored on.
fn simulate_pictures(observer: &dyn Observer) -> Result<(Vec<PathBuf>, tempfile::TempDir)> {
    let folder = tempfile::tempdir()?;
    let camera = Camera::with_sensor(1640);
    let size = simulate::output_size(&camera, 540);
    let mut paths = Vec::new();
    for k in 0..PICTURES {
        let kind = if k % 2 == 0 { SceneName::Flat } else { SceneName::Natural };
        let scene = Scene::named(kind, &camera, None, FIRST_SEED + k, observer)?;
        let mut view = simulate::true_view(&scene, &camera, [0.0; 2], size);
        colour::convert(&mut view, ColourSpace::Linear, ColourSpace::Srgb);
        let rgb = view.iter().map(|x| (x.clamp(0.0, 1.0) * 255.0).round() as u8).collect();
        let picture = Picture { width: size.0, height: size.1, rgb };
        let path = folder.path().join(format!("{k}.png"));
        std::fs::write(&path, picture.to_png()?)?;
        paths.push(path);
    }
    Ok((paths, folder))
}
