//! From samples to views (paper sections 4.1 to 4.4), each rendering made once: most experiments share most of their
//! chains, and the learned methods start from the others' views.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::time::Instant;

use anyhow::{Context as _, Result};
use lenslet_core::decode::HexSamples;
use lenslet_core::dictionary::{Dictionary, Footprint, PatchPredictor};
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::View;
use lenslet_core::progress::Observer;
use lenslet_views::multiview::Fit;
use lenslet_views::{InterpolatedViews, LearnedViews, multiview, reconstruct};
use ndarray::Array3;

use super::downsampled::downsampled_views;
use super::method::Method;

/// What a sample is: the truth is sharp, of which a lenslet sees the mean over its disc.
pub(super) const FOOTPRINT: Footprint = Footprint::Lenslet;

/// Views of linear light, and the seconds they took.
pub(super) struct Rendered {
    pub(super) images: Vec<Array3<f32>>,
    pub(super) seconds: f64,
}

/// What the runs of one capture share. [`RenderCache::enter`] comes before a run of another capture, or of the same
/// by another calibration.
#[derive(Default)]
pub(super) struct RenderCache {
    capture: String,
    part: String,
    /// Name of the steps to the samples, and the last ones.
    samples: Option<(String, HexSamples)>,
    /// By the names of the steps to the samples and of the method.
    views: HashMap<String, Rendered>,
}

impl RenderCache {
    /// Drops whatever is not of this capture and this part.
    pub(super) fn enter(&mut self, capture: &str, part: &str) {
        if self.capture != capture {
            *self = RenderCache { capture: capture.to_owned(), ..RenderCache::default() };
        }
        if self.part != part {
            self.views.clear();
            self.part = part.to_owned();
        }
    }

    /// The samples after the steps of that name, with the views kept; `decode` makes those that are not there.
    pub(super) fn decoded(
        &mut self,
        steps: &str,
        decode: impl FnOnce() -> Result<HexSamples>,
    ) -> Result<(&HexSamples, &mut HashMap<String, Rendered>)> {
        let samples = match self.samples.take().filter(|(name, _)| name == steps) {
            Some(found) => found,
            None => (steps.to_owned(), decode()?),
        };
        Ok((&self.samples.insert(samples).1, &mut self.views))
    }
}

/// Keeps a view made elsewhere, as if [`render`] had made it; nothing where there is one.
pub(super) fn keep_view(
    kept: &mut HashMap<String, Rendered>,
    steps: &str,
    method: Method,
    make: impl FnOnce() -> Result<Array3<f32>>,
) -> Result<()> {
    if let Entry::Vacant(place) = kept.entry(format!("{steps} {}", method.name())) {
        place.insert(Rendered { images: vec![make()?], seconds: 0.0 });
    }
    Ok(())
}

/// The method whose views a learned method starts from; of any other method itself.
pub(super) fn base(method: Method, dictionary: Option<&Dictionary>) -> Result<Method> {
    let trained_on = || dictionary.and_then(|d| d.model(FOOTPRINT)).context("a learned method needs a dictionary");
    match method {
        Method::LearnedMultiview(_) => Ok(Method::multiview_by(Fit::for_dictionary(trained_on()?.footprint))),
        Method::Learned(_) => Ok(Method::from(trained_on()?.base)),
        _ => Ok(method),
    }
}

/// Renders the views (row v, column u) wanted of samples after the steps of the name given, or finds them among `kept`.
/// The seconds are those of the first time.
pub(super) fn render(
    (steps, samples): (&str, &HexSamples),
    target: &Size,
    method: Method,
    wanted: &[(usize, usize)],
    dictionary: Option<&Dictionary>,
    kept: &mut HashMap<String, Rendered>,
    observer: &dyn Observer,
) -> Result<Rendered> {
    let base = base(method, dictionary)?;
    let low = match kept.entry(format!("{steps} {}", base.name())) {
        Entry::Occupied(found) => found.into_mut(),
        Entry::Vacant(place) => {
            let begun = Instant::now();
            let images = interpolate_views(samples, target, base, wanted, observer)?;
            place.insert(Rendered { images, seconds: begun.elapsed().as_secs_f64() })
        }
    };
    if method == base {
        return Ok(Rendered { images: low.images.clone(), seconds: low.seconds });
    }
    let begun = Instant::now();
    let dictionary = dictionary.context("a learned method needs a dictionary")?;
    let predictor = method.predictor().context("only learned methods start from another one's views")?;
    let how = (dictionary, predictor);
    let images = reconstruct_views(samples, target, (base, &low.images), wanted, how, observer)?;
    Ok(Rendered { images, seconds: low.seconds + begun.elapsed().as_secs_f64() })
}

fn interpolate_views(
    samples: &HexSamples,
    target: &Size,
    method: Method,
    wanted: &[(usize, usize)],
    observer: &dyn Observer,
) -> Result<Vec<Array3<f32>>> {
    if method == Method::BicubicDownsampled {
        return downsampled_views(samples, target, wanted);
    }
    let interpolation = method.interpolation().with_context(|| format!("{} starts from other views", method.name()))?;
    let prepared = if interpolation == Interpolation::Multiview {
        let options = multiview::Options { fit: method.fit(), ..multiview::Options::default() };
        InterpolatedViews::refined(samples, &options, target, observer)?
    } else {
        InterpolatedViews::prepare(samples, interpolation, target, observer)?
    };
    let mut images = Vec::new();
    let mut keep = |_: usize, _: usize, view: View| -> Result<()> {
        images.push(view.into_pixels());
        Ok(())
    };
    prepared.render_views(wanted, &mut keep, observer)?;
    Ok(images)
}

/// Views that `base` made of the samples, reconstructed by one predictor of a dictionary.
fn reconstruct_views(
    samples: &HexSamples,
    target: &Size,
    (base, low): (Method, &[Array3<f32>]),
    wanted: &[(usize, usize)],
    (dictionary, predictor): (&Dictionary, PatchPredictor),
    observer: &dyn Observer,
) -> Result<Vec<Array3<f32>>> {
    let mode = reconstruct::Mode::Only(predictor);
    let options = reconstruct::Options { mode, footprint: FOOTPRINT, ..reconstruct::Options::default() };
    let interpolation = base.interpolation().context("learned reconstruction starts from interpolated views")?;
    let learned = LearnedViews::prepare(samples, interpolation, target, dictionary, &options, observer)?;
    low.iter()
        .zip(wanted)
        .map(|(pixels, &(v, u))| {
            observer.check()?;
            Ok(learned.reconstruct_view(&View::new(pixels.clone()), v, u)?.into_pixels())
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use lenslet_core::progress::Silent;

    use super::*;

    #[test]
    fn cached_views_equal_rendered_ones() {
        let samples = |gain: f32| {
            let centres: Vec<[f64; 2]> =
                (0..256).map(|k| [5.0 + 10.0 * f64::from(k % 16), 5.0 + 10.0 * f64::from(k / 16)]).collect();
            let values =
                Array3::from_shape_fn((1, 256, 3), |(_, k, c)| gain * (0.2 + 0.002 * k as f32) + 0.01 * c as f32);
            HexSamples {
                sensor: Size::new(160, 160),
                index: (0..256).map(|k| [k % 16, k / 16]).collect(),
                centres,
                views: 1,
                view_step: 1.0,
                weights: Default::default(),
                values,
            }
        };
        let target = Size { width: 40, height: 40 };
        let mut kept = RenderCache::default();
        let mut decodings = 0;
        let mut view = |kept: &mut RenderCache, steps: &str, method| {
            let gain = if steps == "a" { 1.0 } else { 0.5 };
            let (found, views) = kept
                .decoded(steps, || {
                    decodings += 1;
                    Ok(samples(gain))
                })
                .unwrap();
            let rendered = render((steps, found), &target, method, &[(0, 0)], None, views, &Silent).unwrap();
            let fresh = interpolate_views(&samples(gain), &target, method, &[(0, 0)], &Silent).unwrap();
            assert_eq!(rendered.images, fresh, "{steps} {method:?}");
        };
        kept.enter("one", "");
        for steps in ["a", "a", "b"] {
            view(&mut kept, steps, Method::Barycentric);
            view(&mut kept, steps, Method::Cubic);
        }
        assert_eq!(kept.views.len(), 4);
        kept.enter("one", "another calibration");
        assert!(kept.views.is_empty() && kept.samples.is_some());
        view(&mut kept, "b", Method::Barycentric);
        kept.enter("another", "");
        assert!(kept.views.is_empty() && kept.samples.is_none());
        assert_eq!(decodings, 2);
    }
}
