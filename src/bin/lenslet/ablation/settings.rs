//! Which experiments an ablation runs, and on which data.

use std::path::PathBuf;

use super::experiment::Experiment;
use super::used_dictionaries::UsedDictionaries;

/// Which experiments to run, and on which data.
#[derive(Debug, Clone, Default)]
pub struct Settings {
    /// Which experiments; empty: all.
    pub experiments: Vec<Experiment>,
    /// Small sensor, fewer variants: minutes instead of an hour.
    pub quick: bool,
    /// Number of seeds of the simulated cameras and scenes; their spread is reported. 0: the default, 3 (quick: 2).
    pub seeds: u64,
    /// White images of a real camera (or one pattern composed of its captures).
    pub whites: Vec<PathBuf>,
    /// Captures of that camera, scored by hidden lenslets.
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
