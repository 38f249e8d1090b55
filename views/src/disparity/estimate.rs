//! Disparity of one view of a light field: range found at a small size, then the search, then brought to the full size.

use lenslet_core::image::Plane;
use lenslet_core::progress::Observer;
use ndarray::{Array2, ArrayView5, s};
use rayon::prelude::*;

use super::error::Error;
use super::light::ViewLight;
use super::options::Options;
use super::planes::luminance;
use super::range::find_range;
use super::search::{enlarge, search};
use super::specks;
use super::volume::outermost_step;

/// Disparity and confidence at every pixel of the reference view.
#[derive(Debug, Clone, PartialEq)]
pub struct Disparity {
    /// Disparity, output pixels per view step, shape (t, s).
    pub disparity: Array2<f32>,
    /// Confidence, 0 (filled from the surroundings) to 1, shape (t, s): of the pixels that say 0.9, about 90 % are within
    /// 0.07 pixels per view step of the true disparity, pixels being those of the size searched.
    pub confidence: Array2<f32>,
    /// The range that was searched, pixels per view step; `None` where nothing was.
    pub searched: Option<(f32, f32)>,
}

impl Disparity {
    /// Share of the pixels, by their confidence, whose disparity lies at an end of the range that was searched: more
    /// than a few hundredths mean that the true ones lie beyond it.
    #[must_use]
    pub fn share_at_ends(&self) -> f32 {
        let Some((low, high)) = self.searched else { return 0.0 };
        let near = 0.01 * (high - low);
        let (mut at, mut all) = (0f64, 1e-9);
        for (d, c) in self.disparity.iter().zip(&self.confidence) {
            all += f64::from(*c);
            if *d <= low + near || *d >= high - near {
                at += f64::from(*c);
            }
        }
        (at / all) as f32
    }
}

/// Estimates the disparity of the reference view of the light field `data` (v, u, t, s, c).
///
/// # Errors
/// [`Error::Shape`] when there are fewer than two views or no pixels, [`Error::Parameter`] for options out of range,
/// [`Error::Interrupted`] once the observer cancels.
pub fn estimate_disparity(
    data: &ArrayView5<f32>,
    options: &Options,
    observer: &dyn Observer,
) -> Result<Disparity, Error> {
    let (rows, columns, height, width, channels) = data.dim();
    if rows * columns < 2 || height == 0 || width == 0 {
        return Err(Error::Shape(format!("{rows}x{columns} views of {width}x{height}, {channels} channels")));
    }
    let light = match &options.weights {
        Some(weights) => ViewLight { weights: weights.clone(), gains: vec![1.0; rows * columns] },
        None => ViewLight::of(data, options.linear, None),
    };
    let grid: Vec<Vec<Plane>> = (0..rows)
        .into_par_iter()
        .map(|v| {
            (0..columns)
                .map(|u| {
                    let mut plane = luminance(&data.slice(s![v, u, .., .., ..]))?;
                    let gain = light.gains[v * columns + u];
                    if options.linear && gain != 1.0 {
                        plane.data.iter_mut().for_each(|x| *x *= gain);
                    }
                    if options.linear {
                        plane.data.iter_mut().for_each(|x| *x = x.max(0.0).sqrt());
                    }
                    Ok(plane)
                })
                .collect()
        })
        .collect::<Result<_, Error>>()?;
    let options = Options { weights: Some(light.weights), ..options.clone() };
    estimate_planes(grid, &options, observer)
}

/// The range of disparities that [`estimate_disparity`] would search, output pixels per view step.
///
/// # Errors
/// As [`estimate_disparity`].
pub fn find_disparity_range(
    data: &ArrayView5<f32>,
    options: &Options,
    observer: &dyn Observer,
) -> Result<(f32, f32), Error> {
    // Half the side is enough for the range, and a quarter of the work.
    let coarse = Options { side: options.side.min(200), ..options.clone() };
    let found = estimate_disparity(data, &coarse, observer)?;
    Ok(found.searched.unwrap_or((-options.limit, options.limit)))
}

/// As [`estimate_disparity`], from planes `grid[v][u]` of equal size.
///
/// # Errors
/// As [`estimate_disparity`].
pub fn estimate_planes(
    mut grid: Vec<Vec<Plane>>,
    options: &Options,
    observer: &dyn Observer,
) -> Result<Disparity, Error> {
    let (rows, columns) = (grid.len(), grid.first().map_or(0, Vec::len));
    if rows * columns < 2 || grid.iter().any(|r| r.len() != columns) {
        return Err(Error::Shape(format!("{rows} rows of views, the first with {columns}")));
    }
    let (width, height) = (grid[0][0].width, grid[0][0].height);
    if width == 0
        || height == 0
        || grid.iter().flatten().any(|p| (p.width, p.height, p.data.len()) != (width, height, width * height))
    {
        return Err(Error::Shape(format!("views of different sizes, the first {width}x{height}")));
    }
    let positive = |x: f32| x.is_finite() && x > 0.0;
    if !positive(options.limit)
        || !positive(options.widest)
        || !positive(options.step)
        || !positive(options.truncation)
        || options.side < 16
    {
        return Err(Error::Parameter(
            "disparity: limit, widest, step and truncation must be positive, side at least 16".into(),
        ));
    }
    if !(0.0..=1.0).contains(&options.specks) {
        return Err(Error::Parameter(format!("disparity: specks must be 0 to 1, not {}", options.specks)));
    }
    if let Some((a, b)) = options.range
        && !(a.is_finite() && b.is_finite() && a < b && a.abs().max(b.abs()) < 1e4)
    {
        return Err(Error::Parameter(format!("disparity: the range {a} to {b} is not an interval")));
    }
    let at = options.reference.unwrap_or((rows / 2, columns / 2));
    if at.0 >= rows || at.1 >= columns {
        return Err(Error::Parameter(format!("disparity: there is no view {},{} in {rows}x{columns}", at.0, at.1)));
    }
    if let Some(weights) = &options.weights {
        let used = weights.iter().filter(|w| **w > 0.0).count();
        if weights.len() != rows * columns || used < 2 || !options.uses(at.0 * columns + at.1) {
            let reason =
                format!("{used} of {rows}x{columns} views hold light, and the one in the middle must be one of them");
            return Err(Error::Shape(reason));
        }
    }
    let halve = |grid: &[Vec<Plane>]| -> Vec<Vec<Plane>> {
        grid.par_iter().map(|r| r.iter().map(Plane::halved).collect()).collect()
    };
    let mut scale = 1f32;
    while grid[0][0].width.max(grid[0][0].height) > options.side {
        grid = halve(&grid);
        scale *= 2.0;
    }
    let range = match options.range {
        Some((a, b)) => (a / scale, b / scale),
        None => {
            let (mut small, mut factor) = (None, scale);
            while small.as_ref().unwrap_or(&grid)[0][0].width.max(small.as_ref().unwrap_or(&grid)[0][0].height) > 200 {
                small = Some(halve(small.as_ref().unwrap_or(&grid)));
                factor *= 2.0;
            }
            let (a, b) = find_range(small.as_ref().unwrap_or(&grid), at, options, factor, observer)?;
            (a * factor / scale, b * factor / scale)
        }
    };
    let mut found = search(&grid, at, range, options, observer)?;
    let side = (options.specks * grid[0][0].width.max(grid[0][0].height) as f32) as usize;
    // Jumps by which a patch moves a pixel or more against its surroundings in the outermost view.
    let jump = 1.0 / outermost_step(&grid, at, options).max(1.0);
    specks::fill(&mut found.disparity, &mut found.confidence, grid[0][0].width, jump, side);
    let (disparity, confidence) = enlarge(&found, &grid[0][0], (width, height), scale);
    Ok(Disparity { disparity, confidence, searched: Some((range.0 * scale, range.1 * scale)) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::disparity::tensor;
    use lenslet_core::geometry::Size;

    /// A smooth texture that is not periodic within the frame.
    pub(super) fn texture(x: f32, y: f32) -> f32 {
        0.5 + 0.12 * (0.55 * x + 0.21 * y).sin()
            + 0.1 * (0.31 * y - 0.47 * x + 1.0).sin()
            + 0.1 * (0.83 * y + 0.13 * x).cos()
            + 0.05 * (0.05 * x * y.sqrt() + 2.0).sin()
    }

    /// Views of a surface whose disparity at the point x of the middle view is `d(x, y)`.
    pub(super) fn scene(views: usize, w: usize, h: usize, d: impl Fn(f32, f32) -> f32) -> Vec<Vec<Plane>> {
        let middle = (views / 2) as f32;
        (0..views)
            .map(|v| {
                (0..views)
                    .map(|u| {
                        let (du, dv) = (u as f32 - middle, v as f32 - middle);
                        let mut data = Vec::with_capacity(w * h);
                        for t in 0..h {
                            for s in 0..w {
                                // The point of the middle view seen here: fixed point of x = s − d(x)·u.
                                let (mut x, mut y) = (s as f32, t as f32);
                                for _ in 0..20 {
                                    let k = d(x, y);
                                    (x, y) = (s as f32 - k * du, t as f32 - k * dv);
                                }
                                data.push(texture(x + 40.0, y + 40.0));
                            }
                        }
                        Plane { width: w, height: h, data }
                    })
                    .collect()
            })
            .collect()
    }
    fn inner_errors(found: &[f32], w: usize, h: usize, truth: impl Fn(f32, f32) -> f32) -> Vec<f32> {
        let mut out = vec![];
        for t in 12..h - 12 {
            for s in 12..w - 12 {
                out.push(found[t * w + s] - truth(s as f32, t as f32));
            }
        }
        out
    }

    #[test]
    fn tensor_slopes_equal_the_planted_disparity() {
        for d in [0.83f32, -0.4] {
            let grid = scene(7, 96, 80, |_, _| d);
            for shear in [d - 0.15, d, d + 0.15] {
                let found = tensor::slopes(&grid, (3, 3), shear, 1, &|_| true);
                let errors = inner_errors(&found.disparity, 96, 80, |_, _| d);
                let rms = (errors.iter().map(|e| e * e).sum::<f32>() / errors.len() as f32).sqrt();
                assert!(rms < 0.02, "disparity {d} sheared by {shear}: rms {rms}");
            }
        }
    }

    fn share_within(found: &Disparity, truth: impl Fn(f32, f32) -> f32) -> f32 {
        let (h, w) = found.disparity.dim();
        let data: Vec<f32> = found.disparity.iter().copied().collect();
        let errors = inner_errors(&data, w, h, truth);
        errors.iter().filter(|e| e.abs() <= 0.07).count() as f32 / errors.len() as f32
    }

    #[test]
    fn planes_and_slants_are_found() {
        let plane = |_: f32, _: f32| -0.62f32;
        let slant = |x: f32, y: f32| 0.3 + 0.006 * x - 0.003 * y;
        let silent = lenslet_core::progress::Silent;
        let found = estimate_planes(scene(7, 96, 80, plane), &Options::default(), &silent).unwrap();
        assert!(share_within(&found, plane) > 0.99);
        let found = estimate_planes(scene(7, 96, 80, slant), &Options::default(), &silent).unwrap();
        assert!(share_within(&found, slant) > 0.97, "{}", share_within(&found, slant));
    }

    #[test]
    fn turning_the_order_of_the_views_turns_the_sign() {
        let silent = lenslet_core::progress::Silent;
        let grid = scene(5, 72, 64, |x, _| 0.4 + 0.004 * x);
        let turned: Vec<Vec<Plane>> = grid.iter().rev().map(|r| r.iter().rev().cloned().collect()).collect();
        let a = estimate_planes(grid, &Options::default(), &silent).unwrap();
        let b = estimate_planes(turned, &Options::default(), &silent).unwrap();
        let far = a.disparity.iter().zip(&b.disparity).filter(|(x, y)| (*x + *y).abs() > 0.05).count();
        assert!(far * 50 < a.disparity.len(), "{far} of {}", a.disparity.len());
    }

    #[test]
    fn confidence_is_the_chance_to_be_within_the_threshold() {
        let silent = lenslet_core::progress::Silent;
        let slope = |x: f32, y: f32| 0.3 + 0.006 * x - 0.003 * y;
        for noise in [0.0f32, 0.04] {
            let mut grid = scene(5, 112, 96, slope);
            let mut state = 1u32;
            for plane in grid.iter_mut().flatten() {
                for x in &mut plane.data {
                    let mut sum = -2.0;
                    for _ in 0..4 {
                        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                        sum += (state >> 8) as f32 / (1u32 << 24) as f32;
                    }
                    *x = (*x - 0.5) * 0.3 + 0.5 + noise * sum;
                }
            }
            let found = estimate_planes(grid, &Options::default(), &silent).unwrap();
            let truth = Array2::from_shape_fn((96, 112), |(t, s)| slope(s as f32, t as f32));
            let curve = crate::disparity::confidence_curve(&found, &truth, 12, 0.07);
            let said: f64 = curve.iter().map(|c| c.said * c.share).sum();
            let within: f64 = curve.iter().map(|c| c.within * c.share).sum();
            assert!((said - within).abs() < 0.12, "noise {noise}: {said} said, {within} are, {curve:?}");
        }
    }

    #[test]
    fn no_texture_no_confidence() {
        let grid = vec![vec![Plane::filled(Size::new(40, 40), 0.5); 3]; 3];
        let found = estimate_planes(grid, &Options::default(), &lenslet_core::progress::Silent).unwrap();
        assert!(found.confidence.iter().all(|&c| c < 0.01));
        assert!(found.disparity.iter().all(|d| d.is_finite()));
    }

    #[test]
    fn unusable_light_fields_and_options_are_refused() {
        let silent = lenslet_core::progress::Silent;
        let grid = || vec![vec![Plane::filled(Size::new(20, 20), 0.5); 2]; 2];
        let refused = |o: Options| estimate_planes(grid(), &o, &silent).is_err();
        assert!(refused(Options { range: Some((1.0, -1.0)), ..Options::default() }));
        assert!(refused(Options { range: Some((f32::NAN, 1.0)), ..Options::default() }));
        assert!(refused(Options { step: 0.0, ..Options::default() }));
        assert!(refused(Options { reference: Some((2, 0)), ..Options::default() }));
        assert!(
            estimate_planes(vec![vec![Plane::filled(Size::new(20, 20), 0.5)]], &Options::default(), &silent).is_err()
        );
        let ragged = vec![vec![Plane::filled(Size::new(20, 20), 0.5), Plane::filled(Size::new(21, 20), 0.5)]];
        assert!(estimate_planes(ragged, &Options::default(), &silent).is_err());
        let tiny = vec![vec![Plane::filled(Size::new(1, 1), 0.5); 2]];
        assert!(estimate_planes(tiny, &Options::default(), &silent).is_ok());
    }
}
