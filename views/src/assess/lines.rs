//! Thin straight lines, such as strings and wires: how straight, how wide and how even they come out.
//!
//! A line is followed on a picture that favours no method, or given, and cut into segments. On the picture measured, in
//! linear light: roughness is the RMS distance of the centroids of its profiles from the straight line nearest to them; width
//! the full width at half the maximum of the profile gathered about that line; ripple the RMS of the light along it at
//! wavelengths of about 2.5 to 12 pixels, as a share of its contrast.

use lenslet_core::geometry::Size;
use lenslet_core::image::Plane;
use ndarray::ArrayView3;
use rayon::prelude::*;

use super::chains::{Strength, link_chains};
use super::fits::{fit_polynomial, value_at};
use super::picture::{gaussian, gaussian_line, linear_light, read_between};
use super::rays::Rays;
use super::segments::{Segment, offsets, quarter_pixel_profile};
use super::statistics::{
    Difference, Median, keep_common, median_of, median_of_differences, median_with_error, rms_apart,
};

/// Smoothing of the picture on which lines are followed, pixels.
///
/// Source: chosen.
const SMOOTHING: f64 = 1.5;

/// Quantiles of the curvature from which pixels belong to a line, where linked with stronger ones, and by themselves.
///
/// Source: chosen.
const QUANTILES: (f64, f64) = (0.94, 0.97);

/// Length of the segments of lines that are given, and the least; pixels.
///
/// Source: chosen.
const LENGTHS: (usize, usize) = (60, 24);

/// Length of the segments of lines that are found, pixels.
///
/// Source: chosen.
const FOUND: usize = 30;

/// Largest distance of a found line's pixels from a straight line, pixels.
///
/// Source: chosen.
const STRAIGHT: f64 = 1.0;

/// Half the length of the profiles across, and how far apart their values are read, pixels.
///
/// Source: chosen.
const PROFILE: (f64, f64) = (7.0, 0.25);

/// Values at either end of a profile that are background.
///
/// Source: chosen: two pixels.
const BACKGROUND: usize = 8;

/// Least contrast of a line on the picture on which it is followed, linear luminance.
///
/// Source: chosen.
const LEAST_CONTRAST: f64 = 0.04;

/// Found lines that are measured at most, those of most contrast.
///
/// Source: chosen.
const MOST: usize = 300;

/// Border in which no lines are searched, pixels.
///
/// Source: chosen.
const BORDER: usize = 12;

/// Bright lines of a middle view, in segments.
pub struct Lines {
    segments: Vec<Segment>,
}

/// What one picture's lines measure; lines that it does not show are NaN.
#[derive(Debug, Clone, Default)]
pub struct LineMeasures {
    /// RMS distance of each line from a straight one, pixels.
    pub rough: Vec<f64>,
    /// Full width at half maximum, pixels.
    pub width: Vec<f64>,
    /// RMS of the light along, as a share of its contrast.
    pub ripple: Vec<f64>,
}

impl LineMeasures {
    /// Medians of roughness, width and ripple; of fewer than 3 lines none.
    #[must_use]
    pub fn medians(&self) -> Option<[Median; 3]> {
        let [rough, width, ripple] = [&self.rough, &self.width, &self.ripple].map(|m| median_with_error(m));
        Some([rough?, width?, ripple?])
    }

    /// Medians of the differences of roughness, width and ripple on the lines that both pictures show.
    #[must_use]
    pub fn over(&self, other: &LineMeasures) -> Option<[Difference; 3]> {
        let of = |a: &[f64], b: &[f64]| median_of_differences(a, b);
        Some([of(&self.rough, &other.rough)?, of(&self.width, &other.width)?, of(&self.ripple, &other.ripple)?])
    }
}

/// Leaves only the lines that all pictures show; returns how many.
pub fn keep_common_lines<'a>(all: impl Iterator<Item = &'a mut LineMeasures>) -> usize {
    keep_common(&mut all.flat_map(|m| [&mut m.rough, &mut m.width, &mut m.ripple]).collect::<Vec<_>>())
}

impl Lines {
    /// Finds lines on the mean of the barycentric and the refined view of `rays`.
    #[must_use]
    pub fn find(rays: &Rays) -> Lines {
        Lines::find_on(&neutral_light(rays))
    }

    /// Follows lines given as polylines of places (x, y) in the middle view, some pixels off at most.
    #[must_use]
    pub fn follow(rays: &Rays, given: &[Vec<[f64; 2]>]) -> Lines {
        Lines::follow_on(&neutral_light(rays), given)
    }

    fn find_on(neutral: &Plane) -> Lines {
        let neutral = gaussian(neutral, SMOOTHING);
        let chains = link_chains(ridges_of(&neutral).thin(QUANTILES.0, QUANTILES.1, BORDER), neutral.width);
        let pieces = chains.iter().flat_map(|chain| chain.chunks_exact(FOUND));
        Lines::chosen(&neutral, pieces.filter_map(|p| Segment::through(p, 1, STRAIGHT)))
    }

    fn follow_on(neutral: &Plane, given: &[Vec<[f64; 2]>]) -> Lines {
        let neutral = gaussian(neutral, SMOOTHING);
        let mut segments = Vec::new();
        for line in given {
            let path = followed(&neutral, &pixel_steps(line));
            let pieces = path.chunks(LENGTHS.0).filter(|piece| piece.len() >= LENGTHS.1);
            segments.extend(pieces.filter_map(|piece| Segment::through(piece, 1, 2.0)));
        }
        Lines::chosen(&neutral, segments.into_iter())
    }

    /// Those that are one bright line with some contrast on the neutral picture.
    fn chosen(neutral: &Plane, segments: impl Iterator<Item = Segment>) -> Lines {
        let inside = |s: &Segment| {
            let ends = [-0.5 * s.span, 0.5 * s.span].map(|t| s.place(t, 0.0));
            let within = |x: f64, side: usize| x >= PROFILE.0 && x <= side as f64 - 1.0 - PROFILE.0;
            ends.iter().all(|[x, y]| within(*x, neutral.width) && within(*y, neutral.height))
        };
        let mut found: Vec<(f64, Segment)> = segments
            .filter(inside)
            .filter_map(|s| {
                let line = measured_line(neutral, &s)?;
                (line.contrast > LEAST_CONTRAST).then_some((line.contrast, s))
            })
            .collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.truncate(MOST);
        Lines { segments: found.into_iter().map(|f| f.1).collect() }
    }

    /// How many segments there are.
    #[must_use]
    pub fn count(&self) -> usize {
        self.segments.len()
    }

    /// Measures every line on a middle view (t, s, c) in linear light.
    #[must_use]
    pub fn measure(&self, picture: ArrayView3<'_, f32>) -> LineMeasures {
        let rows = self.located(picture);
        let of = |pick: fn(&Line) -> f64| rows.iter().map(|l| l.as_ref().map_or(f64::NAN, pick)).collect();
        LineMeasures { rough: of(|l| l.rough), width: of(|l| l.width), ripple: of(|l| l.ripple) }
    }
}

impl Lines {
    /// RMS distance of each line on the picture from the same line on `truth`, pixels, their mean distance taken out; NaN
    /// where one does not show it. What roughness ought to tell where a truth is known.
    #[must_use]
    pub fn displacement(&self, picture: ArrayView3<'_, f32>, truth: ArrayView3<'_, f32>) -> Vec<f64> {
        let pair = |(a, b): (&Option<Line>, &Option<Line>)| Some(rms_apart(&a.as_ref()?.at, &b.as_ref()?.at));
        self.located(picture).iter().zip(&self.located(truth)).map(pair).map(|d| d.unwrap_or(f64::NAN)).collect()
    }

    fn located(&self, picture: ArrayView3<'_, f32>) -> Vec<Option<Line>> {
        let plane = linear_light(picture);
        self.segments.par_iter().map(|s| measured_line(&plane, s)).collect()
    }
}

/// The neutral picture in linear light: the mean of both views' light.
fn neutral_light(rays: &Rays) -> Plane {
    super::picture::mean_of([&linear_light(rays.barycentric()), &linear_light(rays.refined())])
}

/// Strength of bright ridges: minus the curvature across, where it curves more across than along.
fn ridges_of(plane: &Plane) -> Strength {
    let (w, h) = (plane.width, plane.height);
    let mut strength = Plane::filled(Size::new(w, h), 0.0);
    let mut across = vec![[0f32; 2]; w * h];
    for t in 1..h.saturating_sub(1) {
        for s in 1..w.saturating_sub(1) {
            let (above, row, below) = (plane.row(t - 1), plane.row(t), plane.row(t + 1));
            let xx = row[s - 1] - 2.0 * row[s] + row[s + 1];
            let yy = above[s] - 2.0 * row[s] + below[s];
            let xy = 0.25 * (above[s - 1] - above[s + 1] - below[s - 1] + below[s + 1]);
            // The smaller eigenvalue and its direction.
            let root = (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
            let (least, most) = (0.5 * (xx + yy) - root, 0.5 * (xx + yy) + root);
            if least < 0.0 && most.abs() < -0.5 * least {
                let angle = 0.5 * (2.0 * xy).atan2(xx - yy) + std::f32::consts::FRAC_PI_2;
                strength.data[t * w + s] = -least;
                across[t * w + s] = [angle.cos(), angle.sin()];
            }
        }
    }
    Strength { strength, across }
}

/// Places a pixel apart along a polyline.
fn pixel_steps(line: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut places = Vec::new();
    for ends in line.windows(2) {
        let ([ax, ay], [bx, by]) = (ends[0], ends[1]);
        let n = (bx - ax).hypot(by - ay).ceil() as usize;
        places.extend((0..n).map(|k| k as f64 / n as f64).map(|f| [ax + f * (bx - ax), ay + f * (by - ay)]));
    }
    places
}

/// The path moved onto the brightest line nearby, smoothed along.
fn followed(neutral: &Plane, path: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut path = path.to_vec();
    if path.len() < 3 {
        return path;
    }
    for reach in [8.0, 4.0, 3.0] {
        let last = path.len() - 1;
        let normal = |k: usize| {
            let (a, b) = (path[k.saturating_sub(5)], path[(k + 5).min(last)]);
            let length = (b[0] - a[0]).hypot(b[1] - a[1]).max(1e-9);
            [-(b[1] - a[1]) / length, (b[0] - a[0]) / length]
        };
        let normals: Vec<[f64; 2]> = (0..path.len()).map(normal).collect();
        let brightest = |(p, n): (&[f64; 2], &[f64; 2])| {
            let read = |o: f64| read_between(neutral, p[0] + o * n[0], p[1] + o * n[1]);
            let all = offsets(reach, 0.5);
            all.into_iter().map(|o| (o, read(o))).max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0.0, |b| b.0)
        };
        let off: Vec<f64> = path.iter().zip(&normals).map(brightest).collect();
        for ((p, n), o) in path.iter_mut().zip(&normals).zip(gaussian_line(&off, 12.0)) {
            *p = [p[0] + o * n[0], p[1] + o * n[1]];
        }
    }
    path
}

struct Line {
    rough: f64,
    width: f64,
    ripple: f64,
    contrast: f64,
    /// Its place across at each position along.
    at: Vec<f64>,
}

fn measured_line(plane: &Plane, segment: &Segment) -> Option<Line> {
    let (positions, across) = (segment.positions(), offsets(PROFILE.0, PROFILE.1));
    let mut rows = segment.profiles(plane, &positions, &across);
    let n = across.len();
    let mut outer: Vec<f64> =
        rows.iter().flat_map(|r| r[..BACKGROUND].iter().chain(&r[n - BACKGROUND..])).copied().collect();
    let background = median_of(&mut outer)?;
    rows.iter_mut().flatten().for_each(|v| *v -= background);
    let centroid = |row: &[f64], about: f64, width: f64| {
        let (mut sum, mut moment) = (0.0, 0.0);
        for (v, o) in row.iter().zip(&across) {
            let weight = v.max(0.0) * (-((o - about) / width).powi(2)).exp();
            (sum, moment) = (sum + weight, moment + weight * o);
        }
        moment / sum.max(1e-9)
    };
    let mut at: Vec<f64> = rows.iter().map(|r| centroid(r, 0.0, 3.0)).collect();
    for _ in 0..3 {
        // The window follows the line.
        at = rows.iter().zip(&at).map(|(r, &a)| centroid(r, a, 2.5)).collect();
    }
    let places = || positions.iter().copied().zip(at.iter().copied());
    let straight = fit_polynomial(places(), 1)?;
    let rough = (places().map(|(t, x)| (x - value_at(&straight, t)).powi(2)).sum::<f64>() / at.len() as f64).sqrt();
    let about = |r: usize, c: usize| across[c] - value_at(&straight, positions[r]);
    let profile = quarter_pixel_profile(&rows, about, 24);
    let (peak_at, peak) =
        profile.iter().enumerate().filter_map(|(k, v)| Some((k, (*v)?))).max_by(|a, b| a.1.total_cmp(&b.1))?;
    if peak <= 1e-6 {
        return None;
    }
    // Both flanks must fall to half within the profile, else it is no line.
    let crossing = |step: i32| {
        let mut k = peak_at as i32;
        loop {
            let value = (*profile.get(usize::try_from(k + step).ok()?)?)?;
            let here = profile[k as usize]?;
            if value < 0.5 * peak {
                return Some(f64::from(k) + f64::from(step) * (here - 0.5 * peak) / (here - value));
            }
            k += step;
        }
    };
    let width = (crossing(1)? - crossing(-1)?) / 4.0;
    let light: Vec<f64> = positions
        .iter()
        .map(|&t| {
            let [x, y] = segment.place(t, value_at(&straight, t));
            f64::from(read_between(plane, x, y)) - background
        })
        .collect();
    let (fine, coarse) = (gaussian_line(&light, 0.6), gaussian_line(&light, 4.0));
    let band: Vec<f64> = fine.iter().zip(&coarse).map(|(a, b)| a - b).collect();
    let band = band.get(3..band.len() - 3)?;
    let ripple = (band.iter().map(|b| b * b).sum::<f64>() / band.len() as f64).sqrt() / peak;
    Some(Line { rough, width, ripple, contrast: peak, at })
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    /// Two lines of standard deviation `sigma`, moved to either side by `jag` pixels every three pixels.
    fn strings(sigma: f64, jag: f64) -> Array3<f32> {
        Array3::from_shape_fn((200, 160, 1), |(t, s, _)| {
            let off = jag * if (t / 3) % 2 == 0 { 1.0 } else { -1.0 };
            let line = |x: f64| (-0.5 * ((s as f64 - x - off) / sigma).powi(2)).exp();
            (0.05 + 0.3 * line(50.3 + 0.06 * t as f64) + 0.2 * line(110.7 - 0.1 * t as f64)) as f32
        })
    }

    #[test]
    fn lines_are_found_or_followed_and_measured() {
        let neutral = linear_light(strings(1.2, 0.0).view());
        let given = [vec![[52.0, 10.0], [60.0, 190.0]], vec![[108.0, 10.0], [93.0, 190.0]]];
        for lines in [Lines::follow_on(&neutral, &given), Lines::find_on(&neutral)] {
            assert!((6..=14).contains(&lines.count()), "{}", lines.count());
            let of = |sigma, jag| lines.measure(strings(sigma, jag).view());
            let (clean, wide, jagged) = (of(1.2, 0.0), of(2.0, 0.0), of(1.2, 0.3));
            let [rough, width, _] = clean.medians().unwrap();
            assert!(rough.median < 0.02 && (width.median - 2.355 * 1.2).abs() < 0.2, "{rough:?} {width:?}");
            assert!((wide.medians().unwrap()[1].median - 2.355 * 2.0).abs() < 0.3);
            let [rougher, ..] = jagged.over(&clean).unwrap();
            assert!((rougher.mean - 0.28).abs() < 0.06 && rougher.is_above_zero(2.0), "{rougher:?}");
        }
        assert_eq!(Lines::find_on(&Plane::filled(Size::new(100, 100), 0.3)).count(), 0);
    }

    #[test]
    fn a_wide_stripe_is_no_line() {
        let stripe = Array3::from_shape_fn((100, 100, 1), |(_, s, _)| if (40..60).contains(&s) { 0.5f32 } else { 0.1 });
        let lines = Lines::follow_on(&linear_light(stripe.view()), &[vec![[50.0, 10.0], [50.0, 90.0]]]);
        assert_eq!(lines.count(), 0);
    }
}
