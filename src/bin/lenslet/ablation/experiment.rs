//! The experiments: their names and their questions (paper section 5, figures 8 to 11, and further ones).

use std::str::FromStr;

use serde::Serialize;

/// What views are scored against.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Truth {
    /// The scene as a camera without lenslets sees it: what methods are to reach.
    Sharp,
    /// The scene as lenslets gather it: how well samples are taken, which blur would hide.
    Gathered,
}

impl Truth {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Truth::Sharp => "the sharp truth",
            Truth::Gathered => "the truth that lenslets gather",
        }
    }
}

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
    /// The paper's steps as printed, each beside this program's.
    Paper,
    /// Which parameters of the dictionary matter.
    Dictionary,
    /// Captures of rising noise.
    Noise,
    /// How the two missing colours of each pixel are filled in.
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
    pub const ALL: [Experiment; 10] = [
        Experiment::Calibration,
        Experiment::Subpixel,
        Experiment::Resampling,
        Experiment::Paper,
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
            Experiment::Paper => "paper",
            Experiment::Dictionary => "dictionary",
            Experiment::Noise => "noise",
            Experiment::Demosaic => "demosaic",
            Experiment::Vignetting => "vignetting",
            Experiment::Views => "views",
            Experiment::Peers => "peers",
        }
    }

    /// What simulated captures are scored against: samples where those are compared, else the scene.
    pub fn truth(self) -> Truth {
        match self {
            Experiment::Calibration | Experiment::Subpixel | Experiment::Demosaic | Experiment::Vignetting => {
                Truth::Gathered
            }
            _ => Truth::Sharp,
        }
    }

    /// Its question, in a sentence.
    pub fn question(self) -> &'static str {
        match self {
            Experiment::Calibration => "What does calibration give? (figure 8 of the paper)",
            Experiment::Subpixel => "What do sub-pixel lenslet centres give? (figure 9)",
            Experiment::Resampling => "What do the ways from samples to views give? (figures 10 and 11)",
            Experiment::Paper => "What do the paper's steps give exactly as printed, and what do this program's?",
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
