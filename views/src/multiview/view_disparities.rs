//! Disparity of every view on a common working grid.

use lenslet_core::geometry::Size;
use lenslet_core::image::{Cell, Plane, bilinear_by_differences};

use ndarray::Array2;
use rayon::prelude::*;

use crate::disparity::{DepthOrder, Disparity, carry_plane_to_view};

/// Disparity maps of all views on a common working grid.
pub struct ViewDisparities {
    pub(super) rows: usize,
    pub(super) columns: usize,
    /// One map a view, pixels of the target per view step.
    pub(super) maps: Vec<Plane>,
    /// Disparity of every sample of every view, views one after the other.
    pub(super) samples: Vec<f32>,
    /// Pixels of the target per pixel of the maps.
    pub(super) scale: [f32; 2],
    /// Whether smaller or larger disparities are in front.
    pub order: DepthOrder,
    /// The middle view's disparity, pixels of the target per view step, on the working grid.
    pub middle: Disparity,
}

impl ViewDisparities {
    /// Replaces the middle view's map and, carried from it, those of all views.
    pub(super) fn carry_from_middle(&mut self, central: Plane) {
        let (views, scale, order) = ((self.rows, self.columns), self.scale, self.order);
        self.maps = (0..self.rows * self.columns)
            .into_par_iter()
            .map(|k| carry_plane_to_view(&central, scale, view_offset(views, k), order))
            .collect();
        if let Ok(found) = Array2::from_shape_vec((central.height, central.width), central.data) {
            self.middle.disparity = found;
        }
    }

    /// Looks the disparity of every sample of every view up; `points`: where samples lie in their view.
    pub(super) fn look_up_samples(&mut self, points: &[[f32; 2]]) {
        let one = |k: usize| points.iter().map(move |p| (k, p));
        self.samples = (0..self.rows * self.columns)
            .into_par_iter()
            .flat_map_iter(one)
            .map(|(k, p)| self.at(k, p[0], p[1]))
            .collect();
    }

    /// Disparity of view `k` at the pixel of its map nearest to (`x`, `y`) of the target.
    #[inline(always)]
    pub(super) fn near(&self, k: usize, x: f32, y: f32) -> f32 {
        let map = &self.maps[k];
        // Positions within the picture are not below 0.
        let s = ((x + 0.5) / self.scale[0]) as usize;
        let t = ((y + 0.5) / self.scale[1]) as usize;
        map.data[t.min(map.height - 1) * map.width + s.min(map.width - 1)]
    }

    /// Disparity of view `k` at (`x`, `y`) of the target: interpolated on a surface, the nearest value at its edge.
    #[inline(always)]
    pub(super) fn at(&self, k: usize, x: f32, y: f32) -> f32 {
        let map = &self.maps[k];
        let mx = (x + 0.5) / self.scale[0] - 0.5;
        let my = (y + 0.5) / self.scale[1] - 0.5;
        let cell = Cell::clamped(mx, my, Size::new(map.width, map.height));
        let q = cell.corners(|x, y| map.data[y * map.width + x]);
        let lo = q[0].min(q[1]).min(q[2].min(q[3]));
        let hi = q[0].max(q[1]).max(q[2].max(q[3]));
        if hi - lo < EDGE {
            bilinear_by_differences(q, cell.fx, cell.fy)
        } else {
            q[2 * usize::from(cell.fy > 0.5) + usize::from(cell.fx > 0.5)]
        }
    }
}

/// Neighbouring disparities further apart than this lie on different surfaces (pixels of the target per view step).
///
/// Source: chosen.
const EDGE: f32 = 0.15;

/// Offset (u, v) of view `k` from the middle one.
pub(super) fn view_offset(views: (usize, usize), k: usize) -> [f32; 2] {
    let (v, u) = (k / views.1, k % views.1);
    [u as f32 - (views.1 / 2) as f32, v as f32 - (views.0 / 2) as f32]
}

/// Steps (u, v) from the view `target` to the view `k`.
pub(super) fn steps_between(views: (usize, usize), k: usize, target: usize) -> [f32; 2] {
    let (a, b) = (view_offset(views, k), view_offset(views, target));
    [a[0] - b[0], a[1] - b[1]]
}
