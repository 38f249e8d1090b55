//! Section 4.4 on top of an interpolation: every interpolated view is reconstructed with the dictionary.
//!
//! A dictionary is trained for one pitch. Where the target's pitch differs from it by more than a tenth, the view is
//! interpolated and reconstructed at the dictionary's own pitch and then resized bicubically to the target.
//!
//! Views interpolated from their own samples are back-projected onto these. Views refined by all the others have a
//! separate dictionary and are moved to their samples only where they are clearly off: elsewhere they are nearer to the
//! scene than a single noisy sample is.

use lenslet_core::decode::HexSamples;
use lenslet_core::dictionary::Dictionary;
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::{Srgb, View};
use lenslet_core::progress::Observer;
use lenslet_core::sampling::bicubic;

use super::working_size::working_size;
use crate::Error;
use crate::method::Method;
use crate::multiview::Fit;
use crate::reconstruct::{Available, DataConsistent, Options, Plan, Reconstructor};

/// Learned reconstruction prepared for views that one interpolation made of these samples.
pub struct LearnedViews<'a> {
    samples: &'a HexSamples,
    step: Step,
    working: Size,
    target: Size,
    plan: Plan,
}

enum Step {
    /// Back-projection onto the measured samples follows.
    Consistent(Box<DataConsistent>),
    /// The dictionary alone.
    Alone(Box<Reconstructor>),
}

impl<'a> LearnedViews<'a> {
    /// Prepares `dictionary` for views of the size `target` that `interpolation` makes of the samples. What does not
    /// fit (a dictionary trained on other views, for another pitch) goes to `observer` as a note.
    ///
    /// # Errors
    /// A dictionary that cannot be used, options out of range, samples that cannot be triangulated.
    pub fn prepare(
        samples: &'a HexSamples,
        interpolation: Interpolation,
        target: &Size,
        dictionary: &Dictionary,
        options: &Options,
        observer: &dyn Observer,
    ) -> Result<Self, Error> {
        let alone = interpolation == Interpolation::Bicubic;
        let available = if alone { Available::ViewAlone } else { Available::Samples };
        let reconstructor = Reconstructor::with(dictionary, options, available)?;
        let plan = reconstructor.plan();
        let (trained, pitch) = (reconstructor.model().base, reconstructor.model().pitch);
        if (trained == Interpolation::Multiview) != (interpolation == Interpolation::Multiview) {
            observer.note(&format!(
                "the dictionary was trained on {trained} views, these are {interpolation}: expect lower quality"
            ));
        }
        let working = working_size(samples, target, pitch);
        if working != *target {
            observer.note(&format!(
                "the dictionary was trained for another pitch: views are reconstructed at {}x{} and resized",
                working.width, working.height
            ));
        }
        let step = if alone {
            Step::Alone(Box::new(reconstructor))
        } else {
            Step::Consistent(Box::new(DataConsistent::new(
                reconstructor,
                samples,
                interpolation,
                working,
                options.noise,
            )?))
        };
        Ok(LearnedViews { samples, step, working, target: *target, plan })
    }

    /// The size that views are to be interpolated at.
    #[must_use]
    pub fn working_size(&self) -> Size {
        self.working
    }

    /// The fit that `method` asks for; else the one whose refined views the dictionary of `learned` was made for, or the
    /// usual one where nothing is learned.
    pub(crate) fn fit_of(method: &Method, learned: Option<&Self>) -> Fit {
        method.fit.or(learned.map(Self::made_for)).unwrap_or_default()
    }

    /// The fit whose refined views the dictionary was made for.
    pub(crate) fn made_for(&self) -> Fit {
        let model = match &self.step {
            Step::Consistent(step) => step.reconstructor().model(),
            Step::Alone(step) => step.model(),
        };
        Fit::for_dictionary(model.footprint)
    }

    /// The predictor, the step between patches and the copies averaged.
    #[must_use]
    pub fn plan(&self) -> Plan {
        self.plan
    }

    /// Reconstructs the view (row `v`, column `u`), interpolated at [`LearnedViews::working_size`], to the target size.
    ///
    /// # Errors
    /// Shapes that do not belong together, errors of the solver.
    pub fn reconstruct_view(&self, low: &View, v: usize, u: usize) -> Result<View, Error> {
        let encoded = low.encode();
        let sharp = match &self.step {
            Step::Consistent(step) => {
                let values = self.samples.view(v, u);
                step.reconstruct_view(&encoded, values)?
            }
            Step::Alone(step) => step.reconstruct_view(&encoded)?,
        };
        if self.working == self.target {
            return Ok(sharp.decode());
        }
        let mut pixels = bicubic::resize_bicubic(sharp.pixels().view(), self.target)?;
        pixels.mapv_inplace(|p| p.clamp(0.0, 1.0));
        Ok(View::<Srgb>::new(pixels).decode())
    }
}
