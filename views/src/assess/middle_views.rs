//! The middle views that methods are measured on.

use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::View;
use lenslet_core::progress::Observer;
use ndarray::{Array3, ArrayView3};

use super::rays::Rays;
use super::withheld::{refined_middle, without_foretold};
use crate::Error;
use crate::method::Method;
use crate::multiview::{Fit, SampleSet};
use crate::reconstruct::embedded_dictionary_for;
use crate::renderer::{InterpolatedViews, LearnedViews};

/// A middle view (t, s, c) in linear light, as the method makes it of all samples, and without those that rays foretell.
#[derive(Debug, Clone)]
pub struct MiddleView {
    whole: Array3<f32>,
    /// Only where it differs.
    withheld: Option<Array3<f32>>,
}

impl MiddleView {
    /// From all samples: what [`super::Edges`] and [`super::Lines`] are measured on.
    #[must_use]
    pub fn whole(&self) -> ArrayView3<'_, f32> {
        self.whole.view()
    }

    /// Without the samples that are foretold: what [`Rays`] are measured on.
    #[must_use]
    pub fn withheld(&self) -> ArrayView3<'_, f32> {
        self.withheld.as_ref().unwrap_or(&self.whole).view()
    }
}

/// Renders the middle views of one capture by one method after the other.
pub struct MiddleViews<'a> {
    samples: &'a HexSamples,
    rays: &'a Rays,
    size: Size,
}

impl<'a> MiddleViews<'a> {
    /// For the samples and the size that the rays were found for.
    #[must_use]
    pub fn new(samples: &'a HexSamples, rays: &'a Rays, size: &Size) -> Self {
        MiddleViews { samples, rays, size: *size }
    }

    /// The middle view by `method`.
    ///
    /// # Errors
    /// As rendering: a dictionary that cannot be used, interruption.
    pub fn render(&self, method: &Method, observer: &dyn Observer) -> Result<MiddleView, Error> {
        observer.check()?;
        let interpolation = method.interpolation;
        let learned = match &method.learned {
            None => None,
            Some(learned) => {
                let embedded;
                let dictionary = match &learned.dictionary {
                    Some(given) => given.as_ref(),
                    None => {
                        embedded = embedded_dictionary_for(interpolation)?;
                        &embedded
                    }
                };
                let options = &learned.options;
                Some(LearnedViews::prepare(self.samples, interpolation, &self.size, dictionary, options, observer)?)
            }
        };
        let size = learned.as_ref().map_or(self.size, LearnedViews::working_size);
        let finish = |picture: Array3<f32>| -> Result<Array3<f32>, Error> {
            observer.check()?;
            let middle = self.samples.views / 2;
            match &learned {
                Some(learned) => Ok(learned.reconstruct_view(&View::new(picture), middle, middle)?.into_pixels()),
                None => Ok(picture),
            }
        };
        if interpolation != Interpolation::Multiview {
            let views = InterpolatedViews::prepare(self.samples, interpolation, &size, observer)?;
            let middle = self.samples.views / 2;
            let whole = finish(views.render_view(middle, middle)?.into_pixels())?;
            return Ok(MiddleView { whole, withheld: None });
        }
        let fit = LearnedViews::fit_of(method, learned.as_ref());
        let whole = self.refined(false, fit, &size, observer)?;
        let withheld = self.refined(true, fit, &size, observer)?;
        Ok(MiddleView { whole: finish(whole)?, withheld: Some(finish(withheld)?) })
    }

    /// The refined middle view of `size`, from all samples or without those that are foretold.
    fn refined(&self, withheld: bool, fit: Fit, size: &Size, observer: &dyn Observer) -> Result<Array3<f32>, Error> {
        if *size == self.size && fit == Fit::LeastSquares {
            return Ok(if withheld { self.rays.refined() } else { self.rays.refined_from_all() }.to_owned());
        }
        let mut known = self.rays.disparity().clone();
        known *= size.width as f32 / self.size.width as f32;
        let set =
            if withheld { without_foretold(self.samples, size)? } else { SampleSet::hexagonal(self.samples, size)? };
        refined_middle(set, fit, known, observer)
    }

    /// The middle view refined by this fit without the samples that are foretold, (t, s, c), linear light.
    ///
    /// # Errors
    /// As the refinement; interruption.
    pub fn refined_withheld(&self, fit: Fit, observer: &dyn Observer) -> Result<Array3<f32>, Error> {
        self.refined(true, fit, &self.size, observer)
    }
}

#[cfg(test)]
mod tests {
    use lenslet_core::progress::Silent;

    use super::*;

    #[test]
    fn only_other_views_are_withheld() {
        let samples = super::super::rays::tests::slanted_samples();
        let size = Size { width: 100, height: 100 };
        let rays = Rays::find(&samples, &size, &Silent).unwrap();
        let views = MiddleViews::new(&samples, &rays, &size);
        let single = views.render(&Method::cubic(), &Silent).unwrap();
        assert_eq!(single.whole(), single.withheld());
        let refined = views.render(&Method::multiview().fitted_by(Fit::LeastSquares), &Silent).unwrap();
        assert!(refined.whole() != refined.withheld());
        assert_eq!(refined.withheld(), rays.refined());
        // Foretelling what was seen is easier, for a fit that takes it for what the measure does.
        let joint = views.render(&Method::multiview(), &Silent).unwrap();
        let [whole, withheld] = [joint.whole(), joint.withheld()].map(|p| rays.measure(p).unwrap().psnr());
        assert!(whole > withheld + 0.1, "{whole} {withheld}");
        // Another fit is rendered, not taken from the rays.
        let triangulated = views.render(&Method::multiview().fitted_by(Fit::Triangulation), &Silent).unwrap();
        assert!(triangulated.withheld() != refined.withheld());
    }
}
