//! What a caller chooses of learned reconstruction.

use lenslet_core::dictionary::Footprint;

/// How much work reconstruction does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// The LASSO codes of eq. (4); for refined views the dictionary's network, where it has one.
    Learned,
    /// Anchored regressors, for refined views the network, patches further apart.
    Fast,
    /// As `Learned`, averaged over four mirrored copies of the view; of interpolated views the mean of the LASSO codes and
    /// the network, where there is one.
    Best,
    /// One ridge regressor for all patches: what a linear filter alone gives.
    Ridge,
    /// The LASSO codes, whatever the view.
    Lasso,
    /// The network, whatever the view.
    Network,
    /// Anchored regressors.
    Anchored,
}

impl Mode {
    /// The name in descriptions of results.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Mode::Learned => "learned",
            Mode::Fast => "fast",
            Mode::Best => "best",
            Mode::Ridge => "ridge",
            Mode::Lasso => "lasso",
            Mode::Network => "network",
            Mode::Anchored => "anchored",
        }
    }
}

/// Options of a [`super::Reconstructor`].
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How much work.
    pub mode: Mode,
    /// What a sample of the view was: a point (the default: nothing is sharpened beyond what was measured) or the mean over
    /// the lenslet, which is undone as well, noise included. A dictionary without a model for it falls back to its first model.
    pub footprint: Footprint,
    /// Pixels between patches instead of the mode's own.
    pub step: Option<usize>,
    /// λ instead of the trained one.
    pub lambda: Option<f32>,
    /// Copies averaged instead of the mode's own number (1, 2 or 4).
    pub ensemble: Option<usize>,
    /// Standard deviation of the samples' noise (sRGB-encoded luminance, 0..1) instead of what is estimated from them, where
    /// the measured samples are at hand: see [`super::Measurements`].
    pub noise: Option<f32>,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            mode: Mode::Learned,
            footprint: Footprint::Point,
            step: None,
            lambda: None,
            ensemble: None,
            noise: None,
        }
    }
}
