//! Which end of a disparity map is the near one, found from the views.

use lenslet_core::image::Plane;

use super::carry::carry_plane_to_view;
use super::depth_order::DepthOrder;

/// Whether nearer surfaces have the smaller or the larger disparity: whichever predicts the corner views better.
/// Light fields whose views are numbered against the camera's movement have it the other way round.
/// `central` is the map of the view `at` (row, column) of `grid`, its pixels `scale` times larger than the unit of its
/// disparities; views that are `dark`, counted row by row, are left out.
pub fn find_depth_order(
    central: &Plane,
    grid: &[Vec<Plane>],
    at: (usize, usize),
    scale: [f32; 2],
    dark: &dyn Fn(usize) -> bool,
) -> DepthOrder {
    let (rows, columns) = (grid.len(), grid.first().map_or(0, Vec::len));
    let reference = &grid[at.0][at.1];
    let ratio = [reference.width as f32 / central.width as f32, reference.height as f32 / central.height as f32];
    let mut error = [0f64; 2];
    for corner in corners_of((rows, columns), at) {
        // The outermost view that holds light on the way to the middle.
        let Some(&(v, u)) = corner.iter().find(|(v, u)| !dark(v * columns + u)) else { continue };
        let offset = [u as f32 - at.1 as f32, v as f32 - at.0 as f32];
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

/// From each corner of the grid the views on the diagonal to the view `at`.
pub(crate) fn corners_of((rows, columns): (usize, usize), at: (usize, usize)) -> [Vec<(usize, usize)>; 4] {
    [(0, 0), (0, columns - 1), (rows - 1, 0), (rows - 1, columns - 1)].map(|(v, u): (usize, usize)| {
        let steps = v.abs_diff(at.0).max(u.abs_diff(at.1));
        let toward = |from: usize, to: usize, k: usize| {
            (from as isize + (to as isize - from as isize) * k as isize / steps as isize) as usize
        };
        (0..steps).map(|k| (toward(v, at.0, k), toward(u, at.1, k))).collect()
    })
}
