//! The run matrix: which chains of steps are compared on which scenes (paper section 5, figures 8 to 11, and further
//! ones).

use std::path::PathBuf;

use anyhow::{Result, bail};
use lenslet_core::calibration::CalibrationVariant;
use lenslet_core::decode::Demosaic;
use lenslet_core::dictionary::PatchPredictor;
use lenslet_core::digest::sha256_hex;
use lenslet_data_gen::simulate::SceneName;
use lenslet_train::Algorithm;
use serde::Serialize;

use super::chain::{Chain, Training};
use super::experiment::Experiment;
use super::method::Method;
use super::paper;
use super::settings::{CalibratedBy, Settings};
use super::simulated_scene::SimulatedScene;

/// What is scored.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Subject {
    /// A simulated scene with its truth.
    Scene(SimulatedScene),
    /// A real capture, measured without a ground truth.
    Capture(PathBuf),
    /// Another tool's light field on the truth given with it.
    Peer(String, PathBuf),
}

impl Subject {
    /// Name in tables. Of files only the name is shown, never where they lie; all peers share the truth they are scored
    /// on.
    pub fn name(&self) -> String {
        match self {
            Subject::Scene(kind) => kind.name().to_owned(),
            Subject::Capture(path) => path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
            Subject::Peer(..) => "the truth given".to_owned(),
        }
    }
}

/// One run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Run {
    /// Which experiment it belongs to.
    pub experiment: Experiment,
    /// Which row of its table.
    pub variant: String,
    /// The chain of steps.
    pub chain: Chain,
    /// What is scored.
    pub subject: Subject,
    /// Seed of camera, scene and noise.
    pub seed: u64,
    /// Side of the simulated sensor.
    pub sensor: usize,
    /// SHA-256 of the dictionary, where a method uses one that was not trained for the run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dictionary: Option<String>,
    /// What the camera of a real capture is calibrated by.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibrated_by: Option<String>,
}

impl Run {
    /// Identifies the run among all others of this version of the program.
    pub fn key(&self) -> String {
        let text = serde_json::to_string(self).unwrap_or_default();
        let mut digest = sha256_hex(format!("{} {text}", env!("CARGO_PKG_VERSION")).as_bytes());
        digest.truncate(24);
        digest
    }

    /// A description for progress and messages.
    pub fn title(&self) -> String {
        format!("{}: {}, {}, seed {}", self.experiment.name(), self.variant, self.subject.name(), self.seed)
    }
}

/// All runs of the settings, experiment by experiment, variant by variant.
///
/// # Errors
/// Peers without a truth.
pub fn plan(settings: &Settings) -> Result<Vec<Run>> {
    let mut runs = Vec::new();
    for experiment in Experiment::ALL {
        if !settings.experiments.is_empty() && !settings.experiments.contains(&experiment) {
            continue;
        }
        if experiment == Experiment::Peers {
            if !settings.peers.is_empty() && settings.truth.is_none() {
                bail!("peers are scored on a truth: name its light field with --truth");
            }
            for (name, path) in &settings.peers {
                let subject = Subject::Peer(name.clone(), path.clone());
                runs.push(run_of(settings, experiment, name, &Chain::default(), subject, 1));
            }
            continue;
        }
        let scenes = scenes(experiment, settings.quick);
        for (variant, chain) in variants(experiment, settings.quick) {
            // A dictionary given may lack one of the predictors.
            if chain.training.is_none() && !settings.dictionaries.can(chain.method) {
                continue;
            }
            for &scene in &scenes {
                for seed in settings.seeds() {
                    runs.push(run_of(settings, experiment, &variant, &chain, Subject::Scene(scene), seed));
                }
            }
            if can_use_real_captures(experiment, &settings.calibrated_by) {
                for capture in &settings.captures {
                    // Nothing is drawn: one seed.
                    let subject = Subject::Capture(capture.clone());
                    runs.push(run_of(settings, experiment, &variant, &chain, subject, 1));
                }
            }
        }
    }
    Ok(runs)
}

fn run_of(
    settings: &Settings,
    experiment: Experiment,
    variant: &str,
    chain: &Chain,
    subject: Subject,
    seed: u64,
) -> Run {
    let trained = chain.training.is_some();
    let dictionary = if trained { None } else { settings.dictionaries.of(chain.method).map(|d| d.sha256.clone()) };
    let (variant, chain) = (variant.to_owned(), chain.clone());
    let calibrated_by = if matches!(subject, Subject::Capture(_)) { settings.calibrated_by.name() } else { None };
    Run { experiment, variant, chain, subject, seed, sensor: settings.sensor(), dictionary, calibrated_by }
}

/// Experiments that real captures can answer. Dictionary runs would train for hours; a calibration that exists has no
/// variants.
fn can_use_real_captures(experiment: Experiment, calibrated_by: &CalibratedBy) -> bool {
    match experiment {
        Experiment::Calibration | Experiment::Subpixel => calibrated_by.has_variants(),
        Experiment::Resampling => *calibrated_by != CalibratedBy::Nothing,
        _ => false,
    }
}

fn scenes(experiment: Experiment, quick: bool) -> Vec<SimulatedScene> {
    let drawn: &[SceneName] = match (experiment, quick) {
        (Experiment::Resampling, false) => {
            &[SceneName::Natural, SceneName::Planes, SceneName::Slanted, SceneName::Occluders, SceneName::Chart]
        }
        (Experiment::Calibration | Experiment::Subpixel | Experiment::Resampling, _) => {
            &[SceneName::Natural, SceneName::Chart]
        }
        (Experiment::Views | Experiment::Paper, _) | (_, true) => &[SceneName::Natural],
        (_, false) => &[SceneName::Natural, SceneName::Chart],
    };
    let photos = matches!(experiment, Experiment::Resampling | Experiment::Dictionary);
    drawn.iter().copied().map(SimulatedScene::Drawn).chain(photos.then_some(SimulatedScene::Photos)).collect()
}

/// The rows of an experiment.
fn variants(experiment: Experiment, quick: bool) -> Vec<(String, Chain)> {
    let base = Chain::default;
    let named = |name: &str, chain: Chain| (name.to_owned(), chain);
    let centres = |v: CalibrationVariant| Chain { calibration: v, ..base() };
    match experiment {
        Experiment::Calibration => vec![
            named("none", centres(CalibrationVariant::None)),
            named("rotation only", centres(CalibrationVariant::RotationOnly)),
            named("full", centres(CalibrationVariant::Full)),
        ],
        Experiment::Subpixel => vec![
            named("whole pixels", centres(CalibrationVariant::Integer)),
            named("paraboloids", centres(CalibrationVariant::Paper)),
            named("lattice and residual", centres(CalibrationVariant::Full)),
        ],
        Experiment::Resampling => {
            let methods = Method::all().filter(|m| !(quick && m.is_slow()));
            methods.map(|method| named(&method.name(), Chain { method, ..base() })).collect()
        }
        Experiment::Paper => paper::as_printed(),
        Experiment::Dictionary => dictionary_variants(quick),
        Experiment::Noise => {
            let levels: &[f64] = if quick { &[0.0, 3.0] } else { &[0.0, 0.7, 1.5, 3.0, 6.0] };
            let lasso = Method::Learned(PatchPredictor::Lasso);
            let methods = if quick {
                vec![Method::Barycentric, lasso]
            } else {
                vec![Method::Barycentric, Method::Cubic, Method::Multiview, lasso]
            };
            methods
                .into_iter()
                .flat_map(|method| levels.iter().map(move |&noise| (method, noise)))
                .map(|(method, noise)| {
                    named(&format!("{}, noise {noise}", method.name()), Chain { method, noise, ..base() })
                })
                .collect()
        }
        Experiment::Demosaic => [Demosaic::Bilinear, Demosaic::Malvar, Demosaic::CoKriging]
            .map(|demosaic| named(demosaic.name(), Chain { demosaic, ..base() }))
            .to_vec(),
        Experiment::Vignetting => [("off", false), ("on", true)]
            .map(|(name, vignetting)| named(name, Chain { vignetting, ..base() }))
            .to_vec(),
        Experiment::Views => {
            let counts: &[usize] = if quick { &[3, 7] } else { &[3, 5, 7, 9] };
            let method = Method::Multiview;
            counts.iter().map(|&views| named(&format!("{views}x{views}"), Chain { views, method, ..base() })).collect()
        }
        Experiment::Peers => Vec::new(),
    }
}

/// One parameter of the dictionary after another, around a middle.
fn dictionary_variants(quick: bool) -> Vec<(String, Chain)> {
    let middle = Training {
        atoms: if quick { 128 } else { 256 },
        patch: 9,
        lambda: 0.1,
        features: 40,
        pairs: if quick { 8_000 } else { 50_000 },
        algorithm: Algorithm::Online,
        joint: true,
    };
    let m = || middle.clone();
    let mut rows: Vec<(String, Training)> = vec![("middle".to_owned(), m())];
    let atoms: &[usize] = if quick { &[16] } else { &[64, 1024] };
    rows.extend(atoms.iter().map(|&atoms| (format!("{atoms} atoms"), Training { atoms, ..m() })));
    if !quick {
        rows.extend([5, 7].map(|patch| (format!("patches of {patch}"), Training { patch, ..m() })));
        rows.extend([0.03, 0.3].map(|lambda| (format!("λ {lambda}"), Training { lambda, ..m() })));
        rows.extend([10, 80].map(|features| (format!("{features} features"), Training { features, ..m() })));
        rows.extend([5_000, 200_000].map(|pairs| (format!("{pairs} pairs"), Training { pairs, ..m() })));
        rows.push(("ksvd".to_owned(), Training { algorithm: Algorithm::Ksvd, ..m() }));
        // Some thirty times as slow as the others: to be compared with their 5000 pairs.
        rows.push(("ista, 5000 pairs".to_owned(), Training { algorithm: Algorithm::Ista, pairs: 5_000, ..m() }));
    }
    rows.push(("low part first".to_owned(), Training { joint: false, ..m() }));
    rows.into_iter()
        .map(|(name, t)| {
            (name, Chain { method: Method::Learned(PatchPredictor::Lasso), training: Some(t), ..Chain::default() })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use lenslet_data_gen::simulate::SceneUse;

    use super::*;

    #[test]
    fn keys_of_runs_are_unique_and_stable() {
        for quick in [false, true] {
            let settings = Settings { quick, ..Settings::default() };
            let runs = plan(&settings).unwrap();
            let mut keys: Vec<String> = runs.iter().map(Run::key).collect();
            assert_eq!(keys, plan(&settings).unwrap().iter().map(Run::key).collect::<Vec<_>>());
            keys.sort();
            keys.dedup();
            assert_eq!(keys.len(), runs.len());
            // All experiments but the one that needs files.
            let experiments: std::collections::HashSet<_> = runs.iter().map(|r| r.experiment).collect();
            assert_eq!(experiments.len(), 9);
        }
    }

    #[test]
    fn nothing_is_scored_on_a_scene_for_training() {
        for quick in [false, true] {
            for run in plan(&Settings { quick, ..Settings::default() }).unwrap() {
                let Subject::Scene(SimulatedScene::Drawn(scene)) = run.subject else { continue };
                assert_eq!(scene.scene_use(), SceneUse::Scoring, "{}", run.title());
            }
        }
    }

    #[test]
    fn captures_and_peers_join_when_given() {
        let mut settings = Settings { quick: true, ..Settings::default() };
        let before = plan(&settings).unwrap().len();
        settings.captures = vec!["a.jpg".into()];
        let planned = |calibrated_by| {
            let settings = Settings { calibrated_by, ..settings.clone() };
            plan(&settings).unwrap().len()
        };
        let whites = planned(CalibratedBy::Whites(vec!["w.png".into()]));
        let file = planned(CalibratedBy::File("c.calib".into()));
        assert!(whites > file && file > before && planned(CalibratedBy::Nothing) == before);
        settings.peers = vec![("other".into(), "lf".into())];
        assert!(plan(&settings).unwrap_err().to_string().contains("--truth"));
        settings.truth = Some("truth".into());
        assert!(plan(&settings).unwrap().iter().any(|r| r.experiment == Experiment::Peers));
    }
}
