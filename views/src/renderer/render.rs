//! The renderer: from samples to views, whatever the method.

use std::path::Path;

use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::{self, ColourSpace, LightField, Meta, View};
use lenslet_core::progress::Observer;
use ndarray::{Array5, s};

use super::interpolated_views::InterpolatedViews;
use super::learned_views::LearnedViews;
use crate::Error;
use crate::method::Method;
use crate::multiview::{self, Fit};
use crate::reconstruct::{Plan, embedded_dictionary_for};
use crate::target::{Sink, view_pitch};

/// Samples prepared for one [`Method`] at one size: single views, all views, or a whole light field.
///
/// ```
/// use lenslet_core::geometry::Size;
/// use lenslet_core::decode::HexSamples;
/// use lenslet_views::{Method, RenderSamples};
/// use ndarray::Array3;
///
/// // One view of a grey wall, seen by 10 x 10 lenslets 10 sensor pixels apart.
/// let place = |k: i32| 4.5 + 10.0 * f64::from(k);
/// let centres: Vec<[f64; 2]> = (0..100).map(|k| [place(k % 10), place(k / 10)]).collect();
/// let samples = HexSamples {
///     sensor: Size::new(100, 100),
///     index: (0..100).map(|k| [k % 10, k / 10]).collect(),
///     centres,
///     views: 1,
///     view_step: 1.0,
///     weights: vec![1.0],
///     values: Array3::from_elem((1, 100, 3), 0.25),
/// };
/// let renderer = samples.renderer(Method::barycentric()).longer_side(40).prepare()?;
/// let view = renderer.view(0, 0)?;
/// assert_eq!((view.width(), view.height(), view.channels()), (40, 40, 3));
/// assert!(view.pixels().iter().all(|v| (v - 0.25).abs() < 1e-6));
/// assert!(renderer.view(1, 0).is_err());
/// # Ok::<(), lenslet_views::Error>(())
/// ```
pub struct Renderer<'a> {
    samples: &'a HexSamples,
    method: &'static str,
    fit: Option<Fit>,
    interpolated: InterpolatedViews<'a>,
    learned: Option<LearnedViews<'a>>,
    size: Size,
    observer: &'a dyn Observer,
}

impl<'a> Renderer<'a> {
    /// Prepares `method` for views of `samples` at `size`; `observer` gets the progress of this and of all
    /// rendering.
    ///
    /// # Errors
    /// Samples that cannot be triangulated, a size out of range, a dictionary that cannot be used, interruption.
    pub fn prepare(
        samples: &'a HexSamples,
        method: &Method,
        size: Size,
        observer: &'a dyn Observer,
    ) -> Result<Self, Error> {
        let interpolation = method.interpolation;
        let learned = match &method.learned {
            Some(learned) => {
                let options = &learned.options;
                Some(match &learned.dictionary {
                    Some(given) => LearnedViews::prepare(samples, interpolation, &size, given, options, observer)?,
                    None => {
                        let embedded = embedded_dictionary_for(interpolation)?;
                        LearnedViews::prepare(samples, interpolation, &size, &embedded, options, observer)?
                    }
                })
            }
            None => None,
        };
        let working = learned.as_ref().map_or(size, LearnedViews::working_size);
        let fit = (interpolation == Interpolation::Multiview).then(|| LearnedViews::fit_of(method, learned.as_ref()));
        let interpolated = if let Some(fit) = fit {
            let made_for = learned.as_ref().map(LearnedViews::made_for);
            if let Some(note) = made_for.and_then(|made_for| made_for.note_of_other(fit.name())) {
                observer.note(&note);
            }
            let options = multiview::Options { fit, ..multiview::Options::default() };
            InterpolatedViews::refined(samples, &options, &working, observer)?
        } else {
            InterpolatedViews::prepare(samples, interpolation, &working, observer)?
        };
        Ok(Renderer { samples, method: method.name(), fit, interpolated, learned, size, observer })
    }

    /// The size of the views.
    #[must_use]
    pub fn size(&self) -> Size {
        self.size
    }

    /// How multi-view samples become pixels; `None` where views are made of their own samples alone.
    #[must_use]
    pub fn fit(&self) -> Option<Fit> {
        self.fit
    }

    /// The plan of learned reconstruction; `None` where views are only interpolated.
    #[must_use]
    pub fn plan(&self) -> Option<Plan> {
        self.learned.as_ref().map(LearnedViews::plan)
    }

    /// Renders the view (row `v`, column `u`, from 0), in linear light.
    ///
    /// # Errors
    /// A view that does not exist, errors of the solver.
    pub fn view(&self, v: usize, u: usize) -> Result<View, Error> {
        let view = self.interpolated.render_view(v, u)?;
        match &self.learned {
            Some(learned) => learned.reconstruct_view(&view, v, u),
            None => Ok(view),
        }
    }

    /// Renders the views `wanted` (row, column), each handed to `sink` in the order wanted.
    ///
    /// # Errors
    /// Views that do not exist, errors of the sink, interruption.
    pub fn render_views<E: From<Error>>(&self, wanted: &[(usize, usize)], sink: Sink<'_, E>) -> Result<(), E> {
        let mut finished = |v: usize, u: usize, view: View| match &self.learned {
            Some(learned) => sink(v, u, learned.reconstruct_view(&view, v, u)?),
            None => sink(v, u, view),
        };
        self.interpolated.render_views(wanted, &mut finished, self.observer)
    }

    /// Renders all views, row by row.
    ///
    /// # Errors
    /// As [`Renderer::render_views`].
    pub fn render_all<E: From<Error>>(&self, sink: Sink<'_, E>) -> Result<(), E> {
        let n = self.samples.views;
        let all: Vec<_> = (0..n * n).map(|k| (k / n, k % n)).collect();
        self.render_views(&all, sink)
    }

    /// The description of the light field of all these views: size, colour space, pitch, method.
    #[must_use]
    pub fn describe(&self, colour: ColourSpace) -> Meta {
        let samples = self.samples;
        let size = [self.size.height, self.size.width];
        let mut meta = Meta::new([samples.views; 2], size, samples.values.dim().2, colour);
        meta.weights = Some(samples.weights.clone());
        meta.pitch = Some(view_pitch(samples, self.size.width));
        meta.method = Some(self.method.into());
        meta.predictor = self.plan().map(|plan| plan.to_string());
        meta
    }

    /// Renders the whole light field into memory, in linear light.
    ///
    /// # Errors
    /// As [`Renderer::render_views`].
    pub fn light_field(&self) -> Result<LightField, Error> {
        let meta = self.describe(ColourSpace::Linear);
        let (n, [height, width]) = (self.samples.views, meta.size);
        let mut data = Array5::zeros((n, n, height, width, meta.channels));
        self.render_all(&mut |v, u, view: View| {
            data.slice_mut(s![v, u, .., .., ..]).assign(view.pixels());
            Ok::<(), Error>(())
        })?;
        Ok(LightField { meta, data })
    }

    /// Renders all views to `path`, sRGB-encoded: a folder of pictures, or a file by its ending (`.npy`, `.mat`, …).
    /// Whole or not at all; what is there already is not replaced.
    ///
    /// # Errors
    /// As [`Renderer::render_views`]; a path that exists or cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        let path = path.as_ref();
        let format = lightfield::Format::of_name(path);
        let mut sink = lightfield::create(path, self.describe(ColourSpace::Srgb), format, false)?;
        self.render_all(&mut |v, u, view: View| -> Result<(), Error> {
            Ok(sink.write(v, u, view.encode().pixels())?)
        })?;
        Ok(sink.finish()?)
    }
}
