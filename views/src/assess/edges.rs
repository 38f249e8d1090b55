//! Edges of any scene: sharpness beside roughness.
//!
//! Edges are found on a picture that favours no method, located again on the picture that is measured, along the normals of
//! the curve, and a parabola is fitted through the places. Roughness is the RMS distance of the places from it; MTF50 that of
//! the profile gathered about it (ISO 12233). Roughness alone rewards blur, MTF50 alone noise and ringing: never either
//! alone.

use lenslet_core::geometry::Size;
use lenslet_core::image::Plane;
use ndarray::ArrayView3;
use rayon::prelude::*;

use super::chains::{Strength, link_chains};
use super::fits::{fit_polynomial, value_at};
use super::picture::{encoded_light, gaussian};
use super::rays::Rays;
use super::segments::{Segment, offsets, quarter_pixel_profile};
use super::statistics::{Difference, Median, keep_common, median_of_differences, median_with_error, rms_apart};

/// Smoothing before edges are searched, pixels.
///
/// Source: chosen.
const SMOOTHING: f64 = 1.6;

/// Quantiles of the slope from which pixels belong to an edge, where linked with stronger ones, and by themselves.
///
/// Source: chosen.
const QUANTILES: (f64, f64) = (0.85, 0.93);

/// Pixels of a chain in one segment.
///
/// Source: chosen.
const LENGTH: usize = 26;

/// Largest distance of a segment's pixels from its parabola, and how far the parabola may bend, pixels.
///
/// Source: chosen.
const STRAIGHT: (f64, f64) = (1.2, 6.0);

/// Half the length of the profiles across, and how far apart their values are read, pixels.
///
/// Source: chosen.
const PROFILE: (f64, f64) = (6.0, 0.5);

/// Least contrast of a segment, encoded luminance.
///
/// Source: chosen.
const LEAST_CONTRAST: f64 = 0.05;

/// Share of a profile's rise that may fall back, for a single step.
///
/// Source: chosen.
const FALLING_BACK: f64 = 0.25;

/// Segments measured at most, those of most contrast.
///
/// Source: chosen.
const MOST: usize = 500;

/// Border in which no edges are searched, pixels.
///
/// Source: chosen.
const BORDER: usize = 30;

/// Distance at which the weight of a slope falls to 1/e when an edge is located again, pixels.
///
/// Source: chosen.
const WINDOW: f64 = 2.2;

/// The edges of a middle view, found on a picture that favours no method.
pub struct Edges {
    segments: Vec<Segment>,
}

/// What one picture's edges measure; edges that it does not show are NaN.
#[derive(Debug, Clone, Default)]
pub struct EdgeMeasures {
    /// Where the MTF of each edge falls to one half, cycles a pixel.
    pub mtf50: Vec<f64>,
    /// RMS distance of each edge from its parabola, pixels.
    pub rough: Vec<f64>,
}

impl EdgeMeasures {
    /// The median of MTF50, cycles a pixel; of fewer than 3 edges none.
    #[must_use]
    pub fn median_mtf50(&self) -> Option<Median> {
        median_with_error(&self.mtf50)
    }

    /// The median roughness, pixels.
    #[must_use]
    pub fn median_rough(&self) -> Option<Median> {
        median_with_error(&self.rough)
    }

    /// Medians of the differences (MTF50, roughness) on the edges that both pictures show.
    #[must_use]
    pub fn over(&self, other: &EdgeMeasures) -> Option<(Difference, Difference)> {
        let mtf50 = median_of_differences(&self.mtf50, &other.mtf50)?;
        Some((mtf50, median_of_differences(&self.rough, &other.rough)?))
    }
}

/// Leaves only the edges that all pictures show; returns how many.
pub fn keep_common_edges<'a>(all: impl Iterator<Item = &'a mut EdgeMeasures>) -> usize {
    keep_common(&mut all.flat_map(|m| [&mut m.mtf50, &mut m.rough]).collect::<Vec<_>>())
}

impl Edges {
    /// Finds edges on the mean of the barycentric and the refined view of `rays`, slightly blurred.
    #[must_use]
    pub fn find(rays: &Rays) -> Edges {
        Edges::find_on(&gaussian(&rays.neutral(), 1.0))
    }

    fn find_on(neutral: &Plane) -> Edges {
        let slope = slope_of(&gaussian(neutral, SMOOTHING));
        let chains = link_chains(slope.thin(QUANTILES.0, QUANTILES.1, BORDER), neutral.width);
        let mut found: Vec<(f64, Segment)> = chains
            .iter()
            .flat_map(|chain| chain.chunks_exact(LENGTH))
            .filter_map(|points| Segment::through(points, 2, STRAIGHT.0))
            .filter(|s| s.curve[2].abs() * (LENGTH as f64 / 2.0).powi(2) <= STRAIGHT.1)
            .filter_map(|s| Some((contrast_of_step(neutral, &s)?, s)))
            .collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.truncate(MOST);
        Edges { segments: found.into_iter().map(|f| f.1).collect() }
    }

    /// How many were found.
    #[must_use]
    pub fn count(&self) -> usize {
        self.segments.len()
    }

    /// Measures every edge on a middle view (t, s, c) in linear light.
    #[must_use]
    pub fn measure(&self, picture: ArrayView3<'_, f32>) -> EdgeMeasures {
        let measured: Vec<(f64, f64)> = self
            .located(picture)
            .iter()
            .map(|e| e.as_ref().map_or((f64::NAN, f64::NAN), |e| (e.mtf50, e.rough)))
            .collect();
        let (mtf50, rough) = measured.into_iter().unzip();
        EdgeMeasures { mtf50, rough }
    }

    /// RMS distance of each edge on the picture from the same edge on `truth`, pixels, both as found along the same normals,
    /// their mean distance taken out; NaN where one does not show it. What roughness ought to tell where a truth is known.
    #[must_use]
    pub fn displacement(&self, picture: ArrayView3<'_, f32>, truth: ArrayView3<'_, f32>) -> Vec<f64> {
        let pair = |(a, b): (&Option<Located>, &Option<Located>)| Some(rms_apart(&a.as_ref()?.at, &b.as_ref()?.at));
        self.located(picture).iter().zip(&self.located(truth)).map(pair).map(|d| d.unwrap_or(f64::NAN)).collect()
    }

    fn located(&self, picture: ArrayView3<'_, f32>) -> Vec<Option<Located>> {
        let plane = encoded_light(picture);
        self.segments.par_iter().map(|s| measured_edge(&plane, s)).collect()
    }
}

/// Modulus and direction of the slope.
fn slope_of(plane: &Plane) -> Strength {
    let (w, h) = (plane.width, plane.height);
    let mut strength = Plane::filled(Size::new(w, h), 0.0);
    let mut across = vec![[0f32; 2]; w * h];
    for t in 1..h.saturating_sub(1) {
        for s in 1..w.saturating_sub(1) {
            let (above, row, below) = (plane.row(t - 1), plane.row(t), plane.row(t + 1));
            let gx = 2.0 * (row[s + 1] - row[s - 1]) + above[s + 1] - above[s - 1] + below[s + 1] - below[s - 1];
            let gy = 2.0 * (below[s] - above[s]) + below[s - 1] - above[s - 1] + below[s + 1] - above[s + 1];
            let modulus = gx.hypot(gy);
            strength.data[t * w + s] = modulus;
            if modulus > 0.0 {
                across[t * w + s] = [gx / modulus, gy / modulus];
            }
        }
    }
    Strength { strength, across }
}

/// Sides of the step: means of the four outermost values of the mean profile.
fn sides(profile: &[f64]) -> (f64, f64) {
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    (mean(&profile[..4]), mean(&profile[profile.len() - 4..]))
}

fn mean_profile(rows: &[Vec<f64>]) -> Vec<f64> {
    let n = rows.len().max(1) as f64;
    (0..rows[0].len()).map(|c| rows.iter().map(|r| r[c]).sum::<f64>() / n).collect()
}

fn deviation(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let n = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / n;
    (values.map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()
}

/// The contrast where the segment is one clean step on the picture.
fn contrast_of_step(plane: &Plane, segment: &Segment) -> Option<f64> {
    let across = offsets(PROFILE.0, PROFILE.1);
    let rows = segment.profiles(plane, &segment.positions(), &across);
    let mean = mean_profile(&rows);
    let (low, high) = sides(&mean);
    let contrast = (high - low).abs();
    let side = |range: std::ops::Range<usize>| deviation(rows.iter().flat_map(|r| r[range.clone()].iter().copied()));
    let noise = side(0..4) + side(across.len() - 4..across.len());
    let rises = |sign: f64| mean.windows(2).map(|w| (sign * (w[1] - w[0])).max(0.0)).sum::<f64>();
    let sign = (high - low).signum();
    let single = rises(-sign) < FALLING_BACK * rises(sign);
    measured_edge(plane, segment)?;
    (contrast > LEAST_CONTRAST && noise < contrast && single).then_some(contrast)
}

/// One edge as a picture shows it.
struct Located {
    mtf50: f64,
    rough: f64,
    /// Its place across at each position along.
    at: Vec<f64>,
}

fn measured_edge(plane: &Plane, segment: &Segment) -> Option<Located> {
    let (positions, across) = (segment.positions(), offsets(PROFILE.0, PROFILE.1));
    let rows = segment.profiles(plane, &positions, &across);
    let (low, high) = sides(&mean_profile(&rows));
    let sign = (high - low).signum();
    let centre = |row: &Vec<f64>| {
        let (mut sum, mut moment) = (0.0, 0.0);
        for k in 0..row.len() {
            let (a, b) = (k.saturating_sub(1), (k + 1).min(row.len() - 1));
            let slope = sign * (row[b] - row[a]) / (across[b] - across[a]);
            let weight = slope.max(0.0) * (-(across[k] / WINDOW).powi(2)).exp();
            (sum, moment) = (sum + weight, moment + weight * across[k]);
        }
        moment / sum.max(1e-9)
    };
    let at: Vec<f64> = rows.iter().map(centre).collect();
    let places = || positions.iter().copied().zip(at.iter().copied());
    let mut curve = fit_polynomial(places(), 2)?;
    for _ in 0..2 {
        let squares: Vec<f64> = places().map(|(t, x)| (x - value_at(&curve, t)).powi(2)).collect();
        let limit = 9.0 * squares.iter().sum::<f64>() / squares.len() as f64 + 1e-12;
        curve = fit_polynomial(places().zip(&squares).filter(|(_, s)| **s < limit).map(|(p, _)| p), 2)?;
    }
    let residuals: Vec<f64> = places().map(|(t, x)| x - value_at(&curve, t)).filter(|r| r.abs() < 2.0).collect();
    if residuals.len() < positions.len() / 2 {
        return None;
    }
    let rough = (residuals.iter().map(|r| r * r).sum::<f64>() / residuals.len() as f64).sqrt();
    let about = |r: usize, c: usize| across[c] - value_at(&curve, positions[r]);
    let half = 4 * PROFILE.0 as i32 - 4;
    let profile: Vec<f64> = quarter_pixel_profile(&rows, about, half).into_iter().collect::<Option<_>>()?;
    Some(Located { mtf50: mtf50_of(&profile)?, rough, at })
}

/// Where the MTF of a profile of values a quarter of a pixel apart falls to one half, cycles a pixel (ISO 12233: its
/// derivative under a Hamming window, Fourier transformed).
fn mtf50_of(profile: &[f64]) -> Option<f64> {
    let n = profile.len() - 1;
    let spread: Vec<f64> = (0..n)
        .map(|k| {
            let window = 0.54 - 0.46 * (std::f64::consts::TAU * k as f64 / (n - 1) as f64).cos();
            (profile[k + 1] - profile[k]) * window
        })
        .collect();
    let modulus = |frequency: f64| {
        let turn = std::f64::consts::TAU * frequency / 4.0;
        let part = |f: fn(f64) -> f64| spread.iter().enumerate().map(|(k, v)| v * f(turn * k as f64)).sum::<f64>();
        part(f64::cos).hypot(part(f64::sin))
    };
    let full = modulus(0.0);
    if full < 1e-9 {
        return None;
    }
    const STEP: f64 = 1.0 / 128.0;
    let mut before = 1.0;
    for k in 1..=128 {
        let now = modulus(f64::from(k) * STEP) / full;
        if now < 0.5 {
            return Some(STEP * (f64::from(k - 1) + (before - 0.5) / (before - now)));
        }
        before = now;
    }
    None
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    /// Discs with edges of Gaussian profile `sigma`, moved by `jag` pixels from row to row.
    fn discs(sigma: f64, jag: f64) -> Array3<f32> {
        Array3::from_shape_fn((400, 400, 1), |(t, s, _)| {
            let off = jag * if (t / 2 + s / 2) % 2 == 0 { 1.0 } else { -1.0 };
            let mut light = 0.15;
            for (cx, cy, r) in [
                (90.3, 100.1, 50.0),
                (210.2, 200.7, 60.0),
                (320.0, 90.6, 50.0),
                (90.9, 310.4, 50.0),
                (320.5, 320.2, 50.0),
            ] {
                let d = r + off - (s as f64 - cx).hypot(t as f64 - cy);
                light += 0.3 / (1.0 + (-1.702 * d / sigma).exp());
            }
            light as f32
        })
    }

    #[test]
    fn blur_lowers_the_mtf_and_jags_raise_roughness() {
        let edges = Edges::find_on(&gaussian(&encoded_light(discs(0.9, 0.0).view()), 1.0));
        assert!(edges.count() >= 8, "{}", edges.count());
        let of = |sigma, jag| {
            let m = edges.measure(discs(sigma, jag).view());
            (m.median_mtf50().unwrap().median, m.median_rough().unwrap().median, m)
        };
        let (sharp, smooth, clean) = of(0.9, 0.0);
        let (soft, _, blurred) = of(1.8, 0.0);
        let (_, rough, jagged) = of(0.9, 0.4);
        // A Gaussian edge of standard deviation σ: MTF50 = 0.1874/σ; the window takes the ends of a wide one away.
        let of_gaussian = |sigma: f64| 0.1874 / sigma;
        assert!((sharp - of_gaussian(0.9)).abs() < 0.02, "{sharp}");
        assert!(soft > of_gaussian(1.8) && soft < of_gaussian(1.8) + 0.045, "{soft}");
        assert!(smooth < 0.05 && rough > 2.0 * smooth, "{smooth} {rough}");
        let (sharper, _) = clean.over(&blurred).unwrap();
        let (_, rougher) = jagged.over(&clean).unwrap();
        assert!(sharper.is_above_zero(2.0) && rougher.is_above_zero(2.0));
        assert_eq!(Edges::find_on(&Plane::filled(Size::new(100, 100), 0.3)).count(), 0);
    }
}
