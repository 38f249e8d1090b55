//! Disparity of a light field (paper 4.3): plane sweep over all views regularised with edges kept, made sub-pixel by the
//! structure tensor of the epipolar images.
//!
//! Disparity D is in output pixels per view step: the scene point at x of the reference view appears at x + D·u, y + D·v in the
//! view (v, u) steps away. The HCI benchmark counts the other way round: its disparity is −D.

mod carry;
mod depth_order;
mod errors;
mod planes;
mod regularise;
mod specks;
mod sweep;
mod tensor;

pub use carry::{carry, carry_plane};
pub use depth_order::DepthOrder;
pub use errors::{Errors, errors};
use lenslet_core::progress::{Interrupted, Observer};
use ndarray::{Array2, ArrayView5, s};
pub use planes::{LUMINANCE, Plane, cubic_weights, luminance};
use rayon::prelude::*;

/// How disparity is estimated.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Smallest and largest disparity to look for, output pixels per view step; `None`: found from the light field.
    pub range: Option<(f32, f32)>,
    /// How far to look when `range` is `None`: ± so many output pixels per view step.
    pub limit: f32,
    /// Distance between hypotheses: this many pixels at the outermost view.
    pub step: f32,
    /// Views larger than this (longer side) are halved for the search until they fit.
    pub side: usize,
    /// Values are linear light (matching works on their square root, nearer to equal noise).
    pub linear: bool,
    /// Brightness differences beyond this count no more.
    pub truncation: f32,
    /// Reference view (row v, column u from 0); `None`: the middle.
    pub reference: Option<(usize, usize)>,
    /// Patches up to this share of the picture's longer side that differ from all around are filled from there; 0 to 1, 0
    /// leaves everything as it was found.
    pub specks: f32,
}

impl Options {
    /// For maps that people look at or point into, of light fields in linear light: without specks.
    pub fn shown() -> Self {
        Options { linear: true, specks: 1.0 / 30.0, ..Options::default() }
    }
}

impl Default for Options {
    fn default() -> Self {
        Options {
            range: None,
            limit: 4.0,
            step: 0.3,
            side: 640,
            linear: false,
            truncation: 0.04,
            reference: None,
            specks: 0.0,
        }
    }
}

/// Disparity and how sure it is, at every pixel of the reference view.
#[derive(Debug, Clone, PartialEq)]
pub struct Disparity {
    /// Output pixels per view step, shape (t, s).
    pub disparity: Array2<f32>,
    /// 0 (a guess from the surroundings) to 1, shape (t, s).
    pub confidence: Array2<f32>,
}

/// What goes wrong.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The light field cannot be used.
    #[error("disparity needs at least 2 views of one or three channels: {0}")]
    Shape(String),
    /// An option is out of range.
    #[error("{0}")]
    Parameter(String),
    /// The observer asked to stop.
    #[error(transparent)]
    Interrupted(#[from] Interrupted),
}

/// Estimates the disparity of the reference view of the light field `data` (v, u, t, s, c).
///
/// # Errors
/// [`Error::Shape`] when there are fewer than two views or no pixels, [`Error::Parameter`] for options out of range,
/// [`Error::Interrupted`] once the observer cancels.
pub fn estimate(data: &ArrayView5<f32>, options: &Options, observer: &dyn Observer) -> Result<Disparity, Error> {
    let (rows, columns, height, width, channels) = data.dim();
    if rows * columns < 2 || height == 0 || width == 0 {
        return Err(Error::Shape(format!("{rows}x{columns} views of {width}x{height}, {channels} channels")));
    }
    let grid: Vec<Vec<Plane>> = (0..rows)
        .into_par_iter()
        .map(|v| {
            (0..columns)
                .map(|u| {
                    let mut plane = luminance(&data.slice(s![v, u, .., .., ..]))?;
                    if options.linear {
                        plane.data.iter_mut().for_each(|x| *x = x.max(0.0).sqrt());
                    }
                    Ok(plane)
                })
                .collect()
        })
        .collect::<Result<_, Error>>()?;
    estimate_planes(grid, options, observer)
}

/// As [`estimate`], from planes `grid[v][u]` of equal size.
///
/// # Errors
/// As [`estimate`].
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
    if !positive(options.limit) || !positive(options.step) || !positive(options.truncation) || options.side < 16 {
        return Err(Error::Parameter(
            "disparity: limit, step and truncation must be positive, side at least 16".into(),
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
    // What moves by a pixel or more against its surroundings in the outermost view.
    let jump = 1.0 / reach(&grid, at).max(1.0);
    specks::fill(&mut found.disparity, &mut found.confidence, grid[0][0].width, jump, side);
    Ok(enlarge(&found, &grid[0][0], (width, height), scale))
}

/// What a search at one size gives, pixel by pixel.
struct Found {
    disparity: Vec<f32>,
    confidence: Vec<f32>,
}

fn placed(grid: &[Vec<Plane>], at: (usize, usize)) -> Vec<sweep::Placed<'_>> {
    let mut out = Vec::new();
    for (v, row) in grid.iter().enumerate() {
        for (u, plane) in row.iter().enumerate() {
            if (v, u) != at {
                out.push((plane, u as f32 - at.1 as f32, v as f32 - at.0 as f32));
            }
        }
    }
    out
}

/// The hypotheses of a range: `step` pixels apart at the outermost view, at least 5, at most 128.
fn hypotheses(range: (f32, f32), step: f32, reach: f32) -> Vec<f32> {
    let n = (((range.1 - range.0) * reach.max(1.0) / step).ceil() as usize).clamp(4, 127);
    (0..=n).map(|k| range.0 + (range.1 - range.0) * k as f32 / n as f32).collect()
}

fn reach(grid: &[Vec<Plane>], at: (usize, usize)) -> f32 {
    let (rows, columns) = (grid.len(), grid[0].len());
    at.0.max(rows - 1 - at.0).max(at.1).max(columns - 1 - at.1) as f32
}

/// Costs of all hypotheses, gathered along edges.
fn volume(
    grid: &[Vec<Plane>],
    at: (usize, usize),
    hypotheses: Vec<f32>,
    radius: usize,
    options: &Options,
    observer: &dyn Observer,
) -> Result<sweep::Volume, Error> {
    let reference = &grid[at.0][at.1];
    let views = placed(grid, at);
    let robust = sweep::Robust { truncation: options.truncation, half_penalty: 0.5 };
    let guide = regularise::Guide::new(reference, radius, 1e-4);
    let planes = hypotheses
        .par_iter()
        .map(|&d| {
            if observer.cancelled() {
                return Err(Interrupted.into());
            }
            let mut cost = sweep::cost(reference, &views, d, &robust);
            guide.filter(&mut cost);
            observer.advance(1);
            Ok(cost)
        })
        .collect::<Result<Vec<_>, Error>>()?;
    Ok(sweep::Volume { width: reference.width, height: reference.height, hypotheses, planes })
}

/// The range that holds nearly all confident disparities of a small version of the light field.
fn find_range(
    grid: &[Vec<Plane>],
    at: (usize, usize),
    options: &Options,
    factor: f32,
    observer: &dyn Observer,
) -> Result<(f32, f32), Error> {
    let limit = options.limit / factor;
    let list = hypotheses((-limit, limit), options.step, reach(grid, at));
    let spacing = list[1] - list[0];
    observer.begin("disparity range", list.len() as u64);
    let volume = volume(grid, at, list, 2, options, observer)?;
    let count = volume.width * volume.height;
    let mut votes: Vec<(f32, f32)> = (0..count)
        .map(|k| {
            let (best, confidence) = peak(&volume, k);
            (volume.hypotheses[best], confidence)
        })
        .collect();
    votes.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let total: f32 = votes.iter().map(|v| v.1).sum();
    let quantile = |q: f32| {
        let mut sum = 0.0;
        for v in &votes {
            sum += v.1;
            if sum >= q * total {
                return v.0;
            }
        }
        limit
    };
    let (lo, hi) = (quantile(0.003), quantile(0.997));
    let margin = (2.0 * spacing).max(0.1 * (hi - lo));
    Ok(((lo - margin).max(-limit), (hi + margin).min(limit)))
}

/// Index of the least cost at a pixel, and how far it stands below the mean over the hypotheses (0..1).
fn peak(volume: &sweep::Volume, k: usize) -> (usize, f32) {
    let (mut best, mut least, mut sum) = (0, f32::INFINITY, 0.0);
    for (d, plane) in volume.planes.iter().enumerate() {
        let c = plane[k];
        sum += c;
        if c < least {
            (best, least) = (d, c);
        }
    }
    let mean = sum / volume.planes.len() as f32;
    (best, standing(mean, least))
}

/// Confidence of a minimum `least` under a mean cost `mean`; the constant is the brightness noise of a good camera.
fn standing(mean: f32, least: f32) -> f32 {
    ((mean - least) / (mean + 0.004)).clamp(0.0, 1.0)
}

fn search(
    grid: &[Vec<Plane>],
    at: (usize, usize),
    range: (f32, f32),
    options: &Options,
    observer: &dyn Observer,
) -> Result<Found, Error> {
    let reference = &grid[at.0][at.1];
    let (w, h) = (reference.width, reference.height);
    let list = hypotheses(range, options.step, reach(grid, at));
    let spacing = list[1] - list[0];
    observer.begin("disparity", list.len() as u64);
    let volume = volume(grid, at, list, 2, options, observer)?;
    let n = volume.hypotheses.len();
    let penalties = regularise::Penalties { small: 0.009, large: 0.06, edge: 0.03 };
    let total = regularise::semi_global(&volume, reference, &penalties);
    observer.check()?;
    let mut found = Found { disparity: vec![0.0; w * h], confidence: vec![0.0; w * h] };
    found.disparity.par_iter_mut().zip(found.confidence.par_iter_mut()).enumerate().for_each(|(k, (d, c))| {
        let costs = &total[k * n..(k + 1) * n];
        let mut best = 0;
        for (i, v) in costs.iter().enumerate() {
            if *v < costs[best] {
                best = i;
            }
        }
        *d = volume.hypotheses[best] + spacing * vertex(costs, best);
        let mean = volume.planes.iter().map(|p| p[k]).sum::<f32>() / n as f32;
        *c = standing(mean, volume.planes[best][k]);
    });
    drop(total);
    refine(grid, at, &mut found, &volume);
    found.disparity = regularise::weighted_median(&found.disparity, &found.confidence, reference, 2, 0.03);
    Ok(found)
}

/// Offset (−½..½) of the minimum of the parabola through the costs around `best`.
fn vertex(costs: &[f32], best: usize) -> f32 {
    if best == 0 || best + 1 >= costs.len() {
        return 0.0;
    }
    let (a, b, c) = (costs[best - 1], costs[best], costs[best + 1]);
    let curvature = a - 2.0 * b + c;
    if curvature > 0.0 { (0.5 * (a - c) / curvature).clamp(-0.5, 0.5) } else { 0.0 }
}

/// Sub-pixel: the slope of the EPI structure tensor, sheared near the disparity found, is taken where the lines are coherent
/// and the matching cost says it is the better one.
fn refine(grid: &[Vec<Plane>], at: (usize, usize), found: &mut Found, volume: &sweep::Volume) {
    let (lo, hi) = found.disparity.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &d| (a.min(d), b.max(d)));
    let gap = 0.4;
    let n = ((hi - lo) / gap).ceil().clamp(1.0, 64.0) as usize;
    let width = (hi - lo) / n as f32;
    let shears: Vec<f32> = (0..n).map(|k| lo + width * (k as f32 + 0.5)).collect();
    let tensors: Vec<_> = shears.par_iter().map(|&shear| tensor::slopes(grid, at, shear, 2)).collect();
    let spacing = volume.hypotheses[1] - volume.hypotheses[0];
    let cost = |k: usize, d: f32| {
        let place = ((d - volume.hypotheses[0]) / spacing).clamp(0.0, (volume.planes.len() - 1) as f32);
        let i = (place as usize).min(volume.planes.len() - 2);
        let f = place - i as f32;
        volume.planes[i][k] * (1.0 - f) + volume.planes[i + 1][k] * f
    };
    found.disparity.par_iter_mut().enumerate().for_each(|(k, d)| {
        let index = if width > 0.0 { (((*d - lo) / width) as usize).min(n - 1) } else { 0 };
        let t = &tensors[index];
        let slope = t.disparity[k];
        if t.coherence[k] > 0.8 && (slope - *d).abs() < spacing && cost(k, slope) < 0.95 * cost(k, *d) {
            *d = slope;
        }
    });
}

/// Brings a search result to the full size, following the brightness edges of nothing: bilinear, in units of full pixels.
fn enlarge(found: &Found, reference: &Plane, full: (usize, usize), scale: f32) -> Disparity {
    let (w, h) = (reference.width, reference.height);
    let plane = |data: &[f32]| Plane { width: w, height: h, data: data.to_vec() };
    let (d, c) = (plane(&found.disparity), plane(&found.confidence));
    let place = |k: usize| (k as f32 + 0.5) / scale - 0.5;
    Disparity {
        disparity: Array2::from_shape_fn((full.1, full.0), |(t, s)| scale * d.at(place(s), place(t))),
        confidence: Array2::from_shape_fn((full.1, full.0), |(t, s)| c.at(place(s), place(t))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
                let found = tensor::slopes(&grid, (3, 3), shear, 1);
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
    fn no_texture_no_confidence() {
        let grid = vec![vec![Plane::filled(40, 40, 0.5); 3]; 3];
        let found = estimate_planes(grid, &Options::default(), &lenslet_core::progress::Silent).unwrap();
        assert!(found.confidence.iter().all(|&c| c < 0.01));
        assert!(found.disparity.iter().all(|d| d.is_finite()));
    }

    #[test]
    fn what_cannot_be_used_is_refused() {
        let silent = lenslet_core::progress::Silent;
        let grid = || vec![vec![Plane::filled(20, 20, 0.5); 2]; 2];
        let refused = |o: Options| estimate_planes(grid(), &o, &silent).is_err();
        assert!(refused(Options { range: Some((1.0, -1.0)), ..Options::default() }));
        assert!(refused(Options { range: Some((f32::NAN, 1.0)), ..Options::default() }));
        assert!(refused(Options { step: 0.0, ..Options::default() }));
        assert!(refused(Options { reference: Some((2, 0)), ..Options::default() }));
        assert!(estimate_planes(vec![vec![Plane::filled(20, 20, 0.5)]], &Options::default(), &silent).is_err());
        let ragged = vec![vec![Plane::filled(20, 20, 0.5), Plane::filled(21, 20, 0.5)]];
        assert!(estimate_planes(ragged, &Options::default(), &silent).is_err());
        let tiny = vec![vec![Plane::filled(1, 1, 0.5); 2]];
        assert!(estimate_planes(tiny, &Options::default(), &silent).is_ok());
    }
}
