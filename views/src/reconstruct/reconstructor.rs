//! A dictionary's model made ready for views (eq. (4) on luminance, colours guided by it).

use lenslet_core::colour::luminance;
use lenslet_core::dictionary::{self, Dictionary, PlaneReconstructor, ReconstructionOptions, SideInput};
use lenslet_core::lightfield::{Srgb, View};
use ndarray::{Array2, Array3, ArrayView2};

use super::guided;
use super::options::Options;
use super::plan::{Available, Plan};

/// A dictionary's model made ready for views.
///
/// ```
/// use lenslet_core::lightfield::{Srgb, View};
/// use lenslet_views::reconstruct::{Options, Reconstructor, embedded_dictionary};
/// use ndarray::Array3;
///
/// let reconstructor = Reconstructor::new(&embedded_dictionary()?, &Options::default())?;
/// let flat = View::<Srgb>::new(Array3::from_elem((24, 32, 3), 0.5));
/// let sharp = reconstructor.reconstruct_view(&flat)?;
/// // There is nothing to sharpen.
/// assert!(sharp.pixels().iter().all(|v| (v - 0.5).abs() < 1e-3));
/// # Ok::<(), lenslet_core::dictionary::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Reconstructor {
    first: PlaneReconstructor,
    /// Its result is averaged with the first one's.
    second: Option<PlaneReconstructor>,
    plan: Plan,
}

impl Reconstructor {
    /// Prepares the model for the footprint of `options`, for views of which nothing else is known.
    ///
    /// # Errors
    /// Options out of range for this dictionary; a predictor that it does not hold.
    pub fn new(dictionary: &Dictionary, options: &Options) -> Result<Self, dictionary::Error> {
        Reconstructor::with(dictionary, options, Available::ViewAlone)
    }

    /// The same for views of which more may be available.
    ///
    /// # Errors
    /// As [`Reconstructor::new`].
    pub fn with(dictionary: &Dictionary, options: &Options, available: Available) -> Result<Self, dictionary::Error> {
        let model = dictionary
            .model(options.footprint)
            .ok_or_else(|| dictionary::Error::Parameter("the dictionary holds no model".into()))?;
        let plan = Plan::new(model, options, available)?;
        let prepared = |predictor| {
            let options = ReconstructionOptions {
                predictor,
                step: plan.step,
                lambda: options.lambda,
                ensemble: plan.ensemble,
                ..ReconstructionOptions::default()
            };
            PlaneReconstructor::new(model, &options)
        };
        Ok(Reconstructor {
            first: prepared(plan.predictor)?,
            second: plan.averaged_with.map(prepared).transpose()?,
            plan,
        })
    }

    /// What is done to every view.
    #[must_use]
    pub fn plan(&self) -> Plan {
        self.plan
    }

    /// The model in use.
    #[must_use]
    pub fn model(&self) -> &dictionary::Model {
        self.first.model()
    }

    /// The inputs besides the view.
    #[must_use]
    pub fn side_inputs(&self) -> &[SideInput] {
        match (self.first.side_inputs(), &self.second) {
            ([], Some(second)) => second.side_inputs(),
            (inputs, _) => inputs,
        }
    }

    /// Half the side of the windows in which colours are smoothed, pixels: about the pitch.
    pub(super) fn colour_radius(&self) -> usize {
        (self.model().pitch.round() as usize).clamp(1, 16)
    }

    /// Reconstructs a plane (t, s) of sRGB-encoded luminance, 0..1, given the images that
    /// [`Reconstructor::side_inputs`] names, in that order. The result is not clamped.
    ///
    /// # Errors
    /// Errors of the solver; images that are missing or of another size.
    pub fn reconstruct_plane(
        &self,
        low: ArrayView2<'_, f32>,
        side_inputs: &[Array2<f32>],
    ) -> Result<Array2<f32>, dictionary::Error> {
        let plane = self.first.reconstruct_plane(low, side_inputs)?;
        match &self.second {
            Some(second) => Ok((plane + second.reconstruct_plane(low, side_inputs)?) * 0.5),
            None => Ok(plane),
        }
    }

    /// Reconstructs a view with one or three channels: luminance learned, colour differences those of the view, guided
    /// by it. Clamped to 0..1.
    ///
    /// # Errors
    /// Another number of channels; errors of the solver.
    pub fn reconstruct_view(&self, low: &View<Srgb>) -> Result<View<Srgb>, dictionary::Error> {
        let y = checked_luminance(low.pixels())?;
        let sharp = self.reconstruct_plane(y.view(), &[])?;
        Ok(View::new(guided::with_luminance(low.pixels(), &y, &sharp, self.colour_radius())))
    }
}

/// Luminance of a view of one or three channels.
pub(super) fn checked_luminance(view: &Array3<f32>) -> Result<Array2<f32>, dictionary::Error> {
    match view.dim().2 {
        1 | 3 => Ok(luminance(view.view())),
        c => Err(dictionary::Error::Parameter(format!("a view of {c} channels cannot be reconstructed: 1 or 3"))),
    }
}
