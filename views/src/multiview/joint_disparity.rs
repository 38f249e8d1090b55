//! Disparity refined on what the picture leaves: with I the joint fit and J = k ∗ I, minimises Σ w (y − J(p − D·u))² over
//! D around each pixel, by one Gauss–Newton step a round between two fits.

use lenslet_core::geometry::Size;
use lenslet_core::image::{GaussianFilter, Plane};

use crate::inverse::{Problem, Solution};

/// Standard deviation of the window whose samples share a correction, pixels of the map.
///
/// Source: chosen.
const WINDOW: f32 = 2.5;

/// Largest correction of one round, pixels of the target at the outermost view.
///
/// Source: chosen.
const STEP: f32 = 0.9;

/// What determines the corrections: Σ w g² and Σ w g r at every pixel of a map.
pub(super) struct Corrections {
    width: usize,
    height: usize,
    normal: Vec<f32>,
    right: Vec<f32>,
}

impl Corrections {
    pub(super) fn new(map: &Plane) -> Self {
        let n = map.width * map.height;
        Corrections { width: map.width, height: map.height, normal: vec![0.0; n], right: vec![0.0; n] }
    }

    /// Adds the samples of a solved problem; `offset(sample)`: steps from the target view to the sample's, `scale`:
    /// pixels of the target per pixel of the map.
    pub(super) fn add(
        &mut self,
        problem: &Problem<'_>,
        solution: &Solution,
        offset: impl Fn(u32) -> [f32; 2],
        scale: [f32; 2],
    ) {
        let robust = (1.0 / (3.0 * solution.residual.max(1e-3))).powi(2);
        for row in problem.rows {
            let [du, dv] = offset(row.sample);
            if du == 0.0 && dv == 0.0 {
                continue;
            }
            let predicted = problem.predicted(row, &solution.smooth);
            let (normal, right) = predicted.along([-du, -dv]);
            let unusual = 1.0 + predicted.residual().powi(2) * robust;
            let weight = row.weight / (unusual * unusual);
            let (x, y) = problem.grid.place(row);
            let s = (((x + 0.5) / scale[0]).max(0.0) as usize).min(self.width - 1);
            let t = (((y + 0.5) / scale[1]).max(0.0) as usize).min(self.height - 1);
            self.normal[t * self.width + s] += weight * normal;
            self.right[t * self.width + s] += weight * right;
        }
    }

    /// Corrects the map; `reach`: steps to the outermost view, `residual`: usual residual of the samples.
    pub(super) fn apply(mut self, map: &mut Plane, reach: f32, residual: f32) {
        let (w, h) = (self.width, self.height);
        // The sum over a window is its area times this mean.
        let window = GaussianFilter::new(WINDOW, 2.5);
        window.smooth(&mut self.normal, Size::new(w, h));
        window.smooth(&mut self.right, Size::new(w, h));
        // Damping: the texture at which noise alone moves the disparity by a tenth of a pixel at the outermost view.
        let least = (residual * reach / 0.1).powi(2) * 0.05;
        let limit = STEP / reach.max(1.0);
        for ((d, n), r) in map.data.iter_mut().zip(&self.normal).zip(&self.right) {
            *d += (r / (n + least)).clamp(-limit, limit);
        }
        map.data = median_of_nine(&map.data, w, h);
    }
}

/// Median of the 3×3 pixels around each, edges repeated.
fn median_of_nine(data: &[f32], w: usize, h: usize) -> Vec<f32> {
    let mut out = Vec::with_capacity(data.len());
    for t in 0..h {
        for s in 0..w {
            let mut nine = [0f32; 9];
            for (k, n) in nine.iter_mut().enumerate() {
                let y = (t + k / 3).saturating_sub(1).min(h - 1);
                let x = (s + k % 3).saturating_sub(1).min(w - 1);
                *n = data[y * w + x];
            }
            out.push(*nine.select_nth_unstable_by(4, f32::total_cmp).1);
        }
    }
    out
}
