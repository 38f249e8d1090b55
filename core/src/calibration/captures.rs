//! Calibration without white images: several ordinary captures, each divided by the local mean of each colour, average to the
//! lenslet pattern. What a lenslet's own centre is worth is told by how well the captures agree on it.

use rayon::prelude::*;

use super::measure::{Measured, Site, measure};
use super::refine::{self, Refined};
use super::usable::Kept;
use super::{Error, Options, Plane, average, guess, hot, lattice, phase, shrink, spectrum, usable};
use crate::container::Capture;
use crate::progress::Observer;

/// Half the side of the box a pixel is compared with, pixels; a box holds at least a lenslet of the largest pitch looked for.
const BOX: usize = 24;
/// Local light (share of full scale) at which a capture's say is halved: dark places are noise.
const DIM: f32 = 0.02;
/// A capture whose pattern agrees less than this with that of all is of another camera, turned, or none.
const STRANGE: f64 = 0.3;

/// The pattern of the captures that show it, and what was found in it. Captures that do not show it are left out of `kept`, with
/// a note.
///
/// # Errors
/// As [`super::from_captures`].
pub fn found(kept: &mut Vec<Kept>, options: &Options, observer: &dyn Observer) -> Result<(Plane, Refined), Error> {
    let strange = || Error::NoPattern { reason: "its pattern is not that of the others".into() };
    loop {
        observer.begin("pattern", kept.len() as u64);
        let mut plane = pattern(kept, &options.hot_pixels, observer)?;
        let hint = kept.iter().find_map(|(_, c)| c.mla.as_ref());
        let refined = match refine::refine(&mut plane, hint, &options.hot_pixels, observer) {
            Err(e @ Error::NoPattern { .. }) if kept.len() > 1 => {
                let before = kept.len();
                leave_out_unless(kept, &e, options, observer, |plane, capture| {
                    guess::lock(plane, &spectrum::spectrum(plane), capture.mla.as_ref()).is_ok()
                })?;
                if kept.is_empty() || kept.len() == before {
                    return Err(e);
                }
                continue;
            }
            other => other?,
        };
        if kept.len() > 1 {
            let before = kept.len();
            let lattice = refined.lattice;
            leave_out_unless(kept, &strange(), options, observer, |plane, _| {
                phase::agreement(plane, &lattice) >= STRANGE
            })?;
            if kept.is_empty() {
                return Err(Error::NoPattern { reason: "the captures do not agree on one".into() });
            }
            if kept.len() < before {
                continue;
            }
        }
        return Ok((plane, refined));
    }
}

/// Keeps the captures of which `shows` holds; `why` is noted of the others.
fn leave_out_unless(
    kept: &mut Vec<Kept>,
    why: &Error,
    options: &Options,
    observer: &dyn Observer,
    shows: impl Fn(&Plane, &Capture) -> bool,
) -> Result<(), Error> {
    let mut stay = Vec::with_capacity(kept.len());
    for &(n, capture) in kept.iter() {
        let (plane, _) = flattened(capture, &options.hot_pixels)?;
        if shows(&plane, capture) {
            stay.push((n, capture));
        } else {
            usable::leave_out(n, why, options, observer);
        }
        if observer.cancelled() {
            return Err(Error::Interrupted);
        }
    }
    *kept = stay;
    Ok(())
}

/// The pattern of all captures together: local mean 1, scene averaged away as far as there are captures.
fn pattern(captures: &[Kept], hot_pixels: &[u32], observer: &dyn Observer) -> Result<Plane, Error> {
    let mut sum: Option<(Plane, Vec<f32>)> = None;
    for (_, capture) in captures {
        let (plane, weight) = flattened(capture, hot_pixels)?;
        let (total, weights) = sum.get_or_insert_with(|| {
            let zeros = vec![0f32; plane.data.len()];
            (Plane { data: zeros.clone(), ..plane.clone() }, zeros)
        });
        total.data.par_iter_mut().zip(weights.par_iter_mut()).zip(plane.data.par_iter().zip(&weight)).for_each(
            |((t, s), (&v, &w))| {
                *t += w * v;
                *s += w;
            },
        );
        observer.advance(1);
        if observer.cancelled() {
            return Err(Error::Interrupted);
        }
    }
    let (mut plane, weights) = sum.ok_or(Error::NoImages)?;
    plane.data.par_iter_mut().zip(&weights).for_each(|(v, &w)| *v = if w > 1e-4 { *v / w } else { 1.0 });
    Ok(plane)
}

/// One capture, each pixel over the mean of its like about it, and how much to trust each pixel.
fn flattened(capture: &Capture, hot_pixels: &[u32]) -> Result<(Plane, Vec<f32>), Error> {
    let mut plane = average::average(std::slice::from_ref(capture), |v| v)?;
    hot::fill(&mut plane, hot_pixels);
    let means = local_means(&plane, BOX);
    let mut weights = vec![0f32; plane.data.len()];
    plane.data.par_iter_mut().zip(weights.par_iter_mut()).zip(&means).for_each(|((v, w), &mean)| {
        let saturated = *v >= 0.999;
        let light = mean.max(0.0);
        *w = if saturated || light < 1e-3 { 0.0 } else { light / (light + DIM) };
        // A highlight within a dark box must not outshout the pattern.
        *v = if light < 1e-3 { 1.0 } else { (*v / light).min(4.0) };
    });
    plane.limit = [f32::INFINITY; 4];
    Ok((plane, weights))
}

/// Mean of the pixels of the same place of the 2×2 tile within `half` pixels in x and y.
fn local_means(plane: &Plane, half: usize) -> Vec<f32> {
    let (width, height) = (plane.width, plane.height);
    let reach = half / 2;
    let mut rows = vec![0f32; width * height];
    rows.par_chunks_mut(width).zip(plane.data.par_chunks(width)).for_each(|(out, row)| {
        for parity in 0..2.min(width) {
            let like: Vec<f32> = row[parity..].iter().step_by(2).copied().collect();
            for (k, mean) in sliding(&like, reach).into_iter().enumerate() {
                out[parity + 2 * k] = mean;
            }
        }
    });
    // Columns in strips, so that memory is read along rows.
    let mut out = vec![0f32; width * height];
    for parity in 0..2.min(height) {
        let lines = (height - parity).div_ceil(2);
        let strips: Vec<(usize, Vec<f32>)> = (0..width.div_ceil(64))
            .into_par_iter()
            .map(|s| {
                let (x0, x1) = (s * 64, ((s + 1) * 64).min(width));
                let mut strip = vec![0f32; lines * (x1 - x0)];
                let mut sums = vec![0f64; x1 - x0];
                let line = |k: usize| &rows[(parity + 2 * k) * width + x0..(parity + 2 * k) * width + x1];
                let (mut low, mut high) = (0, 0);
                for k in 0..lines {
                    while high < lines && high <= k + reach {
                        sums.iter_mut().zip(line(high)).for_each(|(s, &v)| *s += f64::from(v));
                        high += 1;
                    }
                    while low + reach < k {
                        sums.iter_mut().zip(line(low)).for_each(|(s, &v)| *s -= f64::from(v));
                        low += 1;
                    }
                    let share = 1.0 / (high - low) as f64;
                    let target = &mut strip[k * (x1 - x0)..(k + 1) * (x1 - x0)];
                    target.iter_mut().zip(&sums).for_each(|(t, &s)| *t = (s * share) as f32);
                }
                (x0, strip)
            })
            .collect();
        for (x0, strip) in strips {
            let w = strip.len() / lines;
            for (k, part) in strip.chunks(w).enumerate() {
                let at = (parity + 2 * k) * width + x0;
                out[at..at + w].copy_from_slice(part);
            }
        }
    }
    out
}

/// Means over `reach` items to either side.
fn sliding(values: &[f32], reach: usize) -> Vec<f32> {
    let mut sum = 0f64;
    let (mut low, mut high) = (0, 0);
    (0..values.len())
        .map(|k| {
            while high < values.len() && high <= k + reach {
                sum += f64::from(values[high]);
                high += 1;
            }
            while low + reach < k {
                sum -= f64::from(values[low]);
                low += 1;
            }
            (sum / (high - low) as f64) as f32
        })
        .collect()
}

/// Weighs each lenslet's own centre by what the captures, each measured alone, agree on: what they share is the lenslet's, what
/// they do not is the scene's. With one capture nothing can be told, and the lattice alone stands.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn agree(
    captures: &[Kept],
    hot_pixels: &[u32],
    size: (usize, usize),
    found: &mut Refined,
    observer: &dyn Observer,
) -> Result<(), Error> {
    let (width, height) = size;
    let grid = found.lattice;
    if captures.len() == 1 {
        for l in &mut found.lenslets {
            [l.x, l.y] = grid.centre(l.i, l.j);
            l.trust = 0.0;
        }
        let (right, bottom) = ((width - 1) as f64, (height - 1) as f64);
        found.lenslets.retain(|l| l.x >= 0.0 && l.y >= 0.0 && l.x <= right && l.y <= bottom);
        return Ok(());
    }
    let places: Vec<Site> = lattice::indices(&grid, width, height, 1.0)
        .into_iter()
        .map(|[i, j]| {
            let [x, y] = grid.centre(i, j);
            Site { i, j, x, y, gain: 1.0, slope: [0.0; 2] }
        })
        .collect();
    let mut sums = vec![[0f64; 5]; places.len()];
    for (_, capture) in captures {
        let (mut plane, _) = flattened(capture, hot_pixels)?;
        hot::mask(&mut plane, hot_pixels);
        let measured = measure(&plane, &found.profile, &places, f64::INFINITY);
        let typical = shrink::typical_misfit(&measured).powi(2);
        for ((sum, m), site) in sums.iter_mut().zip(&measured).zip(&places) {
            let (dx, dy) = (m.x - site.x, m.y - site.y);
            if m.usable && m.misfit < 4.0 * typical && dx.hypot(dy) < 0.15 * grid.pitch() {
                for (slot, v) in sum.iter_mut().zip([1.0, dx, dy, dx * dx, dy * dy]) {
                    *slot += v;
                }
            }
        }
        observer.advance(1);
        if observer.cancelled() {
            return Err(Error::Interrupted);
        }
    }
    // Variance between captures, pooled over all lenslets seen at least twice.
    let (mut within, mut degrees) = ([0f64; 2], 0f64);
    for s in sums.iter().filter(|s| s[0] >= 2.0) {
        within[0] += s[3] - s[1] * s[1] / s[0];
        within[1] += s[4] - s[2] * s[2] / s[0];
        degrees += s[0] - 1.0;
    }
    let measured: Vec<Measured> = places
        .iter()
        .zip(&sums)
        .map(|(p, s)| {
            let n = s[0].max(1.0);
            let mut m = Measured::found(p.i, p.j, p.x + s[1] / n, p.y + s[2] / n);
            m.usable = s[0] >= 2.0 && degrees > 0.0;
            m.unit = within.map(|w| if m.usable { w / degrees / n } else { f64::INFINITY });
            m.misfit = 1.0;
            m
        })
        .collect();
    found.shrunk = shrink::shrink(&grid, &measured, width, height);
    found.lenslets = refine::listed(&measured, &found.shrunk, width, height);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn local_means_are_the_sums_written_out() {
        let (w, h) = (67, 23);
        let data: Vec<f32> = (0..w * h).map(|k| ((k * 7919) % 101) as f32).collect();
        let plane = Plane { width: w, height: h, data, limit: [f32::MAX; 4] };
        let fast = local_means(&plane, 6);
        for (x, y) in [(0, 0), (66, 22), (30, 11), (31, 11), (5, 20)] {
            let (mut sum, mut n) = (0f64, 0f64);
            for yy in 0..h as i64 {
                for xx in 0..w as i64 {
                    let (dx, dy) = (xx - x as i64, yy - y as i64);
                    if dx % 2 == 0 && dy % 2 == 0 && dx.abs() <= 6 && dy.abs() <= 6 {
                        sum += f64::from(plane.at(xx as usize, yy as usize));
                        n += 1.0;
                    }
                }
            }
            assert!((f64::from(fast[y * w + x]) - sum / n).abs() < 1e-3, "{x},{y}");
        }
    }
}
