//! Demosaic by co-kriging: every view's colour at every lenslet, directly from the pixels of the lenslet's micro-image.
//!
//! Objective: of all linear estimates from the lenslet's own pixels that return every constant colour and every linear
//! change of light over the micro-image exactly, the one with the least expected squared error (ordinary co-kriging).
//! Model: the colours share one field (luminance) and have one each (chrominance), both with Matérn-3/2 correlation
//! over the micro-image; noise grows where the micro-image darkens. Nothing is taken from a neighbouring micro-image,
//! and nothing is interpolated twice.
//!
//! The weights depend only on where the centre lies between the pixels and on the filter array's parity, so they are
//! computed once for each of a grid of sub-pixel positions and applied to all lenslets that share it.

use std::sync::atomic::{AtomicBool, Ordering};

use ndarray::{Array2, Array3};
use rayon::prelude::*;

use super::error::Error;
use super::micro_image::neighbour_offsets;
use super::mosaic::{Mosaic, mirror};
use super::samples::{HexSamples, view_offset};
use crate::calibration::{Calibration, Lattice};
use crate::container::Cfa;
use crate::linalg::{Cholesky, gauss_jordan};
use crate::progress::Observer;

/// Sub-pixel positions per pixel and axis: centres are rounded by at most 1/32 pixel.
///
/// Source: chosen.
const PHASES: i32 = 16;
/// Correlation length of luminance within a micro-image, pixels.
///
/// Source: chosen.
const LUMINANCE_LENGTH: f64 = 4.0;
/// Correlation length of chrominance, pixels.
///
/// Source: chosen.
const CHROMINANCE_LENGTH: f64 = 6.0;
/// Variance of a colour's own field, that of the shared one being 1.
///
/// Source: chosen.
const COLOUR_SHARE: f64 = 0.5;
/// Variance of the noise in full light, that of the signal being 1.
///
/// Source: chosen.
const NOISE: f64 = 0.006;
/// Variance (pixels², per axis) of the positions whose light a pixel collects: that of the pixel's area, 1/12, and of
/// an optical blur of σ 0.6 pixels.
///
/// Source: chosen.
const SPREAD: f64 = 1.0 / 12.0 + 0.36;
/// Margin towards neighbouring micro-images that is left out, pixels: pixels there hold light of both.
///
/// Source: chosen.
const MARGIN: f64 = 0.3;
/// Pixels of a micro-image that share one system; larger micro-images have one of [`NEAREST`] pixels for each view, so
/// that the time grows with the number of lenslets and not with the sixth power of their pitch.
///
/// Source: chosen; a pitch of about 17 pixels.
const MOST_TOGETHER: usize = 256;
/// Pixels nearest a view that estimate it in large micro-images.
///
/// Source: chosen; two thirds of what the micro-image of an F01 holds.
const NEAREST: usize = 56;
/// A smaller pivot means that the constraints contradict each other.
///
/// Source: chosen.
const LEAST_PIVOT: f64 = 1e-12;

/// Colours of a filter array; a sensor without one needs no demosaic.
const COLOURS: usize = 3;

/// The inputs of a set of weights.
struct Model<'a> {
    lattice: &'a Lattice,
    cfa: Cfa,
    /// Mean relative light by distance from the centre, quarter pixels.
    light: Vec<f64>,
    /// Half width of the window, pixels.
    reach: i32,
    views: usize,
    view_step: f64,
}

/// Weights of one sub-pixel position: `pixels.len()` rows of `outputs` values.
struct Weights {
    pixels: Vec<(i32, i32)>,
    rows: Vec<f32>,
    outputs: usize,
}

/// Values `(views², lenslets, channels)` of a developed mosaic at the lenslets and offsets of `samples`.
pub(super) fn sample_views(
    mosaic: &Mosaic,
    cfa: Cfa,
    calibration: &Calibration,
    samples: &HexSamples,
    observer: &dyn Observer,
) -> Result<Array3<f32>, Error> {
    let pitch = calibration.lattice.pitch();
    if !(4.0..=64.0).contains(&pitch) {
        return Err(Error::Calibration(format!("lenslets {pitch} pixels apart: 4 to 64 are supported here")));
    }
    let model = Model {
        lattice: &calibration.lattice,
        cfa,
        light: mean_profile(calibration),
        reach: (pitch * 0.62).ceil() as i32,
        views: samples.views,
        view_step: samples.view_step,
    };
    let channels = COLOURS;
    let n = samples.views * samples.views;

    // Lenslets by the sub-pixel position of their centre; the order within a group depends on the lattice only.
    let mut order: Vec<(u32, u32)> =
        samples.centres.iter().enumerate().map(|(k, c)| (phase_key(*c), k as u32)).collect();
    order.par_sort_unstable();
    let groups: Vec<&[(u32, u32)]> = order.chunk_by(|a, b| a.0 == b.0).collect();

    observer.begin("sampling lenslets", groups.len() as u64);
    let failed = AtomicBool::new(false);
    let parts: Vec<Vec<f32>> = groups
        .par_iter()
        .map(|group| {
            if observer.cancelled() {
                return Vec::new();
            }
            let Some(weights) = solve_weights(&model, group[0].0) else {
                failed.store(true, Ordering::Relaxed);
                return Vec::new();
            };
            let mut out = vec![0f32; group.len() * weights.outputs];
            for (o, &(_, k)) in out.chunks_exact_mut(weights.outputs).zip(group.iter()) {
                apply_weights(&weights, mosaic, samples.centres[k as usize], o);
            }
            observer.advance(1);
            out
        })
        .collect();
    observer.check()?;
    if failed.into_inner() {
        return Err(Error::Calibration("its lattice leaves micro-images without pixels of every colour".into()));
    }
    let mut values = Array3::zeros((n, samples.centres.len(), channels));
    if let Some(flat) = values.as_slice_mut() {
        flat.par_chunks_mut(samples.centres.len() * channels).enumerate().for_each(|(view, to)| {
            for (group, part) in groups.iter().zip(&parts) {
                for (&(_, k), from) in group.iter().zip(part.chunks_exact(n * channels)) {
                    let k = k as usize * channels;
                    to[k..k + channels].copy_from_slice(&from[view * channels..(view + 1) * channels]);
                }
            }
        });
    }
    Ok(values)
}

/// Nearest pixel of a centre, and its sub-pixel cell (0..PHASES on both axes).
fn split(v: f64) -> (i64, i32) {
    let cells = (v * f64::from(PHASES)).round() as i64;
    let pixel = (cells + i64::from(PHASES) / 2).div_euclid(i64::from(PHASES));
    (pixel, (cells - pixel * i64::from(PHASES)) as i32 + PHASES / 2)
}

/// Parity of the nearest pixel and sub-pixel cell as one number.
fn phase_key(c: [f64; 2]) -> u32 {
    let ((x, fx), (y, fy)) = (split(c[0]), split(c[1]));
    let parity = (y.rem_euclid(2) * 2 + x.rem_euclid(2)) as u32;
    (parity * PHASES as u32 + fy as u32) * PHASES as u32 + fx as u32
}

/// Mean white image by distance from the centre, in quarter pixels, over lenslets spread over the sensor.
fn mean_profile(calibration: &Calibration) -> Vec<f64> {
    let bins = (calibration.lattice.pitch() * 4.0) as usize + 8;
    let Some(v) = &calibration.vignetting else { return vec![1.0; bins] };
    let reach = (calibration.lattice.pitch() * 0.62).ceil() as i64;
    let mut sums = vec![(0f64, 0f64); bins];
    let every = (calibration.lenslets.len() / 2000).max(1);
    for l in calibration.lenslets.iter().step_by(every) {
        let (x0, y0) = (l.x.round() as i64, l.y.round() as i64);
        for y in y0 - reach..=y0 + reach {
            for x in x0 - reach..=x0 + reach {
                if x < 0 || y < 0 || x >= v.width as i64 || y >= v.height as i64 {
                    continue;
                }
                let d = (x as f64 - l.x).hypot(y as f64 - l.y);
                let bin = &mut sums[((d * 4.0) as usize).min(bins - 1)];
                bin.0 += f64::from(v.white[y as usize * v.width + x as usize]) / 32768.0;
                bin.1 += 1.0;
            }
        }
    }
    let mut light: Vec<f64> = sums.iter().map(|&(s, n)| if n > 0.0 { s / n } else { f64::NAN }).collect();
    // Empty bins repeat the one before.
    let mut last = 1.0;
    for l in &mut light {
        if !l.is_finite() {
            *l = last;
        }
        last = *l;
    }
    let full = light.iter().copied().fold(1e-3, f64::max);
    light.iter().map(|l| (l / full).clamp(0.02, 1.0)).collect()
}

/// Mean position of the light that the pixel at `d` from its lenslet's centre collects: `d`, moved towards the brighter
/// side by [`SPREAD`] times the slope of the logarithm of the white image.
fn light_centre(d: [f64; 2], light: &[f64]) -> [f64; 2] {
    let r = d[0].hypot(d[1]);
    let at = |r: f64| {
        let bin = (4.0 * r - 0.5).clamp(0.0, (light.len() - 1) as f64);
        let (k, f) = (bin as usize, bin.fract());
        light[k] + f * (light[(k + 1).min(light.len() - 1)] - light[k])
    };
    if r < 1e-6 {
        return d;
    }
    let slope = (at(r + 0.5) / at((r - 0.5).max(0.0))).ln() / (r + 0.5 - (r - 0.5).max(0.0));
    let moved = (SPREAD * slope).clamp(-0.3, 0.3);
    let factor = (1.0 + moved / r).max(0.0);
    [d[0] * factor, d[1] * factor]
}

/// Matérn correlation, ν = 3/2.
fn matern(r: f64, length: f64) -> f64 {
    let a = 3f64.sqrt() * r / length;
    (1.0 + a) * (-a).exp()
}

/// The weights of one sub-pixel position. `None` when a colour has no pixel in the micro-image.
fn solve_weights(model: &Model<'_>, key: u32) -> Option<Weights> {
    let cells = PHASES as u32;
    let (parity, fy, fx) = (key / (cells * cells), (key / cells) % cells, key % cells);
    let sub = |f: u32| (f64::from(f) - f64::from(PHASES / 2)) / f64::from(PHASES);
    let centre = [sub(fx), sub(fy)];
    let (px, py) = ((parity & 1) as usize, (parity >> 1) as usize);
    let channels = COLOURS;
    let around: Vec<[f64; 2]> = neighbour_offsets(model.lattice);

    let mut pixels = Vec::new();
    let mut places: Vec<([f64; 2], usize)> = Vec::new();
    for dy in -model.reach..=model.reach {
        for dx in -model.reach..=model.reach {
            let d = [f64::from(dx) - centre[0], f64::from(dy) - centre[1]];
            let own = around.iter().all(|n| {
                let length = n[0].hypot(n[1]);
                (d[0] * n[0] + d[1] * n[1]) / length <= length / 2.0 - MARGIN
            });
            if own {
                let even = |p: usize, d: i32| (p as i32 + d).rem_euclid(2) as usize;
                let colour = model.cfa.colour(even(px, dx), even(py, dy));
                pixels.push((dx, dy));
                places.push((light_centre(d, &model.light), colour));
            }
        }
    }
    let m = pixels.len();
    if (0..channels).any(|c| !places.iter().any(|p| p.1 == c)) {
        return None;
    }
    let all: Vec<usize> = (0..m).collect();
    let views: Vec<usize> = (0..model.views * model.views).collect();
    let outputs = views.len() * channels;
    let noise: Vec<f64> = pixels.iter().map(|&p| noise_of(model, p, centre)).collect();
    if m <= MOST_TOGETHER {
        let rows = solve_rows(model, &all, &places, &noise, &views)?;
        return Some(Weights { pixels, rows, outputs });
    }
    // Far pixels add next to nothing: each view has the system of its nearest ones.
    let mut rows = vec![0f32; m * outputs];
    for &view in &views {
        let [u, v] = view_offset(model.views, model.view_step, view);
        let distance = |i: usize| (places[i].0[0] - u).powi(2) + (places[i].0[1] - v).powi(2);
        let mut near = all.clone();
        near.sort_by(|&i, &k| distance(i).total_cmp(&distance(k)).then(i.cmp(&k)));
        near.truncate(NEAREST);
        let own = solve_rows(model, &near, &places, &noise, &[view])?;
        for (&i, row) in near.iter().zip(own.chunks_exact(channels)) {
            rows[i * outputs + view * channels..][..channels].copy_from_slice(row);
        }
    }
    Some(Weights { pixels, rows, outputs })
}

/// Variance of the noise of the pixel at an offset from the nearest one of a centre.
fn noise_of(model: &Model<'_>, (dx, dy): (i32, i32), centre: [f64; 2]) -> f64 {
    let p = [f64::from(dx) - centre[0], f64::from(dy) - centre[1]];
    let bin = ((p[0].hypot(p[1]) * 4.0) as usize).min(model.light.len() - 1);
    NOISE / (model.light[bin] * model.light[bin])
}

/// The weights of the pixels `used` for `views`: a row of `views.len() * channels` values for each.
fn solve_rows(
    model: &Model<'_>,
    used: &[usize],
    places: &[([f64; 2], usize)],
    noise: &[f64],
    views: &[usize],
) -> Option<Vec<f32>> {
    let (m, channels) = (used.len(), COLOURS);
    let covariance = |d: [f64; 2], same: bool| {
        let r = d[0].hypot(d[1]);
        matern(r, LUMINANCE_LENGTH) + if same { COLOUR_SHARE * matern(r, CHROMINANCE_LENGTH) } else { 0.0 }
    };
    let mut k = Array2::<f64>::from_shape_fn((m, m), |(i, j)| {
        let ((p, a), (q, b)) = (places[used[i]], places[used[j]]);
        covariance([p[0] - q[0], p[1] - q[1]], a == b)
    });
    for (i, &pixel) in used.iter().enumerate() {
        k[[i, i]] += noise[pixel];
    }
    // Right-hand sides: the covariance with each output, then one column for each constraint: which pixels are of each
    // colour, and the places of all.
    let outputs = views.len() * channels;
    let constraints = channels + 2;
    let place = |o: usize| view_offset(model.views, model.view_step, views[o / channels]);
    let constraint = |i: usize, k: usize| match places[used[i]] {
        (d, _) if k >= channels => d[k - channels],
        (_, colour) => f64::from(u8::from(colour == k)),
    };
    let w = Array2::<f64>::from_shape_fn((m, outputs + constraints), |(i, o)| {
        if o >= outputs {
            return constraint(i, o - outputs);
        }
        let (p, a) = places[used[i]];
        let [u, v] = place(o);
        covariance([p[0] - u, p[1] - v], a == o % channels)
    });
    let w = Cholesky::new(k.view()).ok()?.solve(w.view());
    // Lagrange: sums over the pixels of each colour must be 1 for the output's colour and 0 for the others, and the
    // mean place must be that of the view, so that estimates are unbiased for constant and for linear light.
    let sums = |o: usize, k: usize| -> f64 { (0..m).map(|i| constraint(i, k) * w[[i, o]]).sum() };
    let missing = |k: usize, o: usize| {
        let wanted = if k >= channels { place(o)[k - channels] } else { f64::from(u8::from(o % channels == k)) };
        wanted - sums(o, k)
    };
    // Rows [S | missing], which become [· | factors].
    let entry = |k: usize, c: usize| if c < constraints { sums(outputs + c, k) } else { missing(k, c - constraints) };
    let row = |k: usize| (0..constraints + outputs).map(|c| entry(k, c)).collect();
    let mut factor: Vec<Vec<f64>> = (0..constraints).map(row).collect();
    gauss_jordan(&mut factor, LEAST_PIVOT)?;
    let mut rows = vec![0f32; m * outputs];
    for o in 0..outputs {
        for i in 0..m {
            let extra: f64 = (0..constraints).map(|k| factor[k][constraints + o] * w[[i, outputs + k]]).sum();
            rows[i * outputs + o] = (w[[i, o]] + extra) as f32;
        }
    }
    Some(rows)
}

/// One lenslet: its pixels times the weights. Beyond the sensor's border pixels are mirrored.
fn apply_weights(weights: &Weights, mosaic: &Mosaic, centre: [f64; 2], out: &mut [f32]) {
    let (x, y) = (split(centre[0]).0, split(centre[1]).0);
    out.fill(0.0);
    for (&(dx, dy), row) in weights.pixels.iter().zip(weights.rows.chunks_exact(weights.outputs)) {
        let value = mosaic.data
            [mirror(y + i64::from(dy), mosaic.height) * mosaic.width + mirror(x + i64::from(dx), mosaic.width)];
        for (o, w) in out.iter_mut().zip(row) {
            *o += w * value;
        }
    }
}

#[cfg(test)]
mod tests;
