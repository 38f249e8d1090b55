//! Views interpolated from samples, each from its own or from those of all views (paper sections 4.1 to 4.3).

use lenslet_core::decode::HexSamples;
use lenslet_core::ensure;
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::View;
use lenslet_core::progress::Observer;
use ndarray::Array3;

use crate::Error;
use crate::interpolate::{ViewInterpolator, prepare_interpolator};
use crate::multiview::{self, RefinedViews, SampleSet};
use crate::target::Sink;

/// Samples prepared for one interpolation at one size: any view can be rendered from them, in linear light.
pub struct InterpolatedViews<'a> {
    samples: &'a HexSamples,
    source: Source<'a>,
}

enum Source<'a> {
    /// Every view by itself.
    Single(Box<dyn ViewInterpolator>),
    /// Every view from all.
    Refined(Box<RefinedViews<'a>>),
}

impl<'a> InterpolatedViews<'a> {
    /// Prepares `interpolation` at the size `target`; multi-view estimates disparity here, which takes most of the
    /// time.
    ///
    /// # Errors
    /// Samples that cannot be triangulated, a size out of range, interruption.
    pub fn prepare(
        samples: &'a HexSamples,
        interpolation: Interpolation,
        target: &Size,
        observer: &dyn Observer,
    ) -> Result<Self, Error> {
        match interpolation {
            Interpolation::Multiview => Self::refined(samples, &multiview::Options::default(), target, observer),
            single => Ok(InterpolatedViews {
                samples,
                source: Source::Single(prepare_interpolator(single, samples, target)?),
            }),
        }
    }

    /// Multi-view refinement with options of the caller's.
    ///
    /// # Errors
    /// As [`InterpolatedViews::prepare`]; options out of range.
    pub fn refined(
        samples: &'a HexSamples,
        options: &multiview::Options,
        target: &Size,
        observer: &dyn Observer,
    ) -> Result<Self, Error> {
        let refined = RefinedViews::estimate(SampleSet::hexagonal(samples, target)?, options, observer)?;
        Ok(InterpolatedViews { samples, source: Source::Refined(Box::new(refined)) })
    }

    /// Renders the view (row `v`, column `u`, from 0), shape (t, s, c), linear light.
    ///
    /// # Errors
    /// A view that does not exist.
    pub fn render_view(&self, v: usize, u: usize) -> Result<View, Error> {
        let n = self.samples.views;
        ensure!(Error::Parameter, v < n && u < n, "there is no view {v},{u}: there are {n}x{n} views");
        let pixels = match &self.source {
            Source::Single(interpolator) => interpolator.interpolate_view(self.samples.view(v, u))?,
            Source::Refined(refined) => refined.render_view(v, u)?,
        };
        Ok(View::new(pixels))
    }

    /// Renders the views `wanted` (row, column), each handed to `sink` in the order wanted.
    ///
    /// # Errors
    /// Views that do not exist, errors of the sink, interruption.
    pub fn render_views<E: From<Error>>(
        &self,
        wanted: &[(usize, usize)],
        sink: Sink<'_, E>,
        observer: &dyn Observer,
    ) -> Result<(), E> {
        if let Source::Refined(refined) = &self.source {
            return refined.render_views(
                wanted,
                &mut |v, u, pixels: Array3<f32>| sink(v, u, View::new(pixels)),
                observer,
            );
        }
        observer.begin("rendering views", wanted.len() as u64);
        for &(v, u) in wanted {
            observer.check().map_err(Error::from)?;
            sink(v, u, self.render_view(v, u)?)?;
            observer.advance(1);
        }
        Ok(())
    }
}
