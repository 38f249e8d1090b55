//! Section 4.3: refinement using multiple views. Every sample of every view is copied along its ray to its true place in the
//! target view; the image is then fitted to all of them at their exact places, with single-view interpolation as the prior.

mod bundle;
mod fit;
mod hidden;
mod mesh;
mod refine;
mod surfaces;
mod trust;

use crate::Error;
use crate::error::ensure_shape;
pub use bundle::Bundle;
pub use hidden::{HiddenScore, hidden_score};
use lenslet_core::decode::HexSamples;
use lenslet_core::lightfield::LightField;
use lenslet_core::progress::Observer;
use ndarray::Array3;
use rayon::prelude::*;
pub use surfaces::{Surfaces, front_of};

use crate::disparity;
use crate::target::{Sink, Target};

/// How the image is made of the scattered samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Fit {
    /// Weighted least-squares pixels, single-view interpolation as the prior.
    #[default]
    Smooth,
    /// The paper's way: triangulate all samples, interpolate barycentrically. Seconds a view; kept for comparison.
    Triangulation,
}

/// How views are refined.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How the image is made of the samples.
    pub fit: Fit,
    /// How disparity is estimated. Its unit is pixels of the target view; `range` and `limit` count in these.
    pub disparity: disparity::Options,
    /// Disparity of the middle view known beforehand (t, s at any size, in pixels of the target view per view step).
    pub known: Option<ndarray::Array2<f32>>,
    /// Views to render (row, column); `None`: all.
    pub views: Option<Vec<(usize, usize)>>,
}

impl Default for Options {
    fn default() -> Self {
        let disparity = disparity::Options { linear: true, side: SIDE, ..disparity::Options::default() };
        Options { fit: Fit::default(), disparity, known: None, views: None }
    }
}

/// Longer side of the views in which disparity is searched.
const SIDE: usize = 640;

/// Views rendered side by side: each takes about 100 MiB at 1080×1080, however many threads there are.
const ABREAST: usize = 4;

/// Renders views of hexagonal samples at `target`, in order, each handed to `sink` as it is ready: the shape of
/// [`super::render`]. Linear light in and out.
///
/// # Errors
/// Samples that cannot be triangulated, options out of range, what the sink returns, interruption.
pub fn render<E: From<Error>>(
    samples: &HexSamples,
    target: &Target,
    options: &Options,
    sink: Sink<'_, E>,
    observer: &dyn Observer,
) -> Result<(), E> {
    let bundle = Bundle::hexagonal(samples, target)?;
    render_bundle(&bundle, options, sink, observer)
}

/// Renders views of a decoded light field, ours or another tool's, at `target`. Values in and out as in the light field.
///
/// # Errors
/// As [`render`].
pub fn render_light_field<E: From<Error>>(
    field: &LightField,
    target: &Target,
    options: &Options,
    sink: Sink<'_, E>,
    observer: &dyn Observer,
) -> Result<(), E> {
    let bundle = Bundle::rectangular(field, target)?;
    render_bundle(&bundle, options, sink, observer)
}

/// Renders views of any bundle of samples.
///
/// # Errors
/// As [`render`].
pub fn render_bundle<E: From<Error>>(
    bundle: &Bundle,
    options: &Options,
    sink: Sink<'_, E>,
    observer: &dyn Observer,
) -> Result<(), E> {
    let surfaces = Surfaces::estimate(bundle, options, observer)?;
    render_surfaces(bundle, &surfaces, options, sink, observer)
}

/// Renders with the disparities of every view known.
///
/// # Errors
/// Views that do not exist, what the sink returns, interruption.
pub fn render_surfaces<E: From<Error>>(
    bundle: &Bundle,
    surfaces: &Surfaces,
    options: &Options,
    sink: Sink<'_, E>,
    observer: &dyn Observer,
) -> Result<(), E> {
    let (rows, columns) = bundle.views();
    let all = || (0..rows).flat_map(|v| (0..columns).map(move |u| (v, u))).collect();
    let views: Vec<(usize, usize)> = options.views.clone().unwrap_or_else(all);
    ensure_shape!(views.iter().all(|&(v, u)| v < rows && u < columns), "there are only {rows}x{columns} views");
    observer.begin("multi-view refinement", views.len() as u64);
    for some in views.chunks(ABREAST.min(rayon::current_num_threads()).max(1)) {
        let images: Vec<Result<Array3<f32>, Error>> = some
            .par_iter()
            .map(|&at| {
                observer.check()?;
                match options.fit {
                    Fit::Smooth => fit::view(bundle, surfaces, at),
                    Fit::Triangulation => mesh::view(bundle, surfaces, at),
                }
            })
            .collect();
        for (&(v, u), image) in some.iter().zip(images) {
            sink(v, u, &image?)?;
            observer.advance(1);
        }
    }
    Ok(())
}
