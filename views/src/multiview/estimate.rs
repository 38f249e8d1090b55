//! Disparity of every view: searched in the middle view, made exact by the samples, carried to every other view: the
//! nearest surface in front, gaps filled with what lies behind.

use lenslet_core::ensure;
use lenslet_core::geometry::Size;
use lenslet_core::progress::Observer;
use ndarray::Array2;
use rayon::prelude::*;

use super::options::Options;
use super::refine_disparity::refine_disparity;
use super::sample_set::SampleSet;
use super::view_disparities::{ViewDisparities, view_offset};
use crate::Error;
use crate::disparity::{self, DepthOrder, Disparity, ViewLight, carry_plane_to_view};
use lenslet_core::image::Plane;

/// Estimates the middle view's disparity, unless `options.known` gives it, and carries it to all views.
///
/// # Errors
/// Options out of range, interruption.
pub fn estimate_disparities(
    set: &SampleSet,
    options: &Options,
    observer: &dyn Observer,
) -> Result<ViewDisparities, Error> {
    let (rows, columns) = set.views();
    let (grid, scale) = set.brightness(options.disparity.side.clamp(16, 2048))?;
    let middle = match &options.known {
        Some(known) => {
            ensure!(
                Error::Shape,
                !known.is_empty() && known.iter().all(|d| d.is_finite()),
                "the known disparity has values that are not numbers"
            );
            Disparity { disparity: known.clone(), confidence: Array2::ones(known.dim()), searched: None }
        }
        None if rows * columns < 2 => {
            let size = (grid[0][0].height, grid[0][0].width);
            Disparity { disparity: Array2::zeros(size), confidence: Array2::zeros(size), searched: None }
        }
        None => {
            let limit = (options.disparity.limit.max(1.25 * set.pitch) / scale).max(0.1);
            let weights = set.search_weights();
            let search = disparity::Options {
                range: options.disparity.range.map(|(a, b)| (a / scale, b / scale)),
                limit,
                // A lenslet camera cannot capture disparities much beyond one lenslet per view step.
                widest: if weights.is_some() { (options.disparity.widest * set.pitch / scale).max(0.1) } else { limit },
                weights,
                linear: false,
                reference: None,
                ..options.disparity.clone()
            };
            let mut found = disparity::estimate_planes(grid.clone(), &search, observer)?;
            found.disparity *= scale;
            found.searched = found.searched.map(|(a, b)| (a * scale, b * scale));
            found
        }
    };
    observer.check()?;
    let size = (set.target.width, set.target.height);
    let (height, width) = middle.disparity.dim();
    let scale = [size.0 as f32 / width as f32, size.1 as f32 / height as f32];
    let central = Plane { width, height, data: middle.disparity.iter().copied().collect() };
    let dark = |k: usize| set.is_dark(k);
    let order = estimate_depth_order(&central, &grid, scale, (rows, columns), &dark);
    let maps = (0..rows * columns)
        .into_par_iter()
        .map(|k| carry_plane_to_view(&central, scale, view_offset((rows, columns), k), order))
        .collect();
    let mut disparities = ViewDisparities { rows, columns, maps, samples: Vec::new(), scale, order, middle };
    if options.known.is_none() {
        let light: Vec<f32> = set.light();
        let central = refine_disparity(set, &light, &disparities);
        disparities.carry_from_middle(central);
    }
    disparities.look_up_samples(&set.points);
    Ok(disparities)
}

/// Whether nearer surfaces have the smaller or the larger disparity: whichever predicts the corner views better.
/// Light fields whose views are numbered against the camera's movement have it the other way round.
fn estimate_depth_order(
    central: &Plane,
    grid: &[Vec<Plane>],
    scale: [f32; 2],
    views: (usize, usize),
    dark: &dyn Fn(usize) -> bool,
) -> DepthOrder {
    let (rows, columns) = views;
    let reference = &grid[rows / 2][columns / 2];
    let ratio = [reference.width as f32 / central.width as f32, reference.height as f32 / central.height as f32];
    let mut error = [0f64; 2];
    for corner in corners_of(views) {
        // The outermost view that holds light on the way to the middle.
        let Some(&(v, u)) = corner.iter().find(|(v, u)| !dark(v * columns + u)) else { continue };
        let k = v * columns + u;
        let offset = view_offset(views, k);
        for (order, e) in [DepthOrder::NearerIsSmaller, DepthOrder::NearerIsLarger].into_iter().zip(&mut error) {
            let map = carry_plane_to_view(central, scale, offset, order);
            for t in 0..map.height {
                for s in 0..map.width {
                    let d = map.data[t * map.width + s];
                    let (x, y) = (s as f32 - d * offset[0] / scale[0], t as f32 - d * offset[1] / scale[1]);
                    let place = |x: f32, y: f32| ((x + 0.5) * ratio[0] - 0.5, (y + 0.5) * ratio[1] - 0.5);
                    let (a, b) = (place(x, y), place(s as f32, t as f32));
                    *e += f64::from((reference.bilinear_at(a.0, a.1) - grid[v][u].bilinear_at(b.0, b.1)).abs());
                }
            }
        }
    }
    if error[1] < 0.995 * error[0] { DepthOrder::NearerIsLarger } else { DepthOrder::NearerIsSmaller }
}

/// From each corner of the grid the views on the diagonal to the middle one.
fn corners_of((rows, columns): (usize, usize)) -> [Vec<(usize, usize)>; 4] {
    let steps = (rows / 2).max(columns / 2).max(1);
    let toward = |from: usize, to: usize, k: usize| {
        (from as isize + (to as isize - from as isize) * k as isize / steps as isize) as usize
    };
    [(0, 0), (0, columns - 1), (rows - 1, 0), (rows - 1, columns - 1)]
        .map(|(v, u)| (0..steps).map(|k| (toward(v, rows / 2, k), toward(u, columns / 2, k))).collect())
}

/// Which disparities are in front in the light field (v, u, t, s, c), given its middle view's disparity.
///
/// # Errors
/// Views of other than one or three channels.
pub fn depth_order_of(data: &ndarray::ArrayView5<f32>, disparity: &Array2<f32>) -> Result<DepthOrder, Error> {
    let (rows, columns, ..) = data.dim();
    let (height, width) = disparity.dim();
    let mut grid = vec![vec![Plane::filled(Size::new(1, 1), 0.0); columns]; rows];
    let light = ViewLight::of(data, true, None);
    let middle = (rows / 2, columns / 2);
    for (v, u) in corners_of((rows, columns)).into_iter().flatten().chain([middle]) {
        grid[v][u] = disparity::luminance(&data.slice(ndarray::s![v, u, .., .., ..]))?;
    }
    let central = Plane { width, height, data: disparity.iter().copied().collect() };
    let dark = |k: usize| light.weights[k] <= 0.0;
    Ok(estimate_depth_order(&central, &grid, [1.0, 1.0], (rows, columns), &dark))
}
