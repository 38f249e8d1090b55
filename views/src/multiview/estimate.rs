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
use crate::disparity::{self, DepthOrder, Disparity, ViewLight, carry_plane_to_view, find_depth_order};
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
    let order = find_depth_order(&central, &grid, (rows / 2, columns / 2), scale, &dark);
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
    for (v, u) in disparity::corners_of((rows, columns), middle).into_iter().flatten().chain([middle]) {
        grid[v][u] = disparity::luminance(&data.slice(ndarray::s![v, u, .., .., ..]))?;
    }
    let central = Plane { width, height, data: disparity.iter().copied().collect() };
    let dark = |k: usize| light.weights[k] <= 0.0;
    Ok(find_depth_order(&central, &grid, middle, [1.0, 1.0], &dark))
}
