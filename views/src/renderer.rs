//! The paper's four ways from hexagonal samples to views (section 4), side by side, and a stronger plain one; learned
//! reconstruction (section 4.4) on top of any of them.
//!
//! A dictionary knows one pitch. Where the target's pitch differs from it by more than a tenth, the view is interpolated
//! and reconstructed at the dictionary's own pitch and then resized bicubically to the target.
//!
//! Views interpolated from their own samples keep these true. Views refined by all the others have a dictionary of their own,
//! and are put right by their samples only where they are clearly off: elsewhere they are nearer to the scene than a single
//! noisy sample is.

use std::fmt;
use std::str::FromStr;

use lenslet_core::decode::HexSamples;
use lenslet_core::dictionary::Dictionary;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::lightfield::{ColourSpace, colour};
use lenslet_core::progress::Observer;
use lenslet_core::sampling::{MAX_PIXELS, bicubic as enlarge};
use ndarray::{Array3, ArrayView2, Axis};

use crate::Error;
use crate::interpolate::{barycentric, bicubic, cubic};
use crate::multiview;
use crate::reconstruct::{self, DataConsistent, Reconstructor};
use crate::target::{Sink, Target, pitch};

/// How samples become views.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// One value a pitch on a regular grid, then bicubic (section 4.1).
    Bicubic,
    /// Barycentric on the triangulation, at the target resolution (section 4.2).
    Barycentric,
    /// A smooth cubic surface through the same samples.
    Cubic,
    /// Samples of the other views added at their exact places (section 4.3).
    Multiview,
    /// Dictionary reconstruction on top of another method (section 4.4).
    Learned,
}

impl Method {
    /// All of them, in the paper's order.
    pub const ALL: [Method; 5] =
        [Method::Bicubic, Method::Barycentric, Method::Cubic, Method::Multiview, Method::Learned];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Method::Bicubic => "bicubic",
            Method::Barycentric => "barycentric",
            Method::Cubic => "cubic",
            Method::Multiview => "multiview",
            Method::Learned => "learned",
        }
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Method {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        Method::ALL
            .into_iter()
            .find(|m| m.name() == s)
            .ok_or_else(|| format!("no method \"{s}\": one of {}", Method::ALL.map(Method::name).join(", ")))
    }
}

/// Options of [`render`].
#[derive(Debug, Clone, PartialEq)]
pub struct RenderOptions {
    /// What learned reconstruction starts from.
    pub base: Method,
    /// Dictionary of learned reconstruction; when absent the embedded one for views of `base`.
    pub dictionary: Option<lenslet_core::dictionary::Dictionary>,
    /// How learned reconstruction works.
    pub infer: crate::reconstruct::Options,
}

impl Default for RenderOptions {
    fn default() -> Self {
        // Barycentric views are what the default dictionary was trained on.
        RenderOptions { base: Method::Barycentric, dictionary: None, infer: crate::reconstruct::Options::default() }
    }
}

/// Renders every view of `samples` at `target` by `method`, in order, each handed to `sink` as it is ready.
///
/// # Errors
/// Samples that cannot be triangulated, a target out of range, what the sink returns, interruption.
pub fn render<E: From<Error>>(
    samples: &HexSamples,
    target: &Target,
    method: Method,
    options: &RenderOptions,
    sink: Sink<'_, E>,
    observer: &dyn Observer,
) -> Result<(), E> {
    match method {
        Method::Bicubic => {
            let prepared = bicubic::prepare(samples, target)?;
            each_view(samples, sink, observer, &mut |values| bicubic::view(&prepared, values))
        }
        Method::Barycentric => {
            let prepared = barycentric::prepare(samples, target)?;
            each_view(samples, sink, observer, &mut |values| barycentric::view(&prepared, values))
        }
        Method::Cubic => {
            let prepared = cubic::prepare(samples, target)?;
            each_view(samples, sink, observer, &mut |values| cubic::view(&prepared, values))
        }
        Method::Multiview => multiview::render(samples, target, &multiview::Options::default(), sink, observer),
        Method::Learned => render_learned(samples, target, options, sink, observer),
    }
}

/// Runs a method that treats every view by itself.
fn each_view<E: From<Error>>(
    samples: &HexSamples,
    sink: Sink<'_, E>,
    observer: &dyn Observer,
    view: &mut dyn FnMut(ArrayView2<'_, f32>) -> Result<Array3<f32>, Error>,
) -> Result<(), E> {
    let n = samples.views;
    observer.begin("rendering views", (n * n) as u64);
    for (k, values) in samples.values.outer_iter().enumerate() {
        observer.check().map_err(Error::from)?;
        sink(k / n, k % n, &view(values)?)?;
        observer.advance(1);
    }
    Ok(())
}

/// Difference of pitch that a dictionary bears.
const TOLERANCE: f64 = 0.1;

/// The size at which views are reconstructed for `target`, given the pitch of the samples on the sensor and of the model.
#[must_use]
pub fn working_size(samples: &HexSamples, target: &Target, trained: f64) -> Target {
    let actual = pitch(samples) * target.width as f64 / samples.sensor.0.max(1) as f64;
    let ratio = trained / actual;
    if !ratio.is_finite() || (ratio - 1.0).abs() <= TOLERANCE {
        return *target;
    }
    let side = |n: usize| ((n as f64 * ratio).round().max(1.0)) as usize;
    let (width, height) = (side(target.width), side(target.height));
    if width.checked_mul(height).is_some_and(|n| n <= MAX_PIXELS) { Target { width, height } } else { *target }
}

/// What a dictionary calls a method that views can be made with.
fn base(method: Method) -> Interpolation {
    match method {
        Method::Multiview => Interpolation::Multiview,
        Method::Cubic => Interpolation::Cubic,
        Method::Bicubic => Interpolation::Bicubic,
        Method::Barycentric | Method::Learned => Interpolation::Barycentric,
    }
}

/// Renders every view by `options.base`, reconstructs it with the dictionary (the embedded one for such views unless given), and hands it
/// to `sink` in linear light.
///
/// # Errors
/// As the base method; a dictionary that cannot be used.
fn render_learned<E: From<Error>>(
    samples: &HexSamples,
    target: &Target,
    options: &RenderOptions,
    sink: Sink<'_, E>,
    observer: &dyn Observer,
) -> Result<(), E> {
    if options.base == Method::Learned {
        return Err(Error::Parameter("learned reconstruction cannot start from itself".into()).into());
    }
    let embedded: Dictionary;
    let dictionary = match &options.dictionary {
        Some(given) => given,
        None => {
            embedded = reconstruct::embedded_for(base(options.base)).map_err(Error::from)?;
            &embedded
        }
    };
    let reconstructor = Reconstructor::new(dictionary, &options.infer).map_err(Error::from)?;
    let trained = reconstructor.model().base;
    if (trained == Interpolation::Multiview) != (options.base == Method::Multiview) {
        observer
            .note(&format!("the dictionary was trained on {trained} views, these are {}: expect less", options.base));
    }
    let working = working_size(samples, target, reconstructor.model().pitch);
    if working != *target {
        observer.note(&format!(
            "the dictionary was trained for another pitch: views are reconstructed at {}x{} and resized",
            working.width, working.height
        ));
    }
    let faithful = match options.base {
        Method::Barycentric | Method::Cubic | Method::Multiview => {
            let size = (working.width, working.height);
            Some(DataConsistent::new(&reconstructor, samples, base(options.base), size, options.infer.noise)?)
        }
        _ => None,
    };
    let mut learned = |v: usize, u: usize, view: &Array3<f32>| -> Result<(), E> {
        let encoded = crate::encode::srgb(view);
        let mut sharp = match &faithful {
            Some(f) => f.view(&encoded, samples.values.index_axis(Axis(0), v * samples.views + u))?,
            None => reconstructor.view(&encoded).map_err(Error::from)?,
        };
        if working != *target {
            sharp = enlarge::resize(sharp.view(), target.width, target.height).map_err(Error::from)?;
            sharp.mapv_inplace(|p| p.clamp(0.0, 1.0));
        }
        colour::convert(&mut sharp, ColourSpace::Srgb, ColourSpace::Linear);
        sink(v, u, &sharp)
    };
    render(samples, &working, options.base, options, &mut learned, observer)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_pitches_are_worked_at_the_trained_one() {
        let lenslets = 30 * 30;
        let samples = HexSamples {
            sensor: (300, 300),
            centres: vec![[0.0, 0.0]; lenslets],
            index: vec![[0, 0]; lenslets],
            views: 1,
            view_step: 1.0,
            weights: vec![1.0],
            values: Array3::zeros((1, lenslets, 1)),
        };
        let sensor_pitch = pitch(&samples);
        let at = |width| Target { width, height: width };
        let fit = (3.293 * 300.0 / sensor_pitch).round() as usize;
        assert_eq!(working_size(&samples, &at(fit), 3.293), at(fit));
        assert_eq!(working_size(&samples, &at(fit + 5), 3.293), at(fit + 5));
        let working = working_size(&samples, &at(2 * fit), 3.293);
        assert!(working.width.abs_diff(fit) <= 1);
    }
}
