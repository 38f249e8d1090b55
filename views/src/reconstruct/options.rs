//! Options of learned reconstruction.

use lenslet_core::dictionary::{Footprint, PatchPredictor};

/// How much work reconstruction does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// The LASSO codes of eq. (4); for refined views the dictionary's network, where it has one and its inputs are
    /// available.
    Learned,
    /// Anchored regressors, for refined views the network; patches further apart. The LASSO codes where the dictionary
    /// has neither.
    Fast,
    /// As `Learned`, averaged over four mirrored copies of the view; of interpolated views the mean of the LASSO codes
    /// and the network, where there is one.
    Best,
    /// This predictor, whatever the view.
    Only(PatchPredictor),
}

impl Mode {
    /// All of them.
    pub fn all() -> impl Iterator<Item = Mode> {
        [Mode::Learned, Mode::Fast, Mode::Best].into_iter().chain(PatchPredictor::ALL.map(Mode::Only))
    }

    /// The name in descriptions of results: that of the option, or the word of the predictor.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Mode::Learned => "learned",
            Mode::Fast => "fast",
            Mode::Best => "best",
            Mode::Only(PatchPredictor::NoCodes) => "no-codes",
            Mode::Only(predictor) => predictor.word(),
        }
    }
}

/// Options of a [`super::Reconstructor`].
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How much work; default [`Mode::Learned`].
    pub mode: Mode,
    /// What a sample of the view is: the image at a point (the default), or its mean over the lenslet, which is then
    /// sharpened as well, noise included. A dictionary without a model for it falls back to its first model.
    pub footprint: Footprint,
    /// Pixels between neighbouring patches, at least 1; `None`, the default: as the mode has it.
    pub step: Option<usize>,
    /// λ of eq. (4), 0 to 1; `None`, the default: the trained one.
    pub lambda: Option<f32>,
    /// Mirrored copies averaged, 1, 2 or 4; `None`, the default: as the mode has it.
    pub ensemble: Option<usize>,
    /// Standard deviation of the measured samples' noise (sRGB-encoded luminance, 0..1), where they are available (see
    /// [`super::Measurements`]); `None`, the default: estimated from them.
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
