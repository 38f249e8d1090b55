//! Which experiments an ablation runs, and on which data.

use std::path::PathBuf;

use super::experiment::Experiment;
use super::used_dictionaries::UsedDictionaries;

/// What a real camera is calibrated by.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum CalibratedBy {
    /// There is no real camera.
    #[default]
    Nothing,
    /// White images.
    Whites(Vec<PathBuf>),
    /// Ordinary captures.
    Captures(Vec<PathBuf>),
    /// A calibration that exists: it has no variants to compare.
    File(PathBuf),
}

impl CalibratedBy {
    /// The files it is made from.
    pub fn files(&self) -> &[PathBuf] {
        match self {
            CalibratedBy::Nothing => &[],
            CalibratedBy::Whites(files) | CalibratedBy::Captures(files) => files,
            CalibratedBy::File(file) => std::slice::from_ref(file),
        }
    }

    /// Whether variants of it can be made.
    pub fn has_variants(&self) -> bool {
        matches!(self, CalibratedBy::Whites(_) | CalibratedBy::Captures(_))
    }

    /// Kind and names of the files, never where they lie; none without a real camera.
    pub fn name(&self) -> Option<String> {
        let kind = match self {
            CalibratedBy::Nothing => return None,
            CalibratedBy::Whites(_) => "white images",
            CalibratedBy::Captures(_) => "captures",
            CalibratedBy::File(_) => "calibration",
        };
        let names = self.files().iter().filter_map(|f| Some(f.file_name()?.to_string_lossy().into_owned()));
        Some(format!("{kind} {}", names.collect::<Vec<_>>().join(", ")))
    }
}

/// Which experiments to run, and on which data.
#[derive(Debug, Clone, Default)]
pub struct Settings {
    /// Which experiments; empty: all.
    pub experiments: Vec<Experiment>,
    /// Small sensor, fewer variants: minutes instead of an hour.
    pub quick: bool,
    /// Number of seeds of the simulated cameras and scenes; their spread is reported. 0: the default, 3 (quick: 2).
    pub seeds: u64,
    /// What a real camera is calibrated by.
    pub calibrated_by: CalibratedBy,
    /// Captures of that camera, measured without a ground truth.
    pub captures: Vec<PathBuf>,
    /// The dictionaries of the learned methods.
    pub dictionaries: UsedDictionaries,
    /// Photos to train the dictionaries on; those inside the program when empty.
    pub photos: Vec<PathBuf>,
    /// Light fields decoded by other tools, with the tools' names.
    pub peers: Vec<(String, PathBuf)>,
    /// The truth of the capture they decoded: a light field.
    pub truth: Option<PathBuf>,
}

impl Settings {
    /// Side of the simulated sensor, pixels.
    pub fn sensor(&self) -> usize {
        if self.quick { 1144 } else { 1640 }
    }

    /// Longer side of the views: in proportion to 1080 for an F01's 3280.
    pub fn size(&self) -> usize {
        (self.sensor() * 1080 + 1640) / 3280
    }

    /// The seeds, from 1.
    pub fn seeds(&self) -> std::ops::RangeInclusive<u64> {
        let n = match self.seeds {
            0 if self.quick => 2,
            0 => 3,
            n => n,
        };
        1..=n
    }
}
