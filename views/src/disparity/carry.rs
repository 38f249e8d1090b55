//! The middle view's disparity carried to other views: surfaces move by their disparity, the nearest in front.

use lenslet_core::geometry::Size;
use ndarray::Array2;

use super::depth_order::DepthOrder;
use lenslet_core::image::Plane;

/// The middle view's disparity carried to the view `step` = (u, v) view steps away. Where surfaces overlap, the nearer
/// one by `order` is kept; gaps take the disparity of what lies behind. Disparities are in pixels of this map per view
/// step.
pub fn carry_to_view(disparity: &Array2<f32>, step: [f32; 2], order: DepthOrder) -> Array2<f32> {
    let (height, width) = disparity.dim();
    let plane = Plane { width, height, data: disparity.iter().copied().collect() };
    let carried = carry_plane_to_view(&plane, [1.0, 1.0], step, order);
    Array2::from_shape_vec((height, width), carried.data).unwrap_or_else(|_| disparity.clone())
}

/// As [`carry_to_view`], for a map whose pixels are `scale` (x, y) times larger than the unit of its disparities.
pub fn carry_plane_to_view(central: &Plane, scale: [f32; 2], step: [f32; 2], order: DepthOrder) -> Plane {
    if step == [0.0, 0.0] {
        return central.clone();
    }
    let (w, h) = (central.width, central.height);
    let mut out = Plane::filled(Size::new(w, h), f32::NAN);
    for t in 0..h {
        for s in 0..w {
            let d = central.data[t * w + s];
            let (x, y) = (s as f32 + d * step[0] / scale[0], t as f32 + d * step[1] / scale[1]);
            let (x0, y0) = (x.floor(), y.floor());
            for (px, py) in [(x0, y0), (x0 + 1.0, y0), (x0, y0 + 1.0), (x0 + 1.0, y0 + 1.0)] {
                // A pixel covers what is within 0.75 of it: no cracks in slanted surfaces, little overhang at edges.
                let near = (px - x).abs() <= 0.75 && (py - y).abs() <= 0.75;
                if !(near && px >= 0.0 && py >= 0.0 && px < w as f32 && py < h as f32) {
                    continue;
                }
                let cell = &mut out.data[py as usize * w + px as usize];
                if cell.is_nan() || order.is_in_front(d, *cell) {
                    *cell = d;
                }
            }
        }
    }
    fill(&mut out, step, order);
    out
}

/// Fills what no surface covered: of the first values found both ways along the movement `step`, the one further
/// behind.
fn fill(plane: &mut Plane, step: [f32; 2], order: DepthOrder) {
    let (w, h) = (plane.width as isize, plane.height as isize);
    let longer = step[0].abs().max(step[1].abs());
    let way = [step[0] / longer, step[1] / longer];
    let find = |s: isize, t: isize, sign: f32| {
        (1..w.max(h)).find_map(|k| {
            let along = |c: isize, d: f32| c + (sign * k as f32 * d).round() as isize;
            let (x, y) = (along(s, way[0]), along(t, way[1]));
            if x < 0 || y < 0 || x >= w || y >= h {
                return Some(f32::NAN);
            }
            let d = plane.data[(y * w + x) as usize];
            (!d.is_nan()).then_some(d)
        })
    };
    let mut found = Vec::new();
    for t in 0..h {
        for s in 0..w {
            let k = (t * w + s) as usize;
            if plane.data[k].is_nan() {
                let (a, b) = (find(s, t, 1.0).unwrap_or(f32::NAN), find(s, t, -1.0).unwrap_or(f32::NAN));
                found.push((k, order.behind(a, b)));
            }
        }
    }
    for (k, d) in found {
        plane.data[k] = if d.is_nan() { 0.0 } else { d };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_near_square_moves_over_a_far_ground() {
        // Nearer is smaller: the square has −1, the ground 0; two steps to the right move it two pixels left.
        let map =
            Array2::from_shape_fn(
                (20, 20),
                |(t, s)| if (8..12).contains(&t) && (8..12).contains(&s) { -1.0f32 } else { 0.0 },
            );
        let seen = carry_to_view(&map, [2.0, 0.0], DepthOrder::NearerIsSmaller);
        for t in 0..20 {
            for s in 0..20 {
                let square = (8..12).contains(&t) && (6..10).contains(&s);
                assert_eq!(seen[[t, s]], if square { -1.0 } else { 0.0 }, "{s},{t}");
            }
        }
    }
}
