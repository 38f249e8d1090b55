//! The solver: reweighted least squares, each round by conjugate gradients on the pixel grid.

use std::ops::Range;

use lenslet_core::colour::{LUMINANCE_OF_LINEAR, luminance_of_linear, srgb_encode};
use lenslet_core::geometry::Size;
use lenslet_core::image::box_mean;

use super::basis::Basis;
use super::conjugate_gradients::conjugate_gradients;
use super::dispatch::dispatched;
use super::forward::{Grid, Row};
use super::kernel::Kernel;
use super::normal_stencil::Accumulator;
use super::prior::EdgeWeights;

/// Smallest residual that counts as unusual, encoded values.
///
/// Source: chosen, half a step of 8-bit values.
pub(crate) const LEAST_RESIDUAL: f32 = 2e-3;

/// Error of the samples' places and of the footprint, encoded values. All samples of a surface share it, so that more of
/// them do not average it away.
///
/// Source: chosen.
const SYSTEMATIC: f32 = 2e-3;

/// Median residuals at which a sample of the view itself loses half of its weight.
///
/// Source: chosen: with 3, Antinous enlarged by two loses 0.2 dB; without limit, the KAIST field by three 0.2 dB; with 10, dust on
/// lenslets comes back.
const OWN_OUTLYING: f32 = 6.0;

/// Share of the pixels, those of the least contrast, where residuals are taken for noise.
///
/// Source: chosen.
const PLAIN: f64 = 0.2;

/// Colours have one step of the solver for this many of luminance: their prior is stronger.
///
/// Source: measured on simulated captures; as many steps as luminance change scores of colour by 0.02 dB.
const COLOUR_STEPS: usize = 2;

/// Least mean difference of neighbouring pixels that the prior assumes, encoded values.
///
/// Source: chosen.
const LEAST_CONTRAST: f32 = 2e-3;

/// Pixels on each side over which the mean difference is taken.
///
/// Source: chosen.
const CONTRAST_RADIUS: usize = 4;

/// Samples of a picture.
pub struct Problem<'a> {
    /// The pixels that are solved for.
    pub grid: Grid,
    /// What a sample averages.
    pub kernel: &'a Kernel,
    /// The samples in the picture.
    pub rows: &'a [Row],
    /// Value of every sample, up to three channels, the rest 0.
    pub values: &'a [[f32; 4]],
    /// 1 or 3.
    pub channels: usize,
    /// Slope of the sRGB encoding at every sample where values are linear light; empty where they are encoded.
    pub slopes: &'a [f32],
    /// Mean difference of neighbouring pixels that the prior expects around each pixel ([`mean_contrast`]).
    pub contrast: &'a [f32],
    /// Samples of the view itself, whose places are certain: they lose weight at larger residuals than those of others.
    pub own: Range<u32>,
}

/// How a problem is solved.
#[derive(Debug, Clone, PartialEq)]
pub struct SolveOptions {
    /// Times the weights are renewed; default 3.
    pub reweightings: usize,
    /// Steps of conjugate gradients each time; default 12.
    pub steps: usize,
    /// Weight of the prior; 1, the default, is that of a Laplacian distribution of differences.
    pub prior: f32,
    /// Differences below this many encoded values are punished by their square; default 0.1.
    pub edge: f32,
    /// Median residuals at which a sample loses half of its weight, one of weight ½ or less and one of weight 1; default
    /// 3 for all.
    pub outlying: [f32; 2],
    /// Error of the samples' places that they share, pixels: where the picture has contrast it counts as noise of
    /// all of them; default 0.
    pub place_error: f32,
}

impl Default for SolveOptions {
    fn default() -> Self {
        SolveOptions { reweightings: 3, steps: 12, prior: 1.0, edge: 0.1, outlying: [3.0; 2], place_error: 0.0 }
    }
}

/// A picture on the grid.
pub struct Solution {
    /// One plane a channel.
    pub planes: Vec<Vec<f32>>,
    /// Usual residual of the samples, encoded values.
    pub residual: f32,
    /// The picture as samples see it: k ∗ I, up to three channels, the rest 0.
    pub smooth: Vec<[f32; 4]>,
}

impl Problem<'_> {
    /// Slope of the encoding at a sample.
    #[inline(always)]
    fn slope(&self, sample: u32) -> f32 {
        self.slopes.get(sample as usize).copied().unwrap_or(1.0)
    }

    /// Root of the mean square over channels of what is left of a row's sample, encoded values.
    #[inline(always)]
    fn over_channels(&self, row: &Row, left: &[f32; 4]) -> f32 {
        (left.iter().map(|l| l * l).sum::<f32>() / self.channels as f32).sqrt() * self.slope(row.sample)
    }

    /// What is left of a row's sample in luminance, encoded values; at least 0.
    #[inline(always)]
    pub(crate) fn luminance_left(&self, row: &Row, left: &[f32; 4]) -> f32 {
        self.luminance(left).abs() * self.slope(row.sample)
    }

    #[inline(always)]
    fn luminance(&self, value: &[f32; 4]) -> f32 {
        sample_luminance(value, self.channels)
    }

    #[inline(always)]
    fn left_with<const N: usize>(&self, row: &Row, smooth: &[[f32; 4]]) -> [f32; 4] {
        let (here, value) = (row.apply::<N>(smooth, self.grid.width), &self.values[row.sample as usize]);
        std::array::from_fn(|l| value[l] - here[l])
    }

    /// What the picture `smooth` leaves of a row's sample in every channel, and of its luminance in encoded values (at
    /// least 0).
    #[inline]
    #[must_use]
    pub fn left(&self, row: &Row, smooth: &[[f32; 4]]) -> ([f32; 4], f32) {
        let left = match self.grid.basis {
            Basis::Linear => self.left_with::<2>(row, smooth),
            Basis::Quadratic => self.left_with::<3>(row, smooth),
            Basis::Cubic => self.left_with::<4>(row, smooth),
        };
        (left, self.luminance_left(row, &left))
    }

    /// Median residual of the samples that count, and those of luminance and of the two differences of colour of them
    /// where the contrast is at most `plain`.
    #[inline(always)]
    fn usual_residuals<const N: usize>(&self, smooth: &[[f32; 4]], plain: f32) -> (f32, [f32; 3]) {
        let (mut all, mut of_plain) = (Vec::new(), [const { Vec::new() }; 3]);
        for row in self.rows.iter().step_by(17) {
            if row.weight > 0.3 {
                let left = self.left_with::<N>(row, smooth);
                all.push(self.over_channels(row, &left));
                if self.contrast[row.cell as usize] <= plain {
                    let slope = self.slope(row.sample);
                    for (residuals, left) in of_plain.iter_mut().zip(self.opponent(left)) {
                        residuals.push(slope * left.abs());
                    }
                }
            }
        }
        let median = |residuals: Vec<f32>| quantile(residuals.into_iter(), 0.5).unwrap_or(0.0);
        (median(all), of_plain.map(median))
    }

    /// What is left of luminance, and of how much more red and blue are.
    #[inline(always)]
    fn opponent(&self, [r, g, b, _]: [f32; 4]) -> [f32; 3] {
        if self.channels == 3 { opponent([r, g, b]) } else { [r, 0.0, 0.0] }
    }
}

/// Luminance of a sample beside what the picture gives at its place. The colours of a capture are what demosaicing made of
/// them, noisier, or smoothed: they tell little of places.
#[derive(Debug, Clone, Copy)]
pub struct Predicted {
    /// What was measured.
    pub value: f32,
    /// What the picture gives.
    pub here: f32,
    /// How that changes with the place along x, a pixel.
    pub gx: f32,
    /// How that changes with the place along y, a pixel.
    pub gy: f32,
    /// Slope of the encoding there.
    pub slope: f32,
}

impl Predicted {
    /// What is left of the value, encoded; at least 0.
    #[must_use]
    pub fn residual(&self) -> f32 {
        (self.value - self.here).abs() * self.slope
    }

    /// g² and g r, encoded values: r the residual, g how the picture's value changes when the place moves by `direction`
    /// pixels.
    #[must_use]
    pub fn along(&self, direction: [f32; 2]) -> (f32, f32) {
        let square = self.slope * self.slope;
        let g = self.gx * direction[0] + self.gy * direction[1];
        (square * g * g, square * g * (self.value - self.here))
    }
}

impl Problem<'_> {
    /// A row's sample beside the picture `smooth`.
    #[must_use]
    pub fn predicted(&self, row: &Row, smooth: &[[f32; 4]]) -> Predicted {
        match self.grid.basis {
            Basis::Linear => self.predicted_with::<2>(row, smooth),
            Basis::Quadratic => self.predicted_with::<3>(row, smooth),
            Basis::Cubic => self.predicted_with::<4>(row, smooth),
        }
    }

    #[inline]
    fn predicted_with<const N: usize>(&self, row: &Row, smooth: &[[f32; 4]]) -> Predicted {
        let [here, gx, gy] = row.apply_with_slopes::<N>(smooth, self.grid.width).map(|v| self.luminance(&v));
        let value = self.luminance(&self.values[row.sample as usize]);
        Predicted { value, here, gx, gy, slope: self.slope(row.sample) }
    }
}

/// Solves from `start`, one plane a channel on the grid.
#[must_use]
pub fn solve(problem: &Problem<'_>, start: Vec<Vec<f32>>, options: &SolveOptions) -> Solution {
    match problem.grid.basis {
        Basis::Linear => dispatched(|| solve_with::<2>(problem, start, options)),
        Basis::Quadratic => dispatched(|| solve_with::<3>(problem, start, options)),
        Basis::Cubic => dispatched(|| solve_with::<4>(problem, start, options)),
    }
}

#[inline(always)]
fn solve_with<const N: usize>(problem: &Problem<'_>, start: Vec<Vec<f32>>, options: &SolveOptions) -> Solution {
    let (grid, kernel) = (problem.grid, problem.kernel);
    let mut planes = start;
    let squared = kernel.squared();
    let (mut residual, mut noise) = (0.0, [f32::INFINITY; 3]);
    let plain = quantile(problem.contrast.iter().copied(), PLAIN).unwrap_or(f32::INFINITY);
    for _ in 0..=options.reweightings {
        let smooth = kernel.smooth(&planes, grid.width);
        let usual = problem.usual_residuals::<N>(&smooth, plain);
        residual = usual.0;
        let mut sums = Accumulator::new(&grid);
        let mut total = 0f64;
        for row in problem.rows {
            let slope = problem.slope(row.sample);
            let left = problem.left_with::<N>(row, &smooth);
            let half = if problem.own.contains(&row.sample) {
                (OWN_OUTLYING * residual).max(4.0 * LEAST_RESIDUAL)
            } else {
                let [least, most] = options.outlying;
                let outlying = least + (most - least) * (2.0 * row.weight - 1.0).max(0.0);
                (outlying * residual).max(2.0 * LEAST_RESIDUAL)
            };
            let unusual = problem.over_channels(row, &left) / half;
            let weight = row.weight / (1.0 + unusual * unusual);
            total += f64::from(weight);
            let weight = weight * slope * slope;
            sums.add::<N>(row, weight, &problem.values[row.sample as usize]);
        }
        let (stencil, mut right) = sums.finish(problem.channels);
        let view = (grid.width - 2 * grid.margin) * (grid.height - 2 * grid.margin);
        let density = (total / view.max(1) as f64) as f32;
        // A picture that the prior has flattened leaves larger residuals, which must not make the prior stronger.
        noise = std::array::from_fn(|l| usual.1[l].min(noise[l]));
        let guide = Guide::of(&planes, !problem.slopes.is_empty());
        let mut of_samples = vec![0f32; grid.pixels()];
        squared.convolve(stencil.diagonal(), grid.width, &mut of_samples);
        // Noise of colours is many times that of luminance, so that each has a prior of its own.
        map_pixels(&mut right, opponent);
        map_pixels(&mut planes, opponent);
        let of_contrast = density * options.place_error * options.place_error;
        let (mut a, mut b) = (vec![0f32; grid.pixels()], vec![0f32; grid.pixels()]);
        for (l, (plane, right)) in planes.iter_mut().zip(&right).enumerate() {
            let variance = (1.4826 * noise[l]).powi(2) + density * SYSTEMATIC * SYSTEMATIC;
            let edges = guide.edge_weights(problem, [variance, of_contrast], options);
            let mut diagonal = of_samples.clone();
            edges.add_diagonal(&mut diagonal);
            let inverse: Vec<f32> = diagonal.iter().map(|d| 1.0 / d.max(1e-12)).collect();
            let mut target = vec![0f32; grid.pixels()];
            kernel.convolve(right, grid.width, &mut target);
            let multiply = |x: &[f32], out: &mut [f32]| {
                kernel.convolve(x, grid.width, &mut a);
                stencil.multiply(&a, &mut b);
                kernel.convolve(&b, grid.width, out);
                edges.add_product(x, out);
            };
            let steps = if l == 0 { options.steps } else { options.steps.div_ceil(COLOUR_STEPS) };
            conjugate_gradients(multiply, &inverse, &target, plane, steps, 1e-5);
        }
        map_pixels(&mut planes, colour);
    }
    let smooth = kernel.smooth(&planes, grid.width);
    Solution { planes, residual, smooth }
}

/// Luminance of a sample of three channels; the value of one of a single channel.
#[inline(always)]
pub(crate) fn sample_luminance(&[r, g, b, _]: &[f32; 4], channels: usize) -> f32 {
    if channels == 3 { luminance_of_linear([r, g, b]) } else { r }
}

/// Luminance, and how much more red and blue are.
#[inline(always)]
fn opponent([r, g, b]: [f32; 3]) -> [f32; 3] {
    let light = luminance_of_linear([r, g, b]);
    [light, r - light, b - light]
}

/// The inverse of [`opponent`].
#[inline(always)]
fn colour([light, more_red, more_blue]: [f32; 3]) -> [f32; 3] {
    let [lr, lg, lb] = LUMINANCE_OF_LINEAR;
    [light + more_red, light - (lr * more_red + lb * more_blue) / lg, light + more_blue]
}

/// Maps every pixel of three planes; a single plane stays.
#[inline(always)]
fn map_pixels(planes: &mut [Vec<f32>], map: impl Fn([f32; 3]) -> [f32; 3]) {
    if let [first, second, third] = planes {
        for ((a, b), c) in first.iter_mut().zip(second).zip(third) {
            [*a, *b, *c] = map([*a, *b, *c]);
        }
    }
}

/// What the prior takes edges from.
struct Guide {
    /// Luminance, encoded values.
    luminance: Vec<f32>,
    /// Slope of the encoding there; 1 where values are encoded.
    slopes: Vec<f32>,
}

impl Guide {
    fn of(planes: &[Vec<f32>], linear: bool) -> Self {
        let light = |k: usize| match planes {
            [r, g, b] => luminance_of_linear([r[k], g[k], b[k]]),
            [grey, ..] => grey[k],
            [] => 0.0,
        };
        let light: Vec<f32> = (0..planes.first().map_or(0, Vec::len)).map(light).collect();
        if linear {
            let slopes = light.iter().map(|&l| encoding_slope(l)).collect();
            Guide { luminance: light.iter().map(|&l| srgb_encode(l.max(0.0))).collect(), slopes }
        } else {
            Guide { slopes: vec![1.0; light.len()], luminance: light }
        }
    }

    /// Weights of the prior: those of a Laplacian distribution whose scale is the contrast expected around each pixel, for
    /// noise of a `variance` (encoded values) everywhere, and of `of_contrast` times the square of the contrast.
    fn edge_weights(
        &self,
        problem: &Problem<'_>,
        [variance, of_contrast]: [f32; 2],
        options: &SolveOptions,
    ) -> EdgeWeights {
        let (mean, slopes) = (problem.contrast, &self.slopes);
        EdgeWeights::of_guide(&self.luminance, problem.grid.width, |difference, a, b| {
            let scale = (0.5 * (mean[a] + mean[b])).max(LEAST_CONTRAST);
            let slope = 0.5 * (slopes[a] * slopes[a] + slopes[b] * slopes[b]);
            let variance = variance + of_contrast * scale * scale;
            options.prior * variance * slope / (scale * difference.abs().max(options.edge))
        })
    }
}

/// Mean difference of neighbouring pixels around each pixel of a picture whose rows have `width` pixels, encoded values.
#[must_use]
pub fn mean_contrast(planes: &[Vec<f32>], width: usize, linear: bool) -> Vec<f32> {
    let guide = Guide::of(planes, linear).luminance;
    let (w, h) = (width, guide.len() / width.max(1));
    let mut contrast = vec![0f32; guide.len()];
    for t in 0..h {
        for s in 0..w {
            let k = t * w + s;
            let right = if s + 1 < w { (guide[k + 1] - guide[k]).abs() } else { 0.0 };
            let below = if t + 1 < h { (guide[k + w] - guide[k]).abs() } else { 0.0 };
            contrast[k] = 0.5 * (right + below);
        }
    }
    let mut mean = Vec::new();
    box_mean(&contrast, Size::new(w, h), CONTRAST_RADIUS, &mut mean);
    mean
}

/// The value that a `share` (0 to below 1) of the finite ones among `values` does not exceed; `None` where there are none.
pub(crate) fn quantile(values: impl Iterator<Item = f32>, share: f64) -> Option<f32> {
    let mut values: Vec<f32> = values.filter(|v| v.is_finite()).collect();
    let at = (share * values.len() as f64) as usize;
    (at < values.len()).then(|| *values.select_nth_unstable_by(at, f32::total_cmp).1)
}

/// Darkest light at which the slope of the encoding is taken.
///
/// Source: chosen; darker, the weights of samples would differ by more than their noise does.
const DARK: f32 = 0.004;

/// Slope of the sRGB encoding at a linear value: encoded change per linear change.
#[must_use]
pub fn encoding_slope(linear: f32) -> f32 {
    let x = linear.clamp(DARK, 1.0);
    1.055 / 2.4 * x.powf(1.0 / 2.4 - 1.0)
}
