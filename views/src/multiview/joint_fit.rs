//! The joint fit: the picture that the samples of all views determine, each the mean over its footprint.

use std::borrow::Cow;
use std::ops::Range;

use lenslet_core::geometry::Size;
use lenslet_core::image::{Cell, bilinear_by_differences};
use lenslet_core::progress::Observer;
use ndarray::Array3;

use super::joint_disparity::Corrections;
use super::local_light::{Light, equalise};
use super::rays::{LEAST_WEIGHT, OWN, carry_samples};
use super::sample_set::{Kind, SampleSet};
use super::trust::{Neighbours, Trust};
use super::view_disparities::{ViewDisparities, steps_between};
use super::view_models::{ViewModel, ViewRows, normalised, renew_models};
use crate::Error;
use crate::inverse::{
    Basis, Grid, Kernel, Problem, Row, SampleFootprint, SolveOptions, dispatched, encoding_slope, mean_contrast,
    sample_luminance, solve,
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

/// Steps of the solver each of these times and for views that begin with the middle one, and in the last solution, for each
/// pixel that the footprint reaches: wide footprints need more.
///
/// Source: chosen for the time they take; 6 and 12 at every width change scores by −0.24 to 0.08 dB.
const STEPS: [f64; 2] = [4.0, 6.5];

/// Error of the places of samples that lenslets gather, pixels: that of disparity, and what demosaicing does at edges.
///
/// Source: measured on simulated captures (natural, planes, occluders of seed 7): luminance of views is best at 0.16, 0.08, 0.16;
/// without it natural loses 1 dB, planes gain 0.1.
const PLACE_ERROR: f32 = 0.12;

/// [`SolveOptions::outlying`] once it is known what samples are worth, where they are worth 1 in the mean; towards the first
/// where they are worth half.
///
/// Source: chosen. 3 for all loses 0.2 dB on the KAIST field and where much is hidden; 6 for the second gains 0.6 dB on the
/// field of Jaramillo, and glass loses 1.2. The first at 2 gains 0.1 dB where much is hidden, and views of JPEG mosaics lose as
/// much.
const OUTLYING: [f32; 2] = [2.3, 4.0];

/// Samples of a view whose rows lie side by side with those of the same samples of the other views: what they add to stays in
/// the processor's cache.
///
/// Source: chosen for speed.
const TOGETHER: usize = 2048;

/// How far a surface of the middle view may lie beside another view's, pixels, to be taken for the same one.
///
/// Source: chosen.
const SAME_SURFACE: f32 = 1.0;

/// What all views share: the footprint's kernel, the slope of the encoding at each sample, the views' models.
pub(super) struct JointFit {
    kernel: Kernel,
    basis: Basis,
    slopes: Vec<f32>,
    models: Vec<ViewModel>,
    /// Steps of the solver while the views' light is found and for views beside the middle one; of its last solution.
    steps: [usize; 2],
    /// [`SolveOptions::place_error`]
    place_error: f32,
    /// From which the view's own samples can be told.
    neighbours: Neighbours,
    /// What the middle view has found for the others, where they begin with it.
    from_middle: Option<FromMiddle>,
}

/// A picture on a grid, one plane a channel.
type Planes = Vec<Vec<f32>>;

/// The middle view's picture, and all samples as it would have them.
struct FromMiddle {
    picture: Planes,
    /// The samples' values in the light of the middle view.
    equal: Vec<[f32; 4]>,
}

/// Where samples lie in a view, and whose they are.
struct Placed {
    rows: Vec<Row>,
    parts: Vec<ViewRows>,
}

impl Placed {
    /// Sets the weight of the view's `own` samples.
    fn set_own(&mut self, own: &Range<u32>, weight: f32) {
        for row in self.rows.iter_mut().filter(|row| own.contains(&row.sample)) {
            row.weight = weight;
        }
    }

    /// [`SolveOptions::outlying`] by what the samples are worth in the mean.
    fn outlying(&self) -> [f32; 2] {
        let sum: f64 = self.rows.iter().map(|row| f64::from(row.weight)).sum();
        let mean = (sum / self.rows.len().max(1) as f64) as f32;
        let [least, most] = OUTLYING;
        [least, least + (most - least) * (2.0 * mean - 1.0).max(0.0)]
    }

    /// Weighs the samples of the other views, all but `own`.
    fn weigh_others(&mut self, own: &Range<u32>, trust: &Trust) {
        trust.weigh(self.rows.iter_mut().filter(|row| !own.contains(&row.sample)));
    }
}

impl JointFit {
    pub(super) fn new(set: &SampleSet, footprint: &SampleFootprint) -> Self {
        let slopes = match set.kind {
            Kind::Encoded => Vec::new(),
            Kind::Linear => {
                let channels = set.channels();
                set.lanes.iter().map(|value| encoding_slope(sample_luminance(value, channels))).collect()
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
            place_error: if matches!(set.kind, Kind::Linear) { PLACE_ERROR } else { 0.0 },
            neighbours: Neighbours::of(&set.points, set.pitch),
            from_middle: None,
        }
    }

    /// Where every sample of every view lies in the view `at`, and its weight there.
    fn place(&self, set: &SampleSet, disparities: &ViewDisparities, at: (usize, usize), grid: &Grid) -> Placed {
        dispatched(|| self.place_all(set, disparities, at, grid))
    }

    #[inline(always)]
    fn place_all(&self, set: &SampleSet, disparities: &ViewDisparities, at: (usize, usize), grid: &Grid) -> Placed {
        let views = set.views();
        let (n, count) = (set.points.len(), views.0 * views.1);
        let target = at.0 * views.1 + at.1;
        let reach = self.kernel.radius() as f32;
        let mut rows = Vec::with_capacity(n * count);
        let lit = (0..count).filter(|&k| !set.is_dark(k));
        let mut parts: Vec<ViewRows> = lit.map(|view| ViewRows { view, ranges: Vec::new() }).collect();
        let here = &self.models[target];
        for first in (0..n).step_by(TOGETHER) {
            let some = first..(first + TOGETHER).min(n);
            for part in &mut parts {
                let (k, before) = (part.view, rows.len());
                if k == target {
                    let own = set.points[some.clone()].iter().enumerate();
                    let sample = |i: usize| k * n + first + i;
                    rows.extend(own.filter_map(|(i, p)| grid.row(p[0], p[1], reach, OWN, sample(i))));
                } else {
                    let model = &self.models[k];
                    let shifted = model.is_shifted() || here.is_shifted();
                    carry_samples(set, disparities, some.clone(), [k, target], |carried| {
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
                part.ranges.push(before..rows.len());
            }
        }
        Placed { rows, parts }
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
        values: &'a [[f32; 4]],
        contrast: &'a [f32],
        at: (usize, usize),
        grid: &Grid,
    ) -> Problem<'a> {
        Problem {
            grid: *grid,
            kernel: &self.kernel,
            rows: &placed.rows,
            values,
            channels: set.channels(),
            slopes: &self.slopes,
            contrast,
            own: own_samples(set, at.0 * set.views().1 + at.1),
        }
    }

    /// Lets the other views begin with the middle one's picture, in its light. It makes them three times as fast. Views of
    /// captures do, which are many and large; those of light fields are each solved afresh, which is up to 0.9 dB
    /// better where views have few samples.
    pub(super) fn begin_with_middle(
        &mut self,
        set: &SampleSet,
        disparities: &ViewDisparities,
        picture: Option<Planes>,
    ) -> Result<(), Error> {
        if matches!(set.kind, Kind::Linear) {
            let views = set.views();
            let at = (views.0 / 2, views.1 / 2);
            let alone = set.single(at.0, at.1)?;
            let (h, w, _) = alone.dim();
            if w >= 2 && h >= 2 {
                let grid = self.grid(w, h);
                let blurred = extended(&alone, &grid);
                let contrast = mean_contrast(&blurred, grid.width, true);
                let start = picture.unwrap_or_else(|| blurred.clone());
                let (picture, equal) = self.solve_afresh(set, disparities, at, &grid, &contrast, &blurred, start);
                self.from_middle = Some(FromMiddle { picture, equal: equal.into_owned() });
            }
        }
        Ok(())
    }

    /// The picture of the view `at` on the grid, solved from `start`, and all samples in this view's light.
    #[allow(clippy::too_many_arguments)] // where it begins, and what it falls back to
    fn solve_afresh<'a>(
        &self,
        set: &'a SampleSet,
        disparities: &ViewDisparities,
        at: (usize, usize),
        grid: &Grid,
        contrast: &[f32],
        alone: &Planes,
        start: Planes,
    ) -> (Planes, Cow<'a, [[f32; 4]]>) {
        let target = at.0 * set.views().1 + at.1;
        let mut placed = self.place(set, disparities, at, grid);
        let own = own_samples(set, target);
        let mut values = self.values_as_in(set, target);
        // The first picture is that of the other views alone, which is to foretell the view's own samples.
        placed.set_own(&own, 0.0);
        let problem = self.problem(set, &placed, &values, contrast, at, grid);
        let mut solution = solve(&problem, start, &self.one_solution(self.steps[1]));
        let trust = Trust::new(&problem, &solution.smooth, &self.neighbours, set.pitch);
        placed.weigh_others(&own, &trust);
        placed.set_own(&own, OWN);
        solution.planes = trust.mixed(alone.clone(), &solution.planes);
        let outlying = placed.outlying();
        let settled = |steps| SolveOptions { outlying, ..self.one_solution(steps) };
        for round in 0..LIGHT_ROUNDS {
            let problem = self.problem(set, &placed, &values, contrast, at, grid);
            if round > 0 {
                solution = solve(&problem, solution.planes, &settled(self.steps[0]));
            }
            let mut equal = values.clone().into_owned();
            equalise(&mut equal, &problem, &solution, &placed.parts, target, set.pitch);
            values = Cow::Owned(equal);
        }
        let problem = self.problem(set, &placed, &values, contrast, at, grid);
        let planes = solve(&problem, solution.planes, &settled(self.steps[1])).planes;
        (planes, values)
    }

    /// Weights taken once, `steps` of conjugate gradients.
    fn one_solution(&self, steps: usize) -> SolveOptions {
        SolveOptions { reweightings: 0, steps, place_error: self.place_error, ..SolveOptions::default() }
    }

    fn grid(&self, width: usize, height: usize) -> Grid {
        Grid::around(Size::new(width, height), self.kernel.radius() + 3, self.basis)
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
        let views = set.views();
        let target = at.0 * views.1 + at.1;
        let grid = self.grid(w, h);
        let m = grid.margin;
        let picture =
            |planes: &[Vec<f32>]| Array3::from_shape_fn((h, w, c), |(t, s, l)| planes[l][(t + m) * grid.width + s + m]);
        let planes = extended(&alone, &grid);
        let contrast = mean_contrast(&planes, grid.width, !self.slopes.is_empty());
        let Some(middle) = &self.from_middle else {
            let start = planes.clone();
            return Ok(picture(&self.solve_afresh(set, disparities, at, &grid, &contrast, &planes, start).0));
        };
        if at == (views.0 / 2, views.1 / 2) {
            return Ok(picture(&middle.picture));
        }
        let mut placed = self.place(set, disparities, at, &grid);
        let own = own_samples(set, target);
        let carried = dispatched(|| self.carried_middle(&middle.picture, disparities, target, &grid, planes.clone()));
        let problem = self.problem(set, &placed, &middle.equal, &contrast, at, &grid);
        let smooth = self.kernel.smooth(&carried, grid.width);
        let trust = Trust::new(&problem, &smooth, &self.neighbours, set.pitch);
        let start = trust.mixed(planes, &carried);
        placed.weigh_others(&own, &trust);
        let problem = self.problem(set, &placed, &middle.equal, &contrast, at, &grid);
        let options = SolveOptions { outlying: placed.outlying(), ..self.one_solution(self.steps[0]) };
        let mut picture = picture(&solve(&problem, start, &options).planes);
        dispatched(|| self.return_light(set, &middle.equal, target, &mut picture));
        Ok(picture)
    }

    /// The middle view's picture as the view `target` sees it; where its surfaces are hidden there, `alone`.
    #[inline(always)]
    fn carried_middle(
        &self,
        picture: &[Vec<f32>],
        disparities: &ViewDisparities,
        target: usize,
        grid: &Grid,
        mut alone: Planes,
    ) -> Planes {
        let views = (disparities.rows, disparities.columns);
        let middle = (views.0 / 2) * views.1 + views.1 / 2;
        let [du, dv] = steps_between(views, target, middle);
        let steps = du.abs().max(dv.abs());
        let m = grid.margin as f32;
        let here = &self.models[target];
        let size = Size::new(grid.width, grid.height);
        for t in 0..grid.height {
            for s in 0..grid.width {
                let (x, y) = (s as f32 - m, t as f32 - m);
                let d = disparities.at(target, x, y);
                let [sx, sy] = if here.is_shifted() {
                    let [px, py] = normalised(grid, (x, y));
                    here.shift_at(px, py)
                } else {
                    [0.0; 2]
                };
                let (mx, my) = (x + sx - d * du, y + sy - d * dv);
                let inside = |place: f32, side: usize| place + m > 0.0 && place + m < (side - 1) as f32;
                let beside = (disparities.near(middle, mx.max(0.0), my.max(0.0)) - d) * steps;
                if !(inside(mx, size.width) && inside(my, size.height) && beside.abs() <= SAME_SURFACE) {
                    continue;
                }
                let cell = Cell::clamped(mx + m, my + m, size);
                for (plane, middle) in alone.iter_mut().zip(picture) {
                    let corners = cell.corners(|x, y| middle[y * grid.width + x]);
                    plane[t * grid.width + s] = bilinear_by_differences(corners, cell.fx, cell.fy);
                }
            }
        }
        alone
    }

    /// Gives a picture in the middle view's light that of the view `target`.
    #[inline(always)]
    fn return_light(&self, set: &SampleSet, equal: &[[f32; 4]], target: usize, picture: &mut Array3<f32>) {
        let (h, w, c) = picture.dim();
        let n = set.points.len();
        let here = &self.models[target];
        let first = target * n;
        let own = set.points.iter().enumerate().map(|(i, p)| {
            let (there, equal) = (&set.lanes[first + i], &equal[first + i]);
            let difference = std::array::from_fn(|l| (there[l] - here.offset) / here.gain - equal[l]);
            (*p, difference)
        });
        let light = Light::of_values(own, Size::new(w, h), set.pitch);
        for t in 0..h {
            for s in 0..w {
                let more = light.at_pixel(s, t);
                for l in 0..c {
                    let value = &mut picture[[t, s, l]];
                    *value = here.gain * (*value + more[l]) + here.offset;
                }
            }
        }
    }

    /// Refines the middle view's disparity (unless it is known) and the views' models, in turns with its picture, which is
    /// returned on its grid; none of a picture too small, or of a single view.
    ///
    /// # Errors
    /// Interruption; samples that cannot be interpolated.
    pub(super) fn refine_disparities(
        &mut self,
        set: &SampleSet,
        disparities: &mut ViewDisparities,
        unknown: bool,
        observer: &dyn Observer,
    ) -> Result<Option<Planes>, Error> {
        let views = set.views();
        let at = (views.0 / 2, views.1 / 2);
        let target = at.0 * views.1 + at.1;
        let alone = set.single(at.0, at.1)?;
        let (h, w, _) = alone.dim();
        if w < 8 || h < 8 || views.0 * views.1 < 2 {
            return Ok(None);
        }
        let grid = self.grid(w, h);
        let offsets: Vec<[f32; 2]> = (0..views.0 * views.1).map(|k| steps_between(views, k, target)).collect();
        let reach = offsets.iter().fold(1f32, |m, o| m.max(o[0].abs()).max(o[1].abs()));
        let n = set.points.len();
        let mut planes = extended(&alone, &grid);
        let contrast = mean_contrast(&planes, grid.width, !self.slopes.is_empty());
        for round in 0..MOST_ROUNDS {
            observer.check()?;
            let (reweightings, steps) = WHILE_REFINING[round.min(1)];
            let options = SolveOptions { reweightings, ..self.one_solution(steps) };
            let placed = self.place(set, disparities, at, &grid);
            let values = self.values_as_in(set, target);
            let problem = self.problem(set, &placed, &values, &contrast, at, &grid);
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
        Ok(Some(planes))
    }
}

/// A picture (t, s, c) as one plane a channel on the grid, its border repeated in the margins.
fn extended(picture: &Array3<f32>, grid: &Grid) -> Planes {
    let (h, w, c) = picture.dim();
    let inner = |k: usize, side: usize| k.saturating_sub(grid.margin).min(side - 1);
    let plane = |l: usize| {
        let pixel = |k: usize| picture[[inner(k / grid.width, h), inner(k % grid.width, w), l]];
        (0..grid.pixels()).map(pixel).collect()
    };
    (0..c).map(plane).collect()
}

/// The samples of the view `target`.
fn own_samples(set: &SampleSet, target: usize) -> Range<u32> {
    let n = set.points.len();
    (target * n) as u32..((target + 1) * n) as u32
}
