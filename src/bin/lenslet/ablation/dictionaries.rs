//! Dictionaries trained for a run, each once.

use std::collections::HashMap;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context as _, Result};
use lenslet_core::dictionary::Dictionary;
use lenslet_core::progress::Observer;
use lenslet_train::{
    AnchorParameters, Coupling, DegradationParameters, DictionaryParameters, PairParameters, Parameters,
    RefinementParameters,
};

use super::chain::Training;
use super::photos::{TRAINING, write_photos};
use super::render::FOOTPRINT;
use super::settings::Settings;

/// A dictionary and the seconds its training took.
pub(super) struct Trained {
    pub(super) dictionary: Dictionary,
    pub(super) seconds: f64,
}

/// Dictionaries by training and seed.
#[derive(Default)]
pub(super) struct TrainedDictionaries {
    by_name: HashMap<String, Trained>,
    /// The photos trained on, and the folder that holds those of the program.
    photos: Option<(Vec<PathBuf>, Option<tempfile::TempDir>)>,
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
        if store.photos.is_none() {
            store.photos = Some(if settings.photos.is_empty() {
                let (paths, folder) = write_photos(&TRAINING)?;
                (paths, Some(folder))
            } else {
                (settings.photos.clone(), None)
            });
        }
        let (photos, own) = store.photos.as_ref().map(|(p, f)| (p.as_slice(), f.is_some())).unwrap_or_default();
        let mut parameters = parameters(training, seed, settings.quick);
        if own {
            // Those of the program were shrunk before.
            parameters.pairs.shrink = 1.0;
        }
        let begun = Instant::now();
        let outcome = lenslet_train::train_dictionary(photos, &parameters, None, false, observer, &mut |_| {})?;
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
        degradation: DegradationParameters { footprints: vec![FOOTPRINT], ..DegradationParameters::default() },
        anchors: AnchorParameters { count: 0, ..AnchorParameters::default() },
        seed,
        ..Parameters::default()
    }
}
