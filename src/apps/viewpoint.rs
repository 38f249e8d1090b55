//! Views from between the views: every pixel is the mean of the four neighbouring views, each read where its disparity
//! puts the same scene point.

use lenslet_core::geometry::Size;
use ndarray::{Array2, Array3, ArrayView3, ArrayView5};
use rayon::prelude::*;

use lenslet_core::ensure;
use lenslet_core::image::{Cell, bilinear_by_weights};
use lenslet_views::disparity::{self, DepthOrder};

use super::error::Error;

/// How the viewpoint moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum ViewpointPath {
    /// Around the middle view.
    Circle,
    /// Left and right.
    Horizontal,
    /// Up and down.
    Vertical,
}

/// `frames` viewpoints (u, v) from the middle view, `radius` view steps away at most; the last is followed by the
/// first.
///
/// ```
/// use lenslet::apps::viewpoint::{ViewpointPath, viewpoints_along};
///
/// let list = viewpoints_along(ViewpointPath::Circle, 2.0, 12);
/// assert_eq!((list.len(), list[0]), (12, [2.0, 0.0]));
/// ```
pub fn viewpoints_along(path: ViewpointPath, radius: f32, frames: usize) -> Vec<[f32; 2]> {
    (0..frames)
        .map(|k| {
            let angle = std::f32::consts::TAU * k as f32 / frames as f32;
            match path {
                ViewpointPath::Circle => [radius * angle.cos(), radius * angle.sin()],
                ViewpointPath::Horizontal => [radius * angle.sin(), 0.0],
                ViewpointPath::Vertical => [0.0, radius * angle.sin()],
            }
        })
        .collect()
}

/// The view from (`u`, `v`) view steps right of and below the middle view of `data` (v, u, t, s, c), `disparity` being
/// the middle view's (t, s), nearer by `order`; what has the disparity `hold` stays where it is in the frame. Shape
/// (t, s, c).
///
/// # Errors
/// [`Error::Parameter`] for a viewpoint outside of the views or a `hold` that is not a number, [`Error::Shape`] for a
/// disparity map of another size.
///
/// ```
/// use lenslet::apps::viewpoint::render_between_views;
/// use lenslet::disparity::DepthOrder;
/// use ndarray::{Array2, Array5};
///
/// // A ramp that moves by one pixel a view, seen from half a view to the right.
/// let field = Array5::from_shape_fn((3, 3, 8, 12, 1), |(_, u, _, s, _)| s as f32 - (u as f32 - 1.0));
/// let disparity = Array2::from_elem((8, 12), 1.0);
/// let view = render_between_views(&field.view(), &disparity, DepthOrder::NearerIsSmaller, [0.5, 0.0], 0.0)?;
/// assert_eq!(view[[4, 6, 0]], 5.5);
/// # Ok::<(), lenslet::apps::Error>(())
/// ```
pub fn render_between_views(
    data: &ArrayView5<f32>,
    disparity: &Array2<f32>,
    order: DepthOrder,
    [u, v]: [f32; 2],
    hold: f32,
) -> Result<Array3<f32>, Error> {
    let (rows, columns, height, width, channels) = data.dim();
    ensure!(
        Error::Shape,
        disparity.dim() == (height, width),
        "the disparity has {:?} pixels, the views {height}x{width}",
        disparity.dim()
    );
    let (gu, gv) = (u + (columns / 2) as f32, v + (rows / 2) as f32);
    let inside = gu >= 0.0 && gv >= 0.0 && gu <= (columns - 1) as f32 && gv <= (rows - 1) as f32;
    ensure!(Error::Parameter, inside, "the viewpoint {u},{v} is outside of the {rows}x{columns} views");
    ensure!(Error::Parameter, hold.is_finite(), "the disparity to hold is not a number");
    let map = disparity::carry_to_view(disparity, [u, v], order);
    let (u0, v0) = (gu as usize, gv as usize);
    let (fu, fv) = (gu - u0 as f32, gv - v0 as f32);
    let mut near = Vec::new();
    for (dv, wv) in [(0, 1.0 - fv), (1, fv)] {
        for (du, wu) in [(0, 1.0 - fu), (1, fu)] {
            if wv * wu > 1e-4 {
                let (kv, ku) = ((v0 + dv).min(rows - 1), (u0 + du).min(columns - 1));
                near.push((kv, ku, [ku as f32 - gu, kv as f32 - gv], wv * wu));
            }
        }
    }
    let mut out = Array3::<f32>::zeros((height, width, channels));
    let Some(flat) = out.as_slice_mut() else { return Err(Error::Shape("the image is not contiguous".into())) };
    let (right, bottom) = ((width - 1) as f32, (height - 1) as f32);
    flat.par_chunks_mut(width * channels).enumerate().for_each(|(t, row)| {
        for (s, pixel) in row.chunks_exact_mut(channels).enumerate() {
            // The frame follows the held surface.
            let (x, y) = ((s as f32 + hold * u).clamp(0.0, right), (t as f32 + hold * v).clamp(0.0, bottom));
            let d = map[[(y + 0.5) as usize, (x + 0.5) as usize]];
            for &(kv, ku, [du, dv], w) in &near {
                let cell = Cell::clamped(x + d * du, y + d * dv, Size::new(width, height));
                for (k, p) in pixel.iter_mut().enumerate() {
                    *p += w * bilinear_by_weights(cell.corners(|x, y| data[[kv, ku, y, x, k]]), cell.fx, cell.fy);
                }
            }
        }
    });
    Ok(out)
}

/// The view `step` = (u, v) view steps from `middle` (t, s, c), given its own disparity: every pixel read from the middle
/// view where the surface seen there lies.
pub(super) fn sample_shifted(middle: &ArrayView3<f32>, map: &Array2<f32>, [u, v]: [f32; 2]) -> Array3<f32> {
    let (height, width, _) = middle.dim();
    Array3::from_shape_fn(middle.dim(), |(t, s, k)| {
        let d = map[[t, s]];
        let cell = Cell::clamped(s as f32 - d * u, t as f32 - d * v, Size::new(width, height));
        bilinear_by_weights(cell.corners(|x, y| middle[[y, x, k]]), cell.fx, cell.fy)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array5, s};

    fn plane(d: f32) -> Array5<f32> {
        Array5::from_shape_fn((3, 3, 24, 30, 1), |(v, u, t, s, _)| {
            let (x, y) = (s as f32 - d * (u as f32 - 1.0), t as f32 - d * (v as f32 - 1.0));
            0.5 + 0.2 * (0.4 * x).sin() + 0.2 * (0.3 * y + 0.2 * x).cos()
        })
    }

    #[test]
    fn a_measured_viewpoint_is_the_measured_view() {
        let field = plane(0.7);
        let map = Array2::from_elem((24, 30), 0.7);
        let found = render_between_views(&field.view(), &map, DepthOrder::NearerIsSmaller, [1.0, -1.0], 0.0).unwrap();
        let off = (&found - &field.slice(s![0, 2, .., .., ..])).mapv(f32::abs);
        assert!(off.iter().all(|d| *d < 1e-5));
    }

    #[test]
    fn half_a_step_moves_half_the_disparity() {
        let field = plane(0.8);
        let map = Array2::from_elem((24, 30), 0.8);
        let found = render_between_views(&field.view(), &map, DepthOrder::NearerIsSmaller, [0.5, 0.0], 0.0).unwrap();
        for t in 4..20 {
            for s in 4..26 {
                let (x, y) = (s as f32 - 0.4, t as f32);
                let truth = 0.5 + 0.2 * (0.4 * x).sin() + 0.2 * (0.3 * y + 0.2 * x).cos();
                assert!((found[[t, s, 0]] - truth).abs() < 0.01);
            }
        }
    }

    #[test]
    fn the_held_plane_stands_still() {
        let field = plane(0.8);
        let map = Array2::from_elem((24, 30), 0.8);
        let found = render_between_views(&field.view(), &map, DepthOrder::NearerIsSmaller, [0.7, 0.4], 0.8).unwrap();
        let off = (&found - &field.slice(s![1, 1, .., .., ..])).mapv(f32::abs);
        assert!(off.slice(s![3..21, 3..27, ..]).iter().all(|d| *d < 0.02));
    }

    #[test]
    fn paths_close_and_stay_within_the_radius() {
        for path in [ViewpointPath::Circle, ViewpointPath::Horizontal, ViewpointPath::Vertical] {
            let list = viewpoints_along(path, 2.5, 24);
            assert_eq!(list.len(), 24);
            assert!(list.iter().all(|[u, v]| u.hypot(*v) < 2.5001));
        }
        assert!(
            render_between_views(
                &plane(0.0).view(),
                &Array2::zeros((24, 30)),
                DepthOrder::NearerIsSmaller,
                [1.5, 0.0],
                0.0
            )
            .is_err()
        );
    }
}
