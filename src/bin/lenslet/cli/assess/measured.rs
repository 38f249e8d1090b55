//! What the measures of the methods give on one capture.

use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::progress::Observer;
use lenslet_views::assess::{
    EdgeMeasures, Edges, HolesScore, LineMeasures, Lines, MiddleViews, RawScore, RayErrors, Rays, holes_score,
    keep_common_edges, keep_common_lines,
};
use lenslet_views::{Error, Method, RenderSamples};

/// Which measures are taken.
pub(super) struct Wanted<'a> {
    pub(super) rays: bool,
    pub(super) edges: bool,
    pub(super) lines: bool,
    pub(super) holes: bool,
    /// Lines given.
    pub(super) given: Option<&'a [Vec<[f64; 2]>]>,
}

impl Wanted<'_> {
    pub(super) fn any(&self) -> bool {
        self.rays || self.edges || self.lines || self.holes
    }
}

/// One method's measures.
pub(super) struct MethodMeasures {
    pub(super) name: &'static str,
    pub(super) rays: Option<RayErrors>,
    pub(super) edges: Option<EdgeMeasures>,
    pub(super) lines: Option<LineMeasures>,
    pub(super) holes: Option<HolesScore>,
}

/// What was measured on one capture.
pub(super) struct Assessment {
    pub(super) capture: String,
    pub(super) calibration: String,
    pub(super) size: Size,
    pub(super) methods: Vec<MethodMeasures>,
    /// Rays, edges and lines that all methods were measured on.
    pub(super) counts: [usize; 3],
    pub(super) raw: Vec<(String, RawScore)>,
}

impl Assessment {
    pub(super) fn new(capture: String, calibration: String, size: Size) -> Self {
        Assessment { capture, calibration, size, methods: Vec::new(), counts: [0; 3], raw: Vec::new() }
    }

    /// The method that others are compared with.
    pub(super) fn reference(&self) -> Option<&MethodMeasures> {
        self.methods.iter().find(|m| m.name == "barycentric")
    }
}

/// Takes the measures of the methods.
pub(super) fn measure_methods(
    samples: &HexSamples,
    size: &Size,
    methods: &[(&'static str, Method)],
    wanted: &Wanted,
    found: &mut Assessment,
    observer: &dyn Observer,
) -> Result<(), Error> {
    // Holes need neither rays nor the middle view.
    let middle_views = wanted.rays || wanted.edges || wanted.lines;
    let rays = if middle_views { Some(Rays::find(samples, size, observer)?) } else { None };
    let foretold = rays.as_ref().filter(|_| wanted.rays);
    let edges = rays.as_ref().filter(|_| wanted.edges).map(Edges::find);
    let lines = rays.as_ref().filter(|_| wanted.lines).map(|rays| match wanted.given {
        Some(given) => Lines::follow(rays, given),
        None => Lines::find(rays),
    });
    observer.begin("methods", methods.len() as u64);
    for (name, method) in methods {
        let middle = samples.views / 2;
        let render = |rays| MiddleViews::new(samples, rays, size).render(method, observer);
        let view = rays.as_ref().map(render).transpose()?;
        let holes = wanted.holes.then(|| {
            holes_score::<Error>(samples, size, &mut |rest| {
                let renderer = rest.renderer(method.clone()).size(*size).observer(observer).prepare()?;
                Ok(renderer.view(middle, middle)?.into_pixels())
            })
        });
        found.methods.push(MethodMeasures {
            name,
            rays: foretold.zip(view.as_ref()).map(|(r, view)| r.measure(view.withheld())).transpose()?,
            edges: edges.as_ref().zip(view.as_ref()).map(|(e, view)| e.measure(view.whole())),
            lines: lines.as_ref().zip(view.as_ref()).map(|(l, view)| l.measure(view.whole())),
            holes: holes.transpose()?,
        });
        observer.advance(1);
    }
    let common_edges = keep_common_edges(found.methods.iter_mut().filter_map(|m| m.edges.as_mut()));
    let common_lines = keep_common_lines(found.methods.iter_mut().filter_map(|m| m.lines.as_mut()));
    found.counts = [foretold.map_or(0, Rays::count), common_edges, common_lines];
    Ok(())
}
