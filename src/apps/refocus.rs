//! Refocusing (Ng 2005): I(x) = Σ a(u, v) L(x + D·(u, v); v, u) / Σ a(u, v), shifts sub-pixel, in linear light.

use lenslet_core::geometry::Size;
use ndarray::{Array2, Array3, ArrayView2, ArrayView3, ArrayView5, s};
use rayon::prelude::*;

use lenslet_core::colour::LUMINANCE;
use lenslet_core::ensure;
use lenslet_core::image::{Cell, bilinear_by_weights, catmull_rom_weights};
use lenslet_views::disparity;

use super::error::Error;

/// Rows of the picture made together: every row of a view is fetched once for the four output rows it enters, and the
/// sums of a band stay in the cache of a core.
/// Source: chosen.
const BAND: usize = 16;

/// Mean squared difference from the middle view at which a view counts half in [`all_in_focus`]: 5 % of white, squared.
/// Source: chosen.
const HALF_WEIGHT: f32 = 0.0025;

/// The shape of an aperture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum ApertureShape {
    /// Within a circle around the middle view.
    #[default]
    Round,
    /// Within a square.
    Square,
}

/// Weights (v, u) of the views through an aperture of `size` (0: the middle view alone, 1: as far as the outermost view
/// along an axis; values outside are cut), with a soft rim half a view step wide.
///
/// ```
/// use lenslet::apps::refocus::{ApertureShape, aperture_weights};
///
/// let closed = aperture_weights((3, 3), 0.0, ApertureShape::Round);
/// assert_eq!((closed[[1, 1]], closed.sum()), (1.0, 1.0));
/// assert_eq!(aperture_weights((3, 3), 1.0, ApertureShape::Square).sum(), 9.0);
/// ```
pub fn aperture_weights(views: (usize, usize), size: f32, shape: ApertureShape) -> Array2<f32> {
    let (cv, cu) = ((views.0 / 2) as f32, (views.1 / 2) as f32);
    let reach = cv.max(cu);
    let radius = size.clamp(0.0, 1.0) * reach;
    Array2::from_shape_fn(views, |(v, u)| {
        let (y, x) = ((v as f32 - cv).abs(), (u as f32 - cu).abs());
        let r = if shape == ApertureShape::Round { x.hypot(y) } else { x.max(y) };
        (radius + 0.5 - r).clamp(0.0, 0.5) * 2.0
    })
}

/// Refocuses the light field (v, u, t, s, c) at `disparity` (output pixels per view step) with the view weights
/// `aperture`. Pixels that a shifted view does not reach take the mean of the others. Shape (t, s, c). Values are in
/// linear light, as [`super::to_linear_light`] makes them.
///
/// # Errors
/// [`Error::Shape`] for weights of another shape or a light field not in standard layout, [`Error::Parameter`] for
/// weights that are negative or all zero and for a disparity that is not a number.
///
/// ```
/// use lenslet::apps::refocus::{ApertureShape, aperture_weights, refocus};
/// use ndarray::{Array5, s};
///
/// // A ramp that moves by one pixel a view: at disparity 1 all views agree.
/// let field = Array5::from_shape_fn((3, 3, 8, 12, 1), |(_, u, _, s, _)| s as f32 - (u as f32 - 1.0));
/// let weights = aperture_weights((3, 3), 1.0, ApertureShape::Square);
/// let image = refocus(&field.view(), 1.0, &weights.view())?;
/// assert_eq!(image[[4, 5, 0]], field[[1, 1, 4, 5, 0]]);
/// # Ok::<(), lenslet::apps::Error>(())
/// ```
pub fn refocus(data: &ArrayView5<f32>, disparity: f32, aperture: &ArrayView2<f32>) -> Result<Array3<f32>, Error> {
    let (rows, columns, height, width, channels) = data.dim();
    check(data, aperture)?;
    ensure!(
        Error::Parameter,
        disparity.is_finite() && disparity.abs() < 1e6,
        "a disparity of {disparity} is out of range"
    );
    let mut out = Array3::<f32>::zeros((height, width, channels));
    let stride = width * channels;
    let Some(flat) = out.as_slice_mut() else { return Err(Error::Shape("the image is not contiguous".into())) };
    flat.par_chunks_mut((stride * BAND).max(1)).enumerate().for_each(|(b, band)| {
        let lines = band.len() / stride;
        // Two pixels of margin on each side.
        let margin = 2 * channels;
        let padded = stride + 2 * margin;
        let mut sums = vec![0f32; lines * padded];
        let mut through = vec![0f32; lines];
        let mut weights = vec![0f32; lines * (width + 1)];
        for u in 0..columns {
            let dx = disparity * (u as f32 - (columns / 2) as f32);
            let (ix, fx) = (dx.floor(), dx - dx.floor());
            // Pixels s with s + dx between 0 and the last column; a whole shift needs no right neighbour.
            let next = f32::from(u8::from(fx > 0.0));
            let from = (-ix).clamp(0.0, width as f32) as usize;
            let to = (width as f32 - next - ix).clamp(0.0, width as f32) as usize;
            if from >= to {
                continue;
            }
            // Views of one column move sideways together: their rows are added up first.
            sums.fill(0.0);
            through.fill(0.0);
            for v in 0..rows {
                let a = aperture[[v, u]];
                if a <= 0.0 {
                    continue;
                }
                let view = data.slice(s![v, u, .., .., ..]);
                for (k, (sum, through)) in sums.chunks_exact_mut(padded).zip(&mut through).enumerate() {
                    let y = (b * BAND + k) as f32 + disparity * (v as f32 - (rows / 2) as f32);
                    if y >= 0.0 && y <= (height - 1) as f32 {
                        add_rows(&view, y, a, &mut sum[margin..margin + stride]);
                        *through += a;
                    }
                }
            }
            let w = catmull_rom_weights(fx);
            // First tap of pixel `from`: one left of from + ix, in a row that begins two pixels early.
            let start = ((from as f32 + ix) as usize + 1) * channels;
            let n = (to - from) * channels;
            let lines = band.chunks_exact_mut(stride).zip(weights.chunks_exact_mut(width + 1));
            for ((row, weight), (sum, &through)) in lines.zip(sums.chunks_exact_mut(padded).zip(&through)) {
                if through <= 0.0 {
                    continue;
                }
                for k in 0..margin {
                    sum[k] = sum[margin + k % channels];
                    sum[margin + stride + k] = sum[stride + margin - channels + k % channels];
                }
                let tap = |k: usize| &sum[start + k * channels..start + k * channels + n];
                let taps = tap(0).iter().zip(tap(1)).zip(tap(2).iter().zip(tap(3)));
                for (o, ((p, q), (r, s))) in row[from * channels..to * channels].iter_mut().zip(taps) {
                    *o += w[0] * p + w[1] * q + w[2] * r + w[3] * s;
                }
                weight[from] += through;
                weight[to] -= through;
            }
        }
        for (row, weight) in band.chunks_exact_mut(stride).zip(weights.chunks_exact(width + 1)) {
            let mut sum = 0f32;
            for (pixel, w) in row.chunks_exact_mut(channels).zip(weight) {
                sum += w;
                // What is left of the sum after all views ended is rounding, not weight.
                let share = if sum > 1e-4 { 1.0 / sum } else { 0.0 };
                pixel.iter_mut().for_each(|p| *p *= share);
            }
        }
    });
    Ok(out)
}

/// Adds `a` times the row at height `y` (within the frame) of a view, between rows by Catmull-Rom.
fn add_rows(view: &ArrayView3<f32>, y: f32, a: f32, sum: &mut [f32]) {
    let last = view.dim().0 as isize - 1;
    let (y0, w) = (y.floor() as isize, catmull_rom_weights(y - y.floor()).map(|w| a * w));
    let row = |k: isize| view.index_axis_move(ndarray::Axis(0), (y0 + k).clamp(0, last) as usize);
    let rows = [row(-1), row(0), row(1), row(2)];
    let [Some(p), Some(q), Some(r), Some(s)] = rows.each_ref().map(|r| r.to_slice()) else { return };
    if w[1] == a {
        // A whole shift.
        sum.iter_mut().zip(q).for_each(|(o, q)| *o += a * q);
        return;
    }
    for (o, ((p, q), (r, s))) in sum.iter_mut().zip(p.iter().zip(q).zip(r.iter().zip(s))) {
        *o += w[0] * p + w[1] * q + w[2] * r + w[3] * s;
    }
}

/// Every pixel refocused at its own disparity (t, s); views that differ there from the middle view (something hides the
/// point) count less. Shape (t, s, c).
///
/// # Errors
/// As [`refocus`]; [`Error::Shape`] for a disparity map of another size.
pub fn all_in_focus(
    data: &ArrayView5<f32>,
    disparity: &ArrayView2<f32>,
    aperture: &ArrayView2<f32>,
) -> Result<Array3<f32>, Error> {
    let (rows, columns, height, width, channels) = data.dim();
    check(data, aperture)?;
    ensure!(
        Error::Shape,
        disparity.dim() == (height, width),
        "the disparity has {:?} pixels, the views {height}x{width}",
        disparity.dim()
    );
    let middle = data.slice(s![rows / 2, columns / 2, .., .., ..]);
    let mut out = Array3::<f32>::zeros((height, width, channels));
    let Some(flat) = out.as_slice_mut() else { return Err(Error::Shape("the image is not contiguous".into())) };
    flat.par_chunks_mut(width * channels).enumerate().for_each(|(t, row)| {
        let mut value = [0f32; 4];
        for (s, pixel) in row.chunks_exact_mut(channels).enumerate() {
            let d = disparity[[t, s]];
            let own = middle.slice(s![t, s, ..]);
            let mut sum = 0f32;
            for ((v, u), &a) in aperture.indexed_iter() {
                let (x, y) =
                    (s as f32 + d * (u as f32 - (columns / 2) as f32), t as f32 + d * (v as f32 - (rows / 2) as f32));
                let inside = x >= 0.0 && y >= 0.0 && x <= (width - 1) as f32 && y <= (height - 1) as f32;
                if a <= 0.0 || !inside {
                    continue;
                }
                let cell = Cell::clamped(x, y, Size::new(width, height));
                let mut off = 0f32;
                for k in 0..channels {
                    value[k] = bilinear_by_weights(cell.corners(|x, y| data[[v, u, y, x, k]]), cell.fx, cell.fy);
                    off += (value[k] - own[k]).powi(2);
                }
                let w = a / (1.0 + off / (channels as f32 * HALF_WEIGHT));
                sum += w;
                for (p, v) in pixel.iter_mut().zip(&value) {
                    *p += w * v;
                }
            }
            for (k, p) in pixel.iter_mut().enumerate() {
                *p = if sum > 0.0 { *p / sum } else { own[k] };
            }
        }
    });
    Ok(out)
}

fn check(data: &ArrayView5<f32>, aperture: &ArrayView2<f32>) -> Result<(), Error> {
    let (rows, columns, height, width, channels) = data.dim();
    ensure!(
        Error::Shape,
        height > 0 && width > 0 && (1..=4).contains(&channels),
        "views of {width}x{height} with {channels} channels cannot be refocused"
    );
    ensure!(
        Error::Shape,
        aperture.dim() == (rows, columns),
        "the aperture has {:?} weights for {rows}x{columns} views",
        aperture.dim()
    );
    let sum: f32 = aperture.iter().sum();
    ensure!(
        Error::Parameter,
        sum > 0.0 && sum.is_finite() && aperture.iter().all(|a| *a >= 0.0),
        "the aperture gives no view a weight"
    );
    ensure!(Error::Shape, data.is_standard_layout(), "the light field is not in (v, u, t, s, c) order in memory");
    Ok(())
}

/// The disparity of what lies at pixel (`x`, `y`) of the middle view, from the surroundings of that pixel alone.
///
/// # Errors
/// [`Error::Parameter`] for a point outside of the views, [`Error::Disparity`] as [`disparity::estimate_disparity`] has it.
pub fn disparity_at(
    data: &ArrayView5<f32>,
    (x, y): (f32, f32),
    options: &disparity::Options,
    observer: &dyn lenslet_core::progress::Observer,
) -> Result<f32, Error> {
    let (rows, columns, height, width, _) = data.dim();
    let inside = x >= 0.0 && y >= 0.0 && x <= (width.max(1) - 1) as f32 && y <= (height.max(1) - 1) as f32;
    ensure!(Error::Parameter, inside, "the point {x},{y} is outside of the views of {width}x{height}");
    let reach = (rows.max(columns) / 2) as f32;
    // The range of the whole light field: the surroundings of a point may show too little.
    let (low, high) = match options.range {
        Some(range) => range,
        None => disparity::find_disparity_range(data, options, observer)?,
    };
    let options = &disparity::Options { range: Some((low, high)), ..options.clone() };
    let margin = (24.0 + low.abs().max(high.abs()).min(256.0) * reach) as usize;
    let (cx, cy) = (x as usize, y as usize);
    let (x0, x1) = (cx.saturating_sub(margin), (cx + margin + 1).min(width));
    let (y0, y1) = (cy.saturating_sub(margin), (cy + margin + 1).min(height));
    let part = data.slice(s![.., .., y0..y1, x0..x1, ..]);
    let found = disparity::estimate_disparity(&part, options, observer)?;
    // The disparity of the best pixel close by: confidence times a Gaussian of the distance (4 pixels).
    let (px, py) = (x - x0 as f32, y - y0 as f32);
    let mut best = (f32::NEG_INFINITY, 0f32);
    for ((t, s), &d) in found.disparity.indexed_iter() {
        let r2 = (s as f32 - px).powi(2) + (t as f32 - py).powi(2);
        let score = found.confidence[[t, s]] * (-r2 / 32.0).exp();
        if score > best.0 {
            best = (score, d);
        }
    }
    Ok(best.1)
}

/// How sharp an image (t, s, c) is: mean squared difference of the luminances of neighbouring pixels.
pub fn sharpness(image: &ArrayView3<f32>) -> f64 {
    let (height, width, channels) = image.dim();
    let y = |t: usize, s: usize| {
        if channels >= 3 { (0..3).map(|k| LUMINANCE[k] * image[[t, s, k]]).sum::<f32>() } else { image[[t, s, 0]] }
    };
    let mut sum = 0f64;
    for t in 0..height.saturating_sub(1) {
        for s in 0..width.saturating_sub(1) {
            let own = y(t, s);
            sum += f64::from((y(t, s + 1) - own).powi(2) + (y(t + 1, s) - own).powi(2));
        }
    }
    sum / (height.max(2) - 1) as f64 / (width.max(2) - 1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array5;

    /// Two planes side by side: the left half at disparity `a`, the right half at `b`.
    fn planes(a: f32, b: f32) -> Array5<f32> {
        let texture =
            |x: f32, y: f32| 0.5 + 0.2 * (0.6 * x).sin() * (0.5 * y).cos() + 0.2 * (0.37 * x + 0.71 * y).sin();
        Array5::from_shape_fn((5, 5, 40, 80, 3), |(v, u, t, s, c)| {
            let d = if s < 40 { a } else { b };
            let (x, y) = (s as f32 - d * (u as f32 - 2.0), t as f32 - d * (v as f32 - 2.0));
            texture(x, y) * (1.0 - 0.1 * c as f32)
        })
    }

    /// The sum of the definition, pixel by pixel.
    fn plain(data: &ArrayView5<f32>, d: f32, a: &Array2<f32>) -> Array3<f32> {
        let (rows, columns, h, w, c) = data.dim();
        Array3::from_shape_fn((h, w, c), |(t, s, k)| {
            let (mut sum, mut weight) = (0.0, 0.0);
            for v in 0..rows {
                for u in 0..columns {
                    let x = s as f32 + d * (u as f32 - (columns / 2) as f32);
                    let y = t as f32 + d * (v as f32 - (rows / 2) as f32);
                    if x < 0.0 || y < 0.0 || x > (w - 1) as f32 || y > (h - 1) as f32 {
                        continue;
                    }
                    let (wx, wy) = (catmull_rom_weights(x - x.floor()), catmull_rom_weights(y - y.floor()));
                    for j in 0..4 {
                        for i in 0..4 {
                            let px = (x.floor() as isize + i - 1).clamp(0, w as isize - 1) as usize;
                            let py = (y.floor() as isize + j - 1).clamp(0, h as isize - 1) as usize;
                            sum += a[[v, u]] * wx[i as usize] * wy[j as usize] * data[[v, u, py, px, k]];
                        }
                    }
                    weight += a[[v, u]];
                }
            }
            sum / weight
        })
    }

    #[test]
    fn fast_refocusing_equals_the_definition() {
        let field = planes(0.8, -0.6);
        let a = aperture_weights((5, 5), 0.8, ApertureShape::Round);
        for d in [0.0, 0.8, -1.3, 2.0] {
            let fast = refocus(&field.view(), d, &a.view()).unwrap();
            let slow = plain(&field.view(), d, &a);
            let off = fast.iter().zip(&slow).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
            assert!(off < 1e-4, "disparity {d}: {off}");
        }
    }

    #[test]
    fn each_plane_is_sharpest_at_its_disparity() {
        let field = planes(0.8, -0.6);
        let a = aperture_weights((5, 5), 1.0, ApertureShape::Square);
        let list: Vec<f32> = (-20..=20).map(|k| 0.1 * k as f32).collect();
        for (range, truth) in [(6..34, 0.8f32), (46..74, -0.6)] {
            let best = list
                .iter()
                .map(|&d| {
                    let image = refocus(&field.view(), d, &a.view()).unwrap();
                    (sharpness(&image.slice(s![6..34, range.clone(), ..])), d)
                })
                .max_by(|x, y| x.0.total_cmp(&y.0))
                .unwrap()
                .1;
            assert!((best - truth).abs() < 0.11, "sharpest at {best}, planted {truth}");
        }
    }

    #[test]
    fn energy_is_kept() {
        let field = Array5::from_elem((5, 5, 20, 30, 3), 0.37f32);
        let a = aperture_weights((5, 5), 1.0, ApertureShape::Round);
        for d in [0.0, 1.7, -3.2] {
            let image = refocus(&field.view(), d, &a.view()).unwrap();
            assert!(image.iter().all(|v| (v - 0.37).abs() < 1e-5));
        }
    }

    #[test]
    fn a_closed_aperture_is_the_middle_view() {
        let field = planes(0.8, -0.6);
        let image = refocus(&field.view(), 1.3, &aperture_weights((5, 5), 0.0, ApertureShape::Round).view()).unwrap();
        assert_eq!(image, field.slice(s![2, 2, .., .., ..]));
    }

    #[test]
    fn pointing_finds_the_plane() {
        let field = planes(0.8, -0.6);
        let options = disparity::Options { linear: true, limit: 2.0, ..Default::default() };
        for (x, truth) in [(20.0, 0.8f32), (60.0, -0.6)] {
            let d = disparity_at(&field.view(), (x, 20.0), &options, &lenslet_core::progress::Silent).unwrap();
            assert!((d - truth).abs() < 0.1, "at {x}: {d}, planted {truth}");
        }
        assert!(disparity_at(&field.view(), (80.0, 0.0), &options, &lenslet_core::progress::Silent).is_err());
        assert!(disparity_at(&field.view(), (f32::NAN, 0.0), &options, &lenslet_core::progress::Silent).is_err());
    }

    #[test]
    fn all_in_focus_is_the_middle_view_where_disparity_is_right() {
        let field = planes(0.8, -0.6);
        let map = Array2::from_shape_fn((40, 80), |(_, s)| if s < 40 { 0.8f32 } else { -0.6 });
        let image =
            all_in_focus(&field.view(), &map.view(), &aperture_weights((5, 5), 1.0, ApertureShape::Round).view())
                .unwrap();
        let own = field.slice(s![2, 2, .., .., ..]);
        let off = (&image.slice(s![4..36, 4..34, ..]) - &own.slice(s![4..36, 4..34, ..])).mapv(f32::abs);
        assert!(off.mean().unwrap() < 0.02);
    }
}
