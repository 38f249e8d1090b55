//! Options of learned reconstruction: the same for every command that does it.

use std::path::{Path, PathBuf};

use lenslet_core::dictionary::Footprint;
use lenslet_views::reconstruct::{self, Mode};

use super::Usage;
use super::inputs::Input;
use super::values::{FootprintName, PredictorName};

/// How views are reconstructed with a dictionary.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Learned reconstruction")]
pub struct LearnedArgs {
    /// Dictionary: a file, or a name [default: the embedded one for views of this kind: default, or multiview for
    /// refined ones]
    #[arg(long, value_name = "NAME|FILE")]
    pub dictionary: Option<PathBuf>,
    /// Faster: anchored regressors (the network for refined views; LASSO codes where the dictionary has neither), patches
    /// further apart
    #[arg(long)]
    fast: bool,
    /// Slower: LASSO codes and network together (the network alone for refined views; LASSO codes alone where there is no
    /// network), averaged over four mirrored copies of each view
    #[arg(long, conflicts_with = "fast")]
    best: bool,
    /// What predicts residuals [default: LASSO codes for interpolated views, the network for refined ones]; a dictionary
    /// without it is refused
    #[arg(long, conflicts_with_all = ["fast", "best"], value_enum, value_name = "HOW")]
    path: Option<PredictorName>,
    /// What a sample is: a point of the view, or the mean over the lenslet, which is then sharpened as well (and the
    /// noise with it) [default: point]
    #[arg(long, value_enum, value_name = "WHAT")]
    footprint: Option<FootprintName>,
    /// Pixels between patches
    #[arg(long, value_name = "N")]
    step: Option<usize>,
    /// λ instead of the trained one
    #[arg(value_parser = super::values::finite::<f32>, long, value_name = "L")]
    lambda: Option<f32>,
    /// Standard deviation of the measured samples' noise (sRGB-encoded, 0..1) [default: estimated]
    #[arg(value_parser = super::values::finite::<f32>, long, visible_alias = "sample-noise", value_name = "S")]
    pub noise: Option<f32>,
}

impl LearnedArgs {
    /// What is given, and what it must be.
    pub fn inputs(&self) -> impl Iterator<Item = (&Path, Input)> {
        self.dictionary.as_deref().map(|p| (p, Input::Dictionary)).into_iter()
    }

    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), Usage> {
        if self.lambda.is_some_and(|l| !(0.0..=1.0).contains(&l)) || self.step == Some(0) {
            return Err(Usage("--lambda must be 0 to 1, and --step at least 1".into()));
        }
        if self.noise.is_some_and(|s| !(0.0..=1.0).contains(&s)) {
            return Err(Usage("--noise must be 0 to 1".into()));
        }
        Ok(())
    }

    /// The first option given, if any is.
    pub fn first_given(&self) -> Option<&'static str> {
        let given = [
            ("--dictionary", self.dictionary.is_some()),
            ("--fast", self.fast),
            ("--best", self.best),
            ("--path", self.path.is_some()),
            ("--step", self.step.is_some()),
            ("--lambda", self.lambda.is_some()),
        ];
        given.into_iter().find(|(_, given)| *given).map(|(name, _)| name)
    }

    /// Whether it was said what a sample is.
    pub fn names_footprint(&self) -> bool {
        self.footprint.is_some()
    }

    /// What a sample is.
    pub fn footprint(&self) -> Footprint {
        self.footprint.map_or(Footprint::Point, Footprint::from)
    }

    fn mode(&self) -> Mode {
        match (self.path, self.fast, self.best) {
            (Some(path), ..) => Mode::Only(path.0),
            (None, true, _) => Mode::Fast,
            (None, _, true) => Mode::Best,
            (None, ..) => Mode::Learned,
        }
    }

    /// The options of the reconstruction.
    pub fn options(&self) -> reconstruct::Options {
        reconstruct::Options {
            mode: self.mode(),
            footprint: self.footprint(),
            step: self.step,
            lambda: self.lambda,
            noise: self.noise,
            ..reconstruct::Options::default()
        }
    }
}
