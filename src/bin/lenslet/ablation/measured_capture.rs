//! Measures of a real capture without a ground truth, what they share kept while runs need it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Result;
use lenslet_core::calibration::Calibration;
use lenslet_core::container::Capture;
use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::progress::Observer;
use lenslet_views::assess::{Edges, Lines, MiddleViews, RayErrors, Rays, compare_calibrations, holes_score};
use lenslet_views::multiview::Fit;
use ndarray::Array3;

/// Scores by name.
type Scores = BTreeMap<String, f64>;

/// Name of the steps to refined views without the samples that rays foretell.
pub(super) const WITHHELD: &str = "withheld";

/// Name of the steps to samples with filled holes.
const HOLES: &str = "holes";

/// What was measured of the last capture.
#[derive(Default)]
pub(super) struct MeasuredCapture {
    methods: Option<(PathBuf, MethodMeasures)>,
    calibrations: Option<(PathBuf, Vec<Scores>)>,
}

impl MeasuredCapture {
    /// The measures of the calibrations, which are compared with the first.
    pub(super) fn calibration_scores(
        &mut self,
        path: &Path,
        capture: &Capture,
        calibrations: &[&Calibration],
        longer: usize,
        observer: &dyn Observer,
    ) -> Result<&[Scores]> {
        let found = match self.calibrations.take().filter(|(p, _)| p == path) {
            Some(found) => found,
            None => {
                let scores = compare_calibrations(capture, calibrations, longer, observer)?;
                let one = |s: lenslet_views::assess::RawScore| {
                    let named = [("raw_rms", s.rms), ("raw_over", s.over.mean), ("raw_over_error", s.over.error)];
                    named.map(|(name, x)| (name.to_owned(), x)).into()
                };
                (path.to_owned(), scores.into_iter().map(one).collect())
            }
        };
        Ok(&self.calibrations.insert(found).1)
    }

    /// What methods are measured on.
    pub(super) fn method_measures(
        &mut self,
        path: &Path,
        samples: &HexSamples,
        size: &Size,
        observer: &dyn Observer,
    ) -> Result<&MethodMeasures> {
        let found = match self.methods.take().filter(|(p, _)| p == path) {
            Some(found) => found,
            None => (path.to_owned(), MethodMeasures::prepare(samples, size, observer)?),
        };
        Ok(&self.methods.insert(found).1)
    }
}

/// Rays, edges and lines of one capture.
pub(super) struct MethodMeasures {
    size: Size,
    rays: Rays,
    edges: Edges,
    lines: Lines,
    barycentric: RayErrors,
}

impl MethodMeasures {
    fn prepare(samples: &HexSamples, size: &Size, observer: &dyn Observer) -> Result<MethodMeasures> {
        let rays = Rays::find(samples, size, observer)?;
        let (edges, lines) = (Edges::find(&rays), Lines::find(&rays));
        let barycentric = rays.measure(rays.barycentric())?;
        Ok(MethodMeasures { size: *size, rays, edges, lines, barycentric })
    }

    /// The middle view refined by this fit, without the samples that are foretold.
    pub(super) fn refined_withheld(
        &self,
        samples: &HexSamples,
        fit: Fit,
        observer: &dyn Observer,
    ) -> Result<Array3<f32>> {
        Ok(MiddleViews::new(samples, &self.rays, &self.size).refined_withheld(fit, observer)?)
    }

    /// Measures the middle view `image` of one method; `again` renders it after other steps, given their name and the samples.
    pub(super) fn scores_of(
        &self,
        samples: &HexSamples,
        image: &Array3<f32>,
        uses_other_views: bool,
        again: &mut dyn FnMut(&str, &HexSamples) -> Result<Array3<f32>>,
    ) -> Result<Scores> {
        let mut scores = Scores::new();
        let mut put = |name: &str, value: f64| {
            scores.insert(name.to_owned(), value);
        };
        let withheld = if uses_other_views { Some(again(WITHHELD, samples)?) } else { None };
        let rays = self.rays.measure(withheld.as_ref().unwrap_or(image).view())?;
        let over = rays.over(&self.barycentric);
        put("rays_psnr", rays.psnr());
        put("rays_over", over.mean);
        put("rays_over_error", over.error);
        let edges = self.edges.measure(image.view());
        if let (Some(mtf50), Some(rough)) = (edges.median_mtf50(), edges.median_rough()) {
            put("edges_mtf50", mtf50.median);
            put("edges_rough", rough.median);
        }
        if let Some([rough, width, _]) = self.lines.measure(image.view()).medians() {
            put("lines_rough", rough.median);
            put("lines_width", width.median);
        }
        let holes = holes_score(samples, &self.size, &mut |rest| again(HOLES, rest))?;
        put("holes_psnr", holes.psnr);
        Ok(scores)
    }
}
