//! The run matrix: which chains of steps are compared on which scenes (paper section 5, figures 8 to 11, and what goes past it).

use std::path::PathBuf;
use std::str::FromStr;

use anyhow::{Result, bail};
use lenslet_core::calibration::CalibrationVariant;
use lenslet_core::decode::{Demosaic, Step, default_steps};
use lenslet_core::interpolation::Interpolation;
use lenslet_data_gen::simulate::Kind;
use serde::Serialize;
use sha2::{Digest, Sha256};

use super::Settings;

/// One of the experiments.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Experiment {
    /// Without calibration, rotation only, full (figure 8).
    Calibration,
    /// Whole pixels, paraboloids, lattice and residual (figure 9).
    Subpixel,
    /// The paper's four methods and ours (figures 10, 11).
    Resampling,
    /// What of the dictionary matters.
    Dictionary,
    /// Captures of rising noise.
    Noise,
    /// How three colours come from one.
    Demosaic,
    /// With and without division by the white image.
    Vignetting,
    /// How many views refine each other.
    Views,
    /// Light fields of other tools on the same truth.
    Peers,
}

impl Experiment {
    /// All, in the order of the report.
    pub const ALL: [Experiment; 9] = [
        Experiment::Calibration,
        Experiment::Subpixel,
        Experiment::Resampling,
        Experiment::Dictionary,
        Experiment::Noise,
        Experiment::Demosaic,
        Experiment::Vignetting,
        Experiment::Views,
        Experiment::Peers,
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Experiment::Calibration => "calibration",
            Experiment::Subpixel => "subpixel",
            Experiment::Resampling => "resampling",
            Experiment::Dictionary => "dictionary",
            Experiment::Noise => "noise",
            Experiment::Demosaic => "demosaic",
            Experiment::Vignetting => "vignetting",
            Experiment::Views => "views",
            Experiment::Peers => "peers",
        }
    }

    /// What it asks, in a sentence.
    pub fn question(self) -> &'static str {
        match self {
            Experiment::Calibration => "What does calibration give? (figure 8 of the paper)",
            Experiment::Subpixel => "What do sub-pixel lenslet centres give? (figure 9)",
            Experiment::Resampling => "What do the ways from samples to views give? (figures 10 and 11)",
            Experiment::Dictionary => "Which parameters of the dictionary matter, and what do they cost?",
            Experiment::Noise => "How do the methods take noise?",
            Experiment::Demosaic => "What does the kind of demosaic change, in the middle view and the outer ones?",
            Experiment::Vignetting => "What does division by the white image change?",
            Experiment::Views => "How many views should refine each other?",
            Experiment::Peers => "What do light fields decoded by other tools score on the same truth?",
        }
    }
}

impl FromStr for Experiment {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Experiment::ALL.into_iter().find(|e| e.name() == text).ok_or_else(|| {
            let names: Vec<_> = Experiment::ALL.iter().map(|e| e.name()).collect();
            format!("no experiment is named {text:?}; there are {}", names.join(", "))
        })
    }
}

/// The last step: from samples to views.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Way {
    /// Section 4.1.
    Bicubic,
    /// Section 4.2.
    Barycentric,
    /// The smooth surface.
    Cubic,
    /// Section 4.3.
    Multiview,
    /// Section 4.4 on the interpolation the dictionary was trained for.
    Learned,
    /// Section 4.4 on top of section 4.3.
    LearnedMultiview,
}

impl From<Interpolation> for Way {
    fn from(interpolation: Interpolation) -> Way {
        match interpolation {
            Interpolation::Bicubic => Way::Bicubic,
            Interpolation::Barycentric => Way::Barycentric,
            Interpolation::Cubic => Way::Cubic,
            Interpolation::Multiview => Way::Multiview,
        }
    }
}

impl Way {
    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Way::Bicubic => "bicubic",
            Way::Barycentric => "barycentric",
            Way::Cubic => "cubic",
            Way::Multiview => "multiview",
            Way::Learned => "learned",
            Way::LearnedMultiview => "learned on multiview",
        }
    }

    /// The interpolation that it is; none where it stands on another's views.
    pub fn interpolation(self) -> Option<Interpolation> {
        Interpolation::ALL.into_iter().find(|&interpolation| Way::from(interpolation) == self)
    }

    const ALL: [Way; 6] =
        [Way::Bicubic, Way::Barycentric, Way::Cubic, Way::Multiview, Way::Learned, Way::LearnedMultiview];
}

/// A dictionary trained for the run; what is not named is as the trainer has it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Training {
    /// Atoms K.
    pub atoms: usize,
    /// Side of a patch.
    pub patch: usize,
    /// λ.
    pub lambda: f32,
    /// Principal components kept.
    pub features: usize,
    /// Training pairs.
    pub pairs: usize,
    /// Trainer: `online`, `ksvd`, `ista`.
    pub algorithm: String,
    /// Low and high part together (eq. (3)) or one after the other.
    pub joint: bool,
}

/// A chain of steps from a capture to views. Everything that is compared is a value of one of these.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Chain {
    /// Which centres.
    pub calibration: String,
    /// Divide by the white image.
    pub vignetting: bool,
    /// `lenslet`, `malvar` or `bilinear`.
    pub demosaic: String,
    /// Views a row and column.
    pub views: usize,
    /// Samples to views.
    pub way: Way,
    /// Strength of the simulated noise; 0.7 is the simulator's usual one.
    pub noise: f64,
    /// Train a dictionary for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub training: Option<Training>,
}

impl Default for Chain {
    fn default() -> Self {
        Chain {
            calibration: CalibrationVariant::Full.name().to_owned(),
            vignetting: true,
            demosaic: "lenslet".to_owned(),
            views: 7,
            way: Way::Barycentric,
            noise: 0.7,
            training: None,
        }
    }
}

impl Chain {
    /// The decoder's steps for this chain.
    ///
    /// # Errors
    /// A name of a kind that there is not.
    pub fn steps(&self) -> Result<Vec<Step>> {
        let kind = match self.demosaic.as_str() {
            "malvar" => Demosaic::Malvar,
            "bilinear" => Demosaic::Bilinear,
            "lenslet" => Demosaic::Lenslet,
            other => bail!("no demosaic is named {other}"),
        };
        let mut steps = default_steps();
        steps.retain(|s| self.vignetting || !matches!(s, Step::Vignetting));
        for step in &mut steps {
            if matches!(step, Step::Demosaic(_)) {
                *step = Step::Demosaic(kind);
            }
        }
        Ok(steps)
    }
}

/// What is scored.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Subject {
    /// A simulated scene with its truth.
    Scene(Kind),
    /// A real capture: hidden lenslets.
    Capture(PathBuf),
    /// Another tool's light field on the truth given with it.
    Peer(String, PathBuf),
}

impl Subject {
    /// Name in tables. Of files only the name is shown, never where they lie; all peers share the truth they are scored on.
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
}

impl Run {
    /// Identifies the run among all others of this version of the program.
    pub fn key(&self) -> String {
        let text = serde_json::to_string(self).unwrap_or_default();
        let digest = Sha256::digest(format!("{} {text}", env!("CARGO_PKG_VERSION")));
        digest.iter().take(12).map(|b| format!("{b:02x}")).collect()
    }

    /// For people.
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
                runs.push(run(settings, experiment, name, &Chain::default(), subject, 1));
            }
            continue;
        }
        let scenes = scenes(experiment, settings.quick);
        for (variant, chain) in variants(experiment, settings.quick) {
            for &scene in &scenes {
                for seed in settings.seeds() {
                    runs.push(run(settings, experiment, &variant, &chain, Subject::Scene(scene), seed));
                }
            }
            if real(experiment) && !settings.whites.is_empty() {
                for capture in &settings.captures {
                    // Another seed hides other lenslets of the same capture, which changes little: one will do for a look.
                    for seed in settings.seeds().take(if settings.quick { 1 } else { usize::MAX }) {
                        let subject = Subject::Capture(capture.clone());
                        runs.push(run(settings, experiment, &variant, &chain, subject, seed));
                    }
                }
            }
        }
    }
    Ok(runs)
}

fn run(settings: &Settings, experiment: Experiment, variant: &str, chain: &Chain, subject: Subject, seed: u64) -> Run {
    Run { experiment, variant: variant.to_owned(), chain: chain.clone(), subject, seed, sensor: settings.sensor() }
}

/// Experiments that real captures can answer. Dictionary runs would train for hours.
fn real(experiment: Experiment) -> bool {
    matches!(experiment, Experiment::Calibration | Experiment::Subpixel | Experiment::Resampling)
}

fn scenes(experiment: Experiment, quick: bool) -> Vec<Kind> {
    match (experiment, quick) {
        (Experiment::Resampling, false) => {
            vec![Kind::Natural, Kind::Planes, Kind::Slanted, Kind::Occluders, Kind::Chart]
        }
        (Experiment::Calibration | Experiment::Subpixel | Experiment::Resampling, _) => {
            vec![Kind::Natural, Kind::Chart]
        }
        (Experiment::Views, _) => vec![Kind::Natural],
        (_, true) => vec![Kind::Natural],
        (_, false) => vec![Kind::Natural, Kind::Chart],
    }
}

/// The rows of an experiment.
fn variants(experiment: Experiment, quick: bool) -> Vec<(String, Chain)> {
    let base = Chain::default;
    let named = |name: &str, chain: Chain| (name.to_owned(), chain);
    let centres = |v: CalibrationVariant| Chain { calibration: v.name().to_owned(), ..base() };
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
        Experiment::Resampling => Way::ALL.into_iter().map(|way| named(way.name(), Chain { way, ..base() })).collect(),
        Experiment::Dictionary => dictionary(quick),
        Experiment::Noise => {
            let levels: &[f64] = if quick { &[0.0, 3.0] } else { &[0.0, 0.7, 1.5, 3.0, 6.0] };
            let ways: &[Way] = if quick {
                &[Way::Barycentric, Way::Learned]
            } else {
                &[Way::Barycentric, Way::Cubic, Way::Multiview, Way::Learned]
            };
            ways.iter()
                .flat_map(|&way| levels.iter().map(move |&noise| (way, noise)))
                .map(|(way, noise)| named(&format!("{}, noise {noise}", way.name()), Chain { way, noise, ..base() }))
                .collect()
        }
        Experiment::Demosaic => {
            ["bilinear", "malvar", "lenslet"].map(|d| named(d, Chain { demosaic: d.to_owned(), ..base() })).to_vec()
        }
        Experiment::Vignetting => [("off", false), ("on", true)]
            .map(|(name, vignetting)| named(name, Chain { vignetting, ..base() }))
            .to_vec(),
        Experiment::Views => {
            let counts: &[usize] = if quick { &[3, 7] } else { &[3, 5, 7, 9] };
            let way = Way::Multiview;
            counts.iter().map(|&views| named(&format!("{views}x{views}"), Chain { views, way, ..base() })).collect()
        }
        Experiment::Peers => Vec::new(),
    }
}

/// One parameter of the dictionary after another, around a middle.
fn dictionary(quick: bool) -> Vec<(String, Chain)> {
    let middle = Training {
        atoms: if quick { 128 } else { 256 },
        patch: 9,
        lambda: 0.1,
        features: 40,
        pairs: if quick { 8_000 } else { 50_000 },
        algorithm: "online".to_owned(),
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
        rows.push(("ksvd".to_owned(), Training { algorithm: "ksvd".to_owned(), ..m() }));
        // Some thirty times as slow as the others: to be compared with their 5000 pairs.
        rows.push(("ista, 5000 pairs".to_owned(), Training { algorithm: "ista".to_owned(), pairs: 5_000, ..m() }));
    }
    rows.push(("low part first".to_owned(), Training { joint: false, ..m() }));
    rows.into_iter()
        .map(|(name, t)| (name, Chain { way: Way::Learned, training: Some(t), ..Chain::default() }))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_run_has_a_key_of_its_own_that_stays() {
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
            assert_eq!(experiments.len(), 8);
        }
    }

    #[test]
    fn chains_turn_into_steps() {
        let chain = Chain { vignetting: false, demosaic: "bilinear".into(), ..Chain::default() };
        let steps = chain.steps().unwrap();
        assert!(!steps.contains(&Step::Vignetting) && steps.contains(&Step::Demosaic(Demosaic::Bilinear)));
        assert!(Chain { demosaic: "x".into(), ..Chain::default() }.steps().is_err());
    }

    #[test]
    fn captures_and_peers_join_when_given() {
        let mut settings = Settings { quick: true, ..Settings::default() };
        let before = plan(&settings).unwrap().len();
        settings.captures = vec!["a.jpg".into()];
        settings.whites = vec!["w.png".into()];
        assert!(plan(&settings).unwrap().len() > before);
        settings.peers = vec![("other".into(), "lf".into())];
        assert!(plan(&settings).unwrap_err().to_string().contains("--truth"));
        settings.truth = Some("truth".into());
        assert!(plan(&settings).unwrap().iter().any(|r| r.experiment == Experiment::Peers));
    }
}
