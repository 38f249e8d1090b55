//! How views differ from warps of one picture, found from what the picture leaves of each view's samples: gain and offset
//! of its values, a smooth shift of its samples, and how well its samples are explained at all.

use std::ops::Range;

use lenslet_core::linalg::gauss_with_back_substitution;

use crate::inverse::{Grid, Predicted, Problem, Row, Solution, quantile};

/// Least share by which a model must lessen a view's usual residual to be believed.
///
/// Source: chosen; a view that fits already gains a few per cent from any model.
const GAIN: f32 = 0.1;

/// The same for a view that has a model already.
///
/// Source: chosen.
const FURTHER_GAIN: f32 = 0.01;

/// Samples of a view from which a model can be found.
///
/// Source: chosen, ten for each of its numbers and some.
const LEAST_SAMPLES: usize = 200;

/// Largest shift of a view's samples, pixels of the target.
///
/// Source: chosen.
const LARGEST_SHIFT: f32 = 3.0;

/// Share of the usual residual of the best views up to which a view has its full weight.
///
/// Source: chosen.
const AS_GOOD: f32 = 1.5;

/// Terms of the shift field: 1, x, y, x², xy, y², with x and y from −1 to 1 over the view.
const TERMS: usize = 6;

/// How a view's samples follow from the picture: y = gain · (picture at the place + shift) + offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ViewModel {
    pub(super) gain: f32,
    pub(super) offset: f32,
    /// Coefficients of the shift along x and y, pixels of the target.
    shift: [[f32; TERMS]; 2],
    /// Factor of the samples' weight, 0 to 1.
    pub(super) worth: f32,
}

impl ViewModel {
    /// A view that differs in nothing.
    pub(super) const SAME: ViewModel = ViewModel { gain: 1.0, offset: 0.0, shift: [[0.0; TERMS]; 2], worth: 1.0 };

    /// Shift at (`x`, `y`), each −1 to 1 over the view.
    #[inline]
    pub(super) fn shift_at(&self, x: f32, y: f32) -> [f32; 2] {
        let terms = terms(x, y);
        self.shift.map(|c| {
            let sum: f32 = c.iter().zip(terms).map(|(c, t)| c * t).sum();
            sum.clamp(-LARGEST_SHIFT, LARGEST_SHIFT)
        })
    }

    /// Whether the view differs in nothing but its worth.
    fn is_plain(&self) -> bool {
        self.gain == 1.0 && self.offset == 0.0 && !self.is_shifted()
    }

    pub(super) fn is_shifted(&self) -> bool {
        self.shift.iter().flatten().any(|&c| c != 0.0)
    }
}

#[inline]
fn terms(x: f32, y: f32) -> [f32; TERMS] {
    [1.0, x, y, x * x, x * y, y * y]
}

/// One view's part of the rows of a problem.
pub(super) struct ViewRows {
    pub(super) view: usize,
    pub(super) ranges: Vec<Range<usize>>,
}

impl ViewRows {
    /// How many they are.
    pub(super) fn len(&self) -> usize {
        self.ranges.iter().map(Range::len).sum()
    }

    /// Those of all rows that are the view's.
    pub(super) fn of<'a>(&self, rows: &'a [Row]) -> impl Iterator<Item = &'a Row> {
        self.ranges.iter().flat_map(|range| &rows[range.clone()])
    }
}

/// Renews the models of the views from what the picture leaves of their samples; the values of `problem` are corrected
/// by the models so far. The view `middle` stays as it is. Returns how many models changed.
pub(super) fn renew_models(
    models: &mut [ViewModel],
    problem: &Problem<'_>,
    solution: &Solution,
    parts: &[ViewRows],
    middle: usize,
) -> usize {
    let mut changed = 0;
    let mut usual = vec![f32::INFINITY; models.len()];
    for part in parts.iter().filter(|p| p.view != middle && p.len() >= LEAST_SAMPLES) {
        let Some(fit) = fitted(problem, solution, part) else { continue };
        usual[part.view] = fit.before;
        let least = if models[part.view].is_plain() { GAIN } else { FURTHER_GAIN };
        if fit.after < (1.0 - least) * fit.before {
            changed += 1;
            usual[part.view] = fit.after;
            let model = &mut models[part.view];
            // The correction y' = (y − offset)/gain, followed by the one found on y'.
            model.offset += model.gain * fit.offset;
            model.gain = (model.gain * fit.gain).clamp(0.4, 2.5);
            for (sum, more) in model.shift.iter_mut().flatten().zip(fit.shift.iter().flatten()) {
                *sum += more;
            }
        }
    }
    let mut known: Vec<f32> = usual.iter().copied().filter(|u| u.is_finite()).collect();
    known.sort_unstable_by(f32::total_cmp);
    let Some(&best) = known.get(known.len() / 10) else { return changed };
    for (model, usual) in models.iter_mut().zip(usual) {
        model.worth =
            if usual.is_finite() { (AS_GOOD * best.max(1e-3) / usual.max(1e-6)).powi(2).min(1.0) } else { 1.0 };
    }
    changed
}

struct Fitted {
    gain: f32,
    offset: f32,
    shift: [[f32; TERMS]; 2],
    /// Usual residual before and after.
    before: f32,
    after: f32,
}

/// Gain, offset and shift of one view by weighted least squares, one Gauss–Newton step.
fn fitted(problem: &Problem<'_>, solution: &Solution, part: &ViewRows) -> Option<Fitted> {
    const N: usize = 2 + 2 * TERMS;
    let rows = || part.of(problem.rows);
    let predicted: Vec<Predicted> = rows().map(|row| problem.predicted(row, &solution.smooth)).collect();
    let before = quantile(predicted.iter().map(Predicted::residual), 0.5)?;
    let robust = (1.0 / (3.0 * before.max(1e-3))).powi(2);
    let mut system = vec![0f64; N * (N + 1)];
    let design = |p: &Predicted, place: [f32; 2]| -> [f32; N] {
        let t = terms(place[0], place[1]);
        let mut d = [0f32; N];
        d[0] = p.here;
        d[1] = 1.0;
        for k in 0..TERMS {
            d[2 + k] = p.gx * t[k];
            d[2 + TERMS + k] = p.gy * t[k];
        }
        d
    };
    for (row, p) in rows().zip(&predicted) {
        let r = p.residual();
        let weight = f64::from(row.weight * p.slope * p.slope / (1.0 + r * r * robust));
        let place = normalised(&problem.grid, problem.grid.place(row));
        let d = design(p, place);
        let left = f64::from(p.value - p.here);
        for i in 0..N {
            let w = weight * f64::from(d[i]);
            let line = &mut system[i * (N + 1)..(i + 1) * (N + 1)];
            for (entry, other) in line.iter_mut().zip(d) {
                *entry += w * f64::from(other);
            }
            line[N] += w * left;
        }
    }
    let trace = |from: usize, to: usize| (from..to).map(|i| system[i * (N + 2)]).sum::<f64>() / (to - from) as f64;
    let (values, shifts) = (1e-4 * trace(0, 2), 1e-3 * trace(2, N));
    for i in 0..N {
        system[i * (N + 2)] += if i < 2 { values } else { shifts } + 1e-12;
    }
    gauss_with_back_substitution(&mut system, N, N + 1, 1e-300)?;
    let x: Vec<f32> = (0..N).map(|i| system[i * (N + 1) + N] as f32).collect();
    if !x.iter().all(|v| v.is_finite()) {
        return None;
    }
    let left = |(row, p): (&Row, &Predicted)| {
        let place = normalised(&problem.grid, problem.grid.place(row));
        let told: f32 = design(p, place).iter().zip(&x).map(|(d, x)| d * x).sum();
        (p.value - p.here - told).abs() * p.slope
    };
    let after = quantile(rows().zip(&predicted).map(left), 0.5)?;
    let mut shift = [[0f32; TERMS]; 2];
    for k in 0..TERMS {
        (shift[0][k], shift[1][k]) = (x[2 + k], x[2 + TERMS + k]);
    }
    Some(Fitted { gain: 1.0 + x[0], offset: x[1], shift, before, after })
}

/// A place of the view, −1 to 1 along each axis.
#[inline]
pub(super) fn normalised(grid: &Grid, (x, y): (f32, f32)) -> [f32; 2] {
    let half = |side: usize| (side - 2 * grid.margin) as f32 / 2.0;
    let (w, h) = (half(grid.width), half(grid.height));
    [(x + 0.5 - w) / w, (y + 0.5 - h) / h]
}
