//! The paper's four ways from hexagonal samples to views (section 4), side by side, and a stronger plain one.
//!
//! Every method has the same shape: prepare once for a lattice and a target size, then render view after view, in
//! linear light, into the caller's sink. Learned reconstruction comes on top of a rendered view ([`RenderOptions::base`]).

pub mod barycentric;
pub mod bicubic;
pub mod cubic;
pub mod encode;
pub mod learned;
pub mod multiview;

use std::fmt;
use std::str::FromStr;

use lenslet_core::decode::HexSamples;
use lenslet_core::progress::Observer;
use ndarray::{Array3, ArrayView2};

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

/// Size of the views, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Target {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Target {
    /// The longer side `side` pixels, scene pixels square.
    pub fn longer(sensor: (usize, usize), side: usize) -> Target {
        let longer = sensor.0.max(sensor.1).max(1) as f64;
        let scaled = |n: usize| ((n as f64 * side as f64 / longer).round() as usize).max(1);
        Target { width: scaled(sensor.0), height: scaled(sensor.1) }
    }

    /// About one value a lenslet: a pixel a pitch along the rows.
    pub fn native(samples: &HexSamples) -> Target {
        let pitch = pitch(samples).max(1.0);
        let longer = samples.sensor.0.max(samples.sensor.1) as f64;
        Target::longer(samples.sensor, (longer / pitch).round().max(1.0) as usize)
    }
}

/// Mean distance of neighbouring lenslets in sensor pixels, from how densely they lie.
pub fn pitch(samples: &HexSamples) -> f64 {
    let area = samples.sensor.0 as f64 * samples.sensor.1 as f64;
    (area / samples.centres.len().max(1) as f64 / (3f64.sqrt() / 2.0)).sqrt()
}

/// Options of [`render`].
#[derive(Debug, Clone, PartialEq)]
pub struct RenderOptions {
    /// What learned reconstruction starts from.
    pub base: Method,
    /// Dictionary of learned reconstruction; when absent the embedded one for views of `base`.
    pub dictionary: Option<lenslet_core::dictionary::Dictionary>,
    /// How learned reconstruction works.
    pub infer: crate::infer::Options,
}

impl Default for RenderOptions {
    fn default() -> Self {
        // Barycentric views are what the default dictionary was trained on.
        RenderOptions { base: Method::Barycentric, dictionary: None, infer: crate::infer::Options::default() }
    }
}

/// Where views go: (row v, column u, counted from 0; the view (t, s, c) in linear light).
pub type Sink<'a> = &'a mut dyn FnMut(usize, usize, &Array3<f32>) -> anyhow::Result<()>;

/// Renders every view of `samples` at `target` by `method`, in order, each handed to `sink` as it is ready.
///
/// # Errors
/// Samples that cannot be triangulated, a target out of range, what the sink returns, interruption.
pub fn render(
    samples: &HexSamples,
    target: &Target,
    method: Method,
    options: &RenderOptions,
    sink: Sink<'_>,
    observer: &dyn Observer,
) -> anyhow::Result<()> {
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
        Method::Learned => learned::render(samples, target, options, sink, observer),
    }
}

/// Runs a method that treats every view by itself.
fn each_view(
    samples: &HexSamples,
    sink: Sink<'_>,
    observer: &dyn Observer,
    view: &mut dyn FnMut(ArrayView2<'_, f32>) -> anyhow::Result<Array3<f32>>,
) -> anyhow::Result<()> {
    let n = samples.views;
    observer.begin("rendering views", (n * n) as u64);
    for (k, values) in samples.values.outer_iter().enumerate() {
        anyhow::ensure!(!observer.cancelled(), lenslet_core::decode::Error::Interrupted);
        sink(k / n, k % n, &view(values)?)?;
        observer.advance(1);
    }
    Ok(())
}
