//! Learned reconstruction of views and whole light fields (paper section 4.4): eq. (4) on the luminance of every view,
//! colour differences from the interpolated view, and measured samples kept true.

mod back_project;
mod captures;
mod light_field;
mod measured;
mod noise;
mod shelf;

pub use back_project::{Measured, back_project};
pub use captures::captured_crops;
pub use light_field::{Enlargement, light_field};
pub use measured::{Faithful, Truth};
pub use noise::Noise;
pub use shelf::{embedded, embedded_for, name_for, named, names};

use lenslet_core::dictionary::{self, Dictionary, Footprint, Path};
use lenslet_core::metrics::{LUMINANCE, luminance};
use ndarray::{Array2, Array3, ArrayView2};

/// How much work reconstruction does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// The LASSO codes of eq. (4).
    Learned,
    /// Anchored regressors, patches further apart.
    Fast,
    /// The LASSO codes, averaged over four mirrored copies of the view.
    Best,
    /// One ridge regressor for all patches: what a linear filter alone gives.
    Ridge,
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
    /// the measured samples are at hand: see [`Truth`].
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
        let (path, step, ensemble) = match options.mode {
            Mode::Learned => (Path::Lasso, 2, 1),
            Mode::Fast => (Path::Anchored, 3, 1),
            Mode::Best => (Path::Lasso, 2, 4),
            Mode::Ridge => (Path::Linear, 3, 1),
        };
        let least = model.passes.iter().map(|p| p.patch).min().unwrap_or(1);
        let inner = dictionary::Options {
            path,
            step: options.step.unwrap_or(step.min(least)),
            lambda: options.lambda,
            ensemble: options.ensemble.unwrap_or(ensemble),
            passes: options.passes,
            ..dictionary::Options::default()
        };
        Ok(Reconstructor { inner: dictionary::Reconstructor::new(model, &inner)? })
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
        self.inner.plane(low)
    }

    /// Reconstructs an sRGB-encoded view (t, s, c) with one or three channels: luminance learned, colour differences from
    /// the view. Clamped to 0..1.
    ///
    /// # Errors
    /// Another number of channels; what the solver reports.
    pub fn view(&self, low: &Array3<f32>) -> Result<Array3<f32>, dictionary::Error> {
        let y = checked_luminance(low)?;
        let sharp = self.plane(y.view())?;
        Ok(with_luminance(low, &y, &sharp))
    }
}

pub(crate) fn checked_luminance(view: &Array3<f32>) -> Result<Array2<f32>, dictionary::Error> {
    match view.dim().2 {
        1 | 3 => Ok(luminance(view.view())),
        c => Err(dictionary::Error::Parameter(format!("a view of {c} channels cannot be reconstructed: 1 or 3"))),
    }
}

/// The view with its luminance moved from `before` to `after`, the same for all channels, clamped to 0..1.
pub(crate) fn with_luminance(view: &Array3<f32>, before: &Array2<f32>, after: &Array2<f32>) -> Array3<f32> {
    debug_assert!((LUMINANCE.iter().sum::<f32>() - 1.0).abs() < 1e-6);
    let mut out = view.clone();
    for ((mut pixel, b), a) in out.lanes_mut(ndarray::Axis(2)).into_iter().zip(before).zip(after) {
        pixel.mapv_inplace(|v| {
            let moved = v + (a - b);
            if moved.is_finite() { moved.clamp(0.0, 1.0) } else { 0.0 }
        });
    }
    out
}
