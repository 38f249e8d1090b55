//! `--check` on spoiled dictionaries: each makes an ordering fail that the shipped ones keep.

use lenslet_core::dictionary::{Dictionary, PatchPredictor};
use lenslet_core::interpolation::Interpolation;
use lenslet_core::progress::Silent;
use lenslet_data_gen::simulate::SceneName;
use lenslet_views::reconstruct::embedded_dictionary_for;

use super::matrix::Subject;
use super::orderings::{broken_orderings, judge_orderings};
use super::run_one::{Caches, run_one};
use super::simulated_scene::SimulatedScene;
use super::{Experiment, Record, Settings, UsedDictionaries, plan};
use spoil::SPOILINGS;

#[path = "../../../../tests/spoil/mod.rs"]
mod spoil;

/// The orderings that must hold and do not with these dictionaries, on one capture of one scene.
fn broken_with(dictionaries: Vec<Dictionary>, scene: SimulatedScene, caches: &mut Caches) -> Vec<String> {
    let settings = Settings {
        experiments: vec![Experiment::Resampling],
        quick: true,
        // What anchors give on refined views of photographs differs much from one capture to another.
        seeds: if scene == SimulatedScene::Photos { 2 } else { 1 },
        dictionaries: UsedDictionaries::new(dictionaries).unwrap(),
        ..Settings::default()
    };
    let out = tempfile::tempdir().unwrap();
    let runs = plan(&settings).unwrap().into_iter().filter(|run| run.subject == Subject::Scene(scene));
    let records: Vec<Record> = runs
        .map(|run| {
            let scored = run_one(&run, &settings, caches, out.path(), &Silent);
            Record::new(&run, scored, 0.0, &settings)
        })
        .collect();
    assert!(records.iter().all(|r| r.failed.is_none()), "{records:?}");
    broken_orderings(&judge_orderings(&records), &records)
}

#[test]
fn no_spoiled_dictionary_passes_the_check() {
    let shipped =
        [Interpolation::Barycentric, Interpolation::Multiview].map(|base| embedded_dictionary_for(base).unwrap());
    let mut caches = Caches::new(&Settings { quick: true, ..Settings::default() });
    // On refined views codes are worth something on photographs alone.
    let scenes = [SimulatedScene::Drawn(SceneName::Natural), SimulatedScene::Photos];
    for scene in scenes {
        assert_eq!(broken_with(Vec::new(), scene, &mut caches), [""; 0]);
    }
    for spoiling in &SPOILINGS {
        for ((dictionary, on), scene) in shipped.iter().zip(["", " on multiview"]).zip(scenes) {
            let Some(spoiled) = spoiling.of(dictionary) else { continue };
            // One linear filter is worth nothing on refined views: without it nothing is lost.
            if spoiling.predictor == PatchPredictor::Ridge && !on.is_empty() {
                continue;
            }
            let broken = broken_with(vec![spoiled], scene, &mut caches);
            let named = format!("resampling: {}{on} is not over", spoiling.predictor);
            assert!(broken.iter().any(|b| b.starts_with(&named)), "{}{on}: {broken:?}", spoiling.name);
        }
    }
}
