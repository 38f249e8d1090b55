//! `--check` on spoiled dictionaries: each makes an ordering fail that the shipped ones keep.

use std::collections::BTreeMap;

use lenslet_core::dictionary::{Dictionary, PatchPredictor};
use lenslet_core::interpolation::Interpolation;
use lenslet_core::progress::Silent;
use lenslet_data_gen::simulate::SceneName;
use lenslet_views::reconstruct::embedded_dictionary_for;

use super::matrix::Subject;
use super::method::Method;
use super::orderings::{broken_orderings, judge_orderings};
use super::run_one::{Caches, run_one};
use super::simulated_scene::SimulatedScene;
use super::{Experiment, Record, Settings, UsedDictionaries, plan};
use spoil::SPOILINGS;

#[path = "../../../../tests/spoil/mod.rs"]
mod spoil;

/// Settings of one scene's methods with these dictionaries (none: those inside the program).
fn settings(scene: SimulatedScene, dictionaries: Vec<Dictionary>) -> Settings {
    Settings {
        experiments: vec![Experiment::Resampling],
        quick: true,
        // What anchors give on refined views of photographs differs much from one capture to another.
        seeds: if scene == SimulatedScene::Photos { 2 } else { 1 },
        dictionaries: UsedDictionaries::new(dictionaries).unwrap(),
        ..Settings::default()
    }
}

/// Views that spoilings start from are made once for each scene and seed.
type CachesByCapture = BTreeMap<(&'static str, u64), Caches>;

/// Records of the methods that `concerns` picks, on captures of one scene.
fn records(
    settings: &Settings,
    scene: SimulatedScene,
    concerns: impl Fn(Method) -> bool,
    caches: &mut CachesByCapture,
) -> Vec<Record> {
    let out = tempfile::tempdir().unwrap();
    let runs = plan(settings).unwrap().into_iter();
    let records: Vec<Record> = runs
        .filter(|run| run.subject == Subject::Scene(scene) && concerns(run.chain.method))
        .map(|run| {
            let caches = caches.entry((scene.name(), run.seed)).or_insert_with(|| Caches::new(settings));
            let scored = run_one(&run, settings, caches, out.path(), &Silent);
            Record::new(&run, scored, 0.0, settings)
        })
        .collect();
    assert!(!records.is_empty() && records.iter().all(|r| r.failed.is_none()), "{records:?}");
    records
}

#[test]
fn no_spoiled_dictionary_passes_the_check() {
    let shipped =
        [Interpolation::Barycentric, Interpolation::Multiview].map(|base| embedded_dictionary_for(base).unwrap());
    let mut caches = CachesByCapture::new();
    let drawn = SimulatedScene::Drawn(SceneName::Natural);
    let of_shipped = [drawn, SimulatedScene::Photos]
        .map(|scene| records(&settings(scene, Vec::new()), scene, |_| true, &mut caches));
    for records in &of_shipped {
        assert_eq!(broken_orderings(&judge_orderings(records), records), [""; 0]);
    }
    for spoiling in &SPOILINGS {
        for (dictionary, on) in shipped.iter().zip(["", " on multiview"]) {
            let Some(spoiled) = spoiling.of(dictionary) else { continue };
            // Codes and one linear filter are worth nothing on the refined views of this scene: without them nothing is
            // lost (tests/spoiled_dictionaries.rs has one where codes are).
            if matches!(spoiling.predictor, PatchPredictor::Lasso | PatchPredictor::Ridge) && !on.is_empty() {
                continue;
            }
            // The other methods give what they gave.
            let concerns = |method: Method| {
                method.predictor() == Some(spoiling.predictor) && method.uses_other_views() != on.is_empty()
            };
            let mut all = records(&settings(drawn, vec![spoiled]), drawn, concerns, &mut caches);
            let renewed: Vec<_> = all.iter().map(|r| (r.variant.clone(), r.seed)).collect();
            let same = |r: &&Record| !renewed.contains(&(r.variant.clone(), r.seed));
            all.extend(of_shipped[0].iter().filter(same).cloned());
            let broken = broken_orderings(&judge_orderings(&all), &all);
            let named = format!("resampling: {}{on} is not over", spoiling.predictor);
            assert!(broken.iter().any(|b| b.starts_with(&named)), "{}{on}: {broken:?}", spoiling.name);
        }
    }
}
