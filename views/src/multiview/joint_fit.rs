//! The joint fit: the picture that the samples of all views determine, each the mean over its footprint.

use std::borrow::Cow;

use lenslet_core::colour::LUMINANCE_OF_LINEAR;
use lenslet_core::geometry::Size;
use lenslet_core::progress::Observer;
use ndarray::Array3;

use super::joint_disparity::Corrections;
use super::local_light::equalise;
use super::rays::{LEAST_WEIGHT, OWN, carry_samples};
use super::sample_set::{Kind, SampleSet};
use super::view_disparities::{ViewDisparities, steps_between};
use super::view_models::{ViewModel, ViewRows, normalised, renew_models};
use crate::Error;
use crate::inverse::{
    Basis, Grid, Kernel, Problem, Row, SampleFootprint, SolveOptions, encoding_slope, mean_contrast, solve,
};

/// Rounds in which disparity and the views' models are refined.
///
/// Source: chosen; later rounds change scores by less than 0.1 dB.
const ROUNDS: usize = 5;

/// Rounds at most, as long as models of views still change.
///
/// Source: chosen.
const MOST_ROUNDS: usize = 12;

/// Round from which the views' models are renewed: their disparity comes first.
///
/// Source: chosen.
const MODELS_FROM: usize = 2;

/// Reweightings and steps of the solver in the first of these rounds, and in those that go on from the one before.
///
/// Source: chosen.
const WHILE_REFINING: [(usize, usize); 2] = [(1, 12), (0, 8)];

/// Times the light in which views differ is found before the last solution of a view.
///
/// Source: chosen; further ones change scores by less than 0.05 dB.
const LIGHT_ROUNDS: usize = 2;

/// Steps of the solver each of these times, and in the last solution, for each pixel that the footprint reaches: wide
/// footprints need more.
///
/// Source: chosen for the time they take; 6 and 12 at every width change scores by −0.24 to 0.08 dB.
const STEPS: [f64; 2] = [4.0, 6.5];

/// What all views share: the footprint's kernel, the slope of the encoding at each sample, the views' models.
pub(super) struct JointFit {
    kernel: Kernel,
    basis: Basis,
    slopes: Vec<f32>,
    models: Vec<ViewModel>,
    /// Steps of the solver while the views' light is found, and after.
    steps: [usize; 2],
}

/// A view's problem before it is put together: where samples lie, whose they are, their values as this view would have
/// them.
struct Placed<'a> {
    rows: Vec<Row>,
    parts: Vec<ViewRows>,
    values: Cow<'a, [[f32; 4]]>,
}

impl JointFit {
    pub(super) fn new(set: &SampleSet, footprint: &SampleFootprint) -> Self {
        let slopes = match set.kind {
            Kind::Encoded => Vec::new(),
            Kind::Linear => {
                let grey = set.channels() == 1;
                let light = |f: &[f32; 4]| {
                    if grey { f[0] } else { (0..3).map(|c| LUMINANCE_OF_LINEAR[c] * f[c]).sum() }
                };
                set.lanes.iter().map(|f| encoding_slope(light(f))).collect()
            }
        };
        let basis = Basis::for_footprint(footprint);
        let (rows, columns) = set.views();
        JointFit {
            kernel: Kernel::of_footprint(footprint, basis),
            basis,
            slopes,
            models: vec![ViewModel::SAME; rows * columns],
            steps: STEPS.map(|steps| (steps * footprint.reach().max(1.0)) as usize),
        }
    }

    /// Where every sample of every view lies in the view `at`, and its weight there.
    fn place<'a>(
        &self,
        set: &'a SampleSet,
        disparities: &ViewDisparities,
        at: (usize, usize),
        grid: &Grid,
    ) -> Placed<'a> {
        let views = set.views();
        let target = at.0 * views.1 + at.1;
        let reach = self.kernel.radius() as f32;
        let mut rows = Vec::with_capacity(set.points.len() * views.0 * views.1);
        let mut parts = Vec::with_capacity(views.0 * views.1);
        let here = &self.models[target];
        for k in (0..views.0 * views.1).filter(|&k| !set.is_dark(k)) {
            let first = rows.len();
            if k == target {
                let own = set.points.iter().enumerate();
                let sample = |i: usize| k * set.points.len() + i;
                rows.extend(own.filter_map(|(i, p)| grid.row(p[0], p[1], reach, OWN, sample(i))));
            } else {
                let model = &self.models[k];
                let shifted = model.is_shifted() || here.is_shifted();
                carry_samples(set, disparities, k, target, |carried| {
                    let (mut x, mut y) = carried.place;
                    if shifted {
                        let [px, py] = normalised(grid, (x, y));
                        let (a, b) = (model.shift_at(px, py), here.shift_at(px, py));
                        (x, y) = (x + a[0] - b[0], y + a[1] - b[1]);
                    }
                    let weight = carried.weight_at(disparities, target, (x, y)) * model.worth;
                    if weight >= LEAST_WEIGHT {
                        rows.extend(grid.row(x, y, reach, weight, carried.sample));
                    }
                });
            }
            parts.push(ViewRows { view: k, rows: first..rows.len() });
        }
        Placed { rows, parts, values: self.values_as_in(set, target) }
    }

    /// The samples' values as the view `target` would have them.
    fn values_as_in<'a>(&self, set: &'a SampleSet, target: usize) -> Cow<'a, [[f32; 4]]> {
        let same = |m: &ViewModel| m.gain == 1.0 && m.offset == 0.0;
        if self.models.iter().all(same) {
            return Cow::Borrowed(&set.lanes);
        }
        let here = self.models[target];
        let mut values = set.lanes.clone();
        for (model, values) in self.models.iter().zip(values.chunks_exact_mut(set.points.len())) {
            let gain = here.gain / model.gain;
            let offset = here.offset - gain * model.offset;
            for v in values.iter_mut().flat_map(|v| v.iter_mut().take(set.channels())) {
                *v = gain * *v + offset;
            }
        }
        Cow::Owned(values)
    }

    fn problem<'a>(
        &'a self,
        set: &SampleSet,
        placed: &'a Placed,
        contrast: &'a [f32],
        at: (usize, usize),
        grid: &Grid,
    ) -> Problem<'a> {
        let n = set.points.len() as u32;
        let first = (at.0 * set.views().1 + at.1) as u32 * n;
        Problem {
            grid: *grid,
            kernel: &self.kernel,
            rows: &placed.rows,
            values: &placed.values,
            channels: set.channels(),
            slopes: &self.slopes,
            contrast,
            own: first..first + n,
        }
    }

    /// Renders the view `at` (row, column).
    pub(super) fn render_view(
        &self,
        set: &SampleSet,
        disparities: &ViewDisparities,
        at: (usize, usize),
    ) -> Result<Array3<f32>, Error> {
        let alone = set.single(at.0, at.1)?;
        let (h, w, c) = alone.dim();
        if w < 2 || h < 2 {
            return Ok(alone);
        }
        let grid = Grid::around(Size::new(w, h), self.kernel.radius() + 3, self.basis);
        let mut placed = self.place(set, disparities, at, &grid);
        let mut planes = extended(&alone, &grid);
        let contrast = mean_contrast(&planes, grid.width, !self.slopes.is_empty());
        let target = at.0 * set.views().1 + at.1;
        for _ in 0..LIGHT_ROUNDS {
            let problem = self.problem(set, &placed, &contrast, at, &grid);
            let solution = solve(&problem, planes, &one_solution(self.steps[0]));
            let mut values = placed.values.clone().into_owned();
            equalise(&mut values, &problem, &solution, &placed.parts, target, set.pitch);
            planes = solution.planes;
            placed.values = Cow::Owned(values);
        }
        planes = solve(&self.problem(set, &placed, &contrast, at, &grid), planes, &one_solution(self.steps[1])).planes;
        let m = grid.margin;
        Ok(Array3::from_shape_fn((h, w, c), |(t, s, l)| planes[l][(t + m) * grid.width + s + m]))
    }

    /// Refines the middle view's disparity (unless it is known) and the views' models, in turns with its picture.
    ///
    /// # Errors
    /// Interruption; samples that cannot be interpolated.
    pub(super) fn refine_disparities(
        &mut self,
        set: &SampleSet,
        disparities: &mut ViewDisparities,
        unknown: bool,
        observer: &dyn Observer,
    ) -> Result<(), Error> {
        let views = set.views();
        let at = (views.0 / 2, views.1 / 2);
        let target = at.0 * views.1 + at.1;
        let alone = set.single(at.0, at.1)?;
        let (h, w, _) = alone.dim();
        if w < 8 || h < 8 || views.0 * views.1 < 2 {
            return Ok(());
        }
        let grid = Grid::around(Size::new(w, h), self.kernel.radius() + 3, self.basis);
        let offsets: Vec<[f32; 2]> = (0..views.0 * views.1).map(|k| steps_between(views, k, target)).collect();
        let reach = offsets.iter().fold(1f32, |m, o| m.max(o[0].abs()).max(o[1].abs()));
        let n = set.points.len();
        let mut planes = extended(&alone, &grid);
        let contrast = mean_contrast(&planes, grid.width, !self.slopes.is_empty());
        for round in 0..MOST_ROUNDS {
            observer.check()?;
            let (reweightings, steps) = WHILE_REFINING[round.min(1)];
            let options = SolveOptions { reweightings, steps, ..SolveOptions::default() };
            let placed = self.place(set, disparities, at, &grid);
            let problem = self.problem(set, &placed, &contrast, at, &grid);
            let solution = solve(&problem, planes, &options);
            let mut models = self.models.clone();
            let mut changed = 0;
            if round >= MODELS_FROM {
                changed = renew_models(&mut models, &problem, &solution, &placed.parts, target);
            }
            if unknown {
                let mut central = disparities.maps[target].clone();
                let mut corrections = Corrections::new(&central);
                corrections.add(&problem, &solution, |sample| offsets[sample as usize / n], disparities.scale);
                corrections.apply(&mut central, reach, solution.residual);
                disparities.carry_from_middle(central);
                disparities.look_up_samples(&set.points);
            }
            planes = solution.planes;
            self.models = models;
            if round + 1 >= ROUNDS && changed == 0 {
                break;
            }
        }
        Ok(())
    }
}

/// Weights taken once, `steps` of conjugate gradients.
fn one_solution(steps: usize) -> SolveOptions {
    SolveOptions { reweightings: 0, steps, ..SolveOptions::default() }
}

/// A picture (t, s, c) as one plane a channel on the grid, its border repeated in the margins.
fn extended(picture: &Array3<f32>, grid: &Grid) -> Vec<Vec<f32>> {
    let (h, w, c) = picture.dim();
    let inner = |k: usize, side: usize| k.saturating_sub(grid.margin).min(side - 1);
    let plane = |l: usize| {
        let pixel = |k: usize| picture[[inner(k / grid.width, h), inner(k % grid.width, w), l]];
        (0..grid.pixels()).map(pixel).collect()
    };
    (0..c).map(plane).collect()
}
