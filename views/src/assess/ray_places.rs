//! Where the samples of other views lie in the middle view: x = p − D(x)·u, D being the middle view's disparity.

use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::{SensorToView, Size};
use lenslet_core::image::Plane;
use ndarray::Array2;

use crate::target::view_pitch;

/// Steps of the fixed point.
///
/// Source: chosen; it converges where disparity changes by less than a third of a step a pixel.
const STEPS: usize = 8;

/// Largest movement of the last step, pitches.
///
/// Source: chosen, a twentieth of a pixel of an F01's views of 1080 pixels.
const SETTLED: f64 = 0.015;

/// Range of disparity, pitches a view step, from which an edge of a surface is near.
///
/// Source: chosen, 0.12 pixels of an F01's views of 1080 pixels.
const EDGE: f64 = 0.037;

/// Half the side of the square in which that range is taken, pitches.
///
/// Source: chosen.
const AROUND_EDGE: f64 = 1.6;

/// Border in which nothing is measured, pitches.
///
/// Source: chosen.
pub(super) const BORDER: f64 = 4.3;

/// A place of the middle view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    pub(super) x: f64,
    pub(super) y: f64,
    /// Whether the fixed point settled, away from the edges of surfaces and from the border.
    pub(super) is_sure: bool,
}

/// Finds places by one disparity map.
pub(super) struct RayPlaces {
    /// Pixels of the view per view step.
    disparity: Plane,
    /// Range of disparity around each pixel of the map.
    range: Plane,
    /// Pixels of the map per pixel of the view.
    scale: [f64; 2],
    size: Size,
    pitch: f64,
}

impl RayPlaces {
    /// `disparity` of the middle view of `size`, on a map of any size, pixels of the view per view step.
    pub(super) fn new(samples: &HexSamples, size: &Size, disparity: &Array2<f32>) -> RayPlaces {
        let (height, width) = disparity.dim();
        let map = Plane { width, height, data: disparity.iter().copied().collect() };
        let pitch = view_pitch(samples, size.width);
        let scale = [width as f64 / size.width as f64, height as f64 / size.height as f64];
        let half = (AROUND_EDGE * pitch * scale[0]).round().max(1.0) as usize;
        RayPlaces { range: range_around(&map, half), disparity: map, scale, size: *size, pitch }
    }

    /// Where the sample at `p` of the view `steps` = (u, v) view steps from the middle lies.
    pub(super) fn place(&self, p: [f64; 2], steps: [f64; 2]) -> Place {
        let ([mut x, mut y], mut last) = (p, 0.0);
        for k in 0..=STEPS {
            let d = self.disparity_at(x, y);
            if k == STEPS {
                let moved = (d - last).abs() * steps[0].abs().max(steps[1].abs());
                let border = BORDER * self.pitch;
                let inside = |x: f64, side: usize| x > border && x < side as f64 - 1.0 - border;
                let [i, j] = self.on_map(x, y).map(|k| k.round().max(0.0) as usize);
                let range = self.range.row(j.min(self.range.height - 1))[i.min(self.range.width - 1)];
                let is_sure = moved < SETTLED * self.pitch
                    && inside(x, self.size.width)
                    && inside(y, self.size.height)
                    && f64::from(range) < EDGE * self.pitch;
                return Place { x, y, is_sure };
            }
            (x, y, last) = (p[0] - d * steps[0], p[1] - d * steps[1], d);
        }
        Place { x, y, is_sure: false }
    }

    fn disparity_at(&self, x: f64, y: f64) -> f64 {
        let [i, j] = self.on_map(x, y);
        f64::from(self.disparity.bilinear_at(i as f32, j as f32))
    }

    fn on_map(&self, x: f64, y: f64) -> [f64; 2] {
        [(x + 0.5) * self.scale[0] - 0.5, (y + 0.5) * self.scale[1] - 0.5]
    }
}

/// Largest minus smallest value within `half` pixels in x and y.
fn range_around(map: &Plane, half: usize) -> Plane {
    let extremes = |line: &[f32], out: &mut [f32], pick: fn(f32, f32) -> f32| {
        for (k, o) in out.iter_mut().enumerate() {
            let near = &line[k.saturating_sub(half)..(k + half + 1).min(line.len())];
            *o = near.iter().copied().reduce(pick).unwrap_or(line[k]);
        }
    };
    let (w, h) = (map.width, map.height);
    let one = |pick: fn(f32, f32) -> f32| {
        let mut wide = vec![0f32; w * h];
        for (out, row) in wide.chunks_mut(w).zip(map.data.chunks(w)) {
            extremes(row, out, pick);
        }
        let mut column = vec![0f32; h];
        let mut found = vec![0f32; h];
        for s in 0..w {
            (0..h).for_each(|t| column[t] = wide[t * w + s]);
            extremes(&column, &mut found, pick);
            (0..h).for_each(|t| wide[t * w + s] = found[t]);
        }
        wide
    };
    let (high, low) = (one(f32::max), one(f32::min));
    Plane { width: w, height: h, data: high.iter().zip(&low).map(|(a, b)| a - b).collect() }
}

/// Steps (u, v) of view `k` from the middle one.
pub(super) fn view_steps(samples: &HexSamples, k: usize) -> [f64; 2] {
    samples.view_offset(k).map(|o| o / samples.view_step)
}

/// Where samples lie in their own view, pixels of views of `size`.
pub(super) fn sample_points(samples: &HexSamples, size: &Size) -> Vec<[f64; 2]> {
    SensorToView::new(samples.sensor, *size).all_to_view(&samples.centres)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slanted_plane_is_met_where_its_rays_are() {
        // D = 0.2 + 0.002 x: a point at x of the middle view is at x + D(x)·u in view u.
        let samples = crate::assess::rays::tests::slanted_samples();
        let size = Size { width: 100, height: 100 };
        let map = Array2::from_shape_fn((50, 50), |(_, s)| 0.2 + 0.002 * (2 * s) as f32 + 0.001);
        let places = RayPlaces::new(&samples, &size, &map);
        for x in [30.0, 51.7, 70.2] {
            let d = 0.2 + 0.002 * x;
            let found = places.place([x + 3.0 * d, 40.0 - 2.0 * d], [3.0, -2.0]);
            assert!((found.x - x).abs() < 2e-3 && (found.y - 40.0).abs() < 2e-3 && found.is_sure, "{found:?}");
        }
        assert!(!places.place([5.0, 50.0], [2.0, 0.0]).is_sure);
        let cliff = Array2::from_shape_fn((50, 50), |(_, s)| if s < 25 { 0.0 } else { 1.0 });
        let places = RayPlaces::new(&samples, &size, &cliff);
        assert!(!places.place([50.0, 50.0], [2.0, 0.0]).is_sure && places.place([30.0, 50.0], [2.0, 0.0]).is_sure);
    }
}
