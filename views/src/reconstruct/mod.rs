//! Learned reconstruction of views and whole light fields (paper section 4.4): eq. (4) on the luminance of every view,
//! colour differences of the interpolated view guided by it, and measured samples kept true.

mod data_consistent;
mod embedded;
mod guided;
mod light_field;
mod noise;
mod sampling_operator;

pub use data_consistent::{DataConsistent, Measurements};
pub use embedded::{embedded, embedded_for, name_for, named, names};
pub use light_field::{Enlargement, light_field};
pub use noise::Noise;
pub use sampling_operator::{SamplingOperator, back_project};

use lenslet_core::dictionary::{self, Dictionary, Footprint, Interpolation, Path};
use lenslet_core::metrics::luminance;
use ndarray::{Array2, Array3, ArrayView2};

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

/// Options of a [`Reconstructor`].
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How much work.
    pub mode: Mode,
    /// What a sample of the view was: a point (the default: nothing is sharpened beyond what was measured) or the mean over
    /// the lenslet, which is undone as well, noise included; a dictionary without a model for it lends its first one.
    pub footprint: Footprint,
    /// Pixels between patches instead of the mode's own.
    pub step: Option<usize>,
    /// λ instead of the trained one.
    pub lambda: Option<f32>,
    /// Copies averaged instead of the mode's own number (1, 2 or 4).
    pub ensemble: Option<usize>,
    /// Passes used, all by default.
    pub passes: Option<usize>,
    /// Standard deviation of the samples' noise (sRGB-encoded luminance, 0..1) instead of what is estimated from them, where
    /// the measured samples are at hand: see [`Measurements`].
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
            passes: None,
            noise: None,
        }
    }
}

/// A dictionary's model made ready for views.
#[derive(Debug, Clone)]
pub struct Reconstructor {
    inner: dictionary::Reconstructor,
    /// Averaged with it.
    other: Option<dictionary::Reconstructor>,
}

impl Reconstructor {
    /// Prepares the model for the footprint asked for.
    ///
    /// # Errors
    /// Options out of range for this dictionary.
    pub fn new(dictionary: &Dictionary, options: &Options) -> Result<Self, dictionary::Error> {
        let model = dictionary
            .model(options.footprint)
            .ok_or_else(|| dictionary::Error::Parameter("the dictionary holds no model".into()))?;
        let network = model.passes.iter().any(|p| p.network.is_some());
        let (refined, mode) = (model.base == Interpolation::Multiview && network, options.mode);
        let (path, step, ensemble) = match mode {
            Mode::Learned if refined => (Path::Network, 2, 1),
            Mode::Network => (Path::Network, 2, 1),
            Mode::Learned | Mode::Lasso => (Path::Lasso, 2, 1),
            Mode::Fast if refined => (Path::Network, 4, 1),
            Mode::Fast => (Path::Anchored, 4, 1),
            Mode::Anchored => (Path::Anchored, 3, 1),
            Mode::Best if refined => (Path::Network, 2, 4),
            Mode::Best => (Path::Lasso, 2, 4),
            Mode::Ridge => (Path::Linear, 3, 1),
        };
        let sides =
            model.passes.iter().flat_map(|p| [Some(p.patch), p.network.as_ref().map(dictionary::Network::patch)]);
        let least = sides.flatten().min().unwrap_or(1);
        let inner = dictionary::Options {
            path,
            step: options.step.unwrap_or(step.min(least)),
            lambda: options.lambda,
            ensemble: options.ensemble.unwrap_or(ensemble),
            passes: options.passes,
            ..dictionary::Options::default()
        };
        let both = mode == Mode::Best && network && !refined;
        let other = dictionary::Options { path: Path::Network, ..inner.clone() };
        let other = if both { Some(dictionary::Reconstructor::new(model, &other)?) } else { None };
        Ok(Reconstructor { inner: dictionary::Reconstructor::new(model, &inner)?, other })
    }

    /// Half the side of the windows in which colours are smoothed: about what a sample takes.
    pub(crate) fn reach(&self) -> usize {
        (self.model().pitch.round() as usize).clamp(1, 16)
    }

    /// Which interpolations of a view's own samples it wants to see beside the view.
    #[must_use]
    pub fn beside(&self) -> &[Interpolation] {
        self.inner.beside()
    }

    /// The model in use.
    pub fn model(&self) -> &dictionary::Model {
        self.inner.model()
    }

    /// Reconstructs a plane (t, s) of sRGB-encoded luminance, 0..1. The result is not clamped.
    ///
    /// # Errors
    /// What the solver reports.
    pub fn plane(&self, low: ArrayView2<'_, f32>) -> Result<Array2<f32>, dictionary::Error> {
        self.plane_beside(low, &[])
    }

    /// [`Reconstructor::plane`] with what [`Reconstructor::beside`] asks for; the LASSO codes stand in where it is missing.
    ///
    /// # Errors
    /// What the solver reports; images of another size.
    pub fn plane_beside(
        &self,
        low: ArrayView2<'_, f32>,
        beside: &[Array2<f32>],
    ) -> Result<Array2<f32>, dictionary::Error> {
        let plane = self.inner.plane_beside(low, beside)?;
        match &self.other {
            Some(other) => Ok((plane + other.plane_beside(low, beside)?) * 0.5),
            None => Ok(plane),
        }
    }

    /// Reconstructs an sRGB-encoded view (t, s, c) with one or three channels: luminance learned, colour differences from
    /// the view, guided by it. Clamped to 0..1.
    ///
    /// # Errors
    /// Another number of channels; what the solver reports.
    pub fn view(&self, low: &Array3<f32>) -> Result<Array3<f32>, dictionary::Error> {
        let y = checked_luminance(low)?;
        let sharp = self.plane(y.view())?;
        Ok(guided::with_luminance(low, &y, &sharp, self.reach()))
    }
}

pub(crate) fn checked_luminance(view: &Array3<f32>) -> Result<Array2<f32>, dictionary::Error> {
    match view.dim().2 {
        1 | 3 => Ok(luminance(view.view())),
        c => Err(dictionary::Error::Parameter(format!("a view of {c} channels cannot be reconstructed: 1 or 3"))),
    }
}
