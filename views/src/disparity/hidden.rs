//! Which views something in front hides from a point, of a first disparity map.
//!
//! The point at x with disparity D stands at x + D·u in the view u steps away, where a surface at x − k with disparity
//! D' covers it if (D − D')·u = −k. So a surface to the left hides a point behind it in views to the left, up to the
//! outermost one if |D − D'| > k / reach: of all surfaces to the left one number a pixel is enough, the least D' + k / reach.

use super::depth_order::DepthOrder;

/// For each half of the views (left, right, above, below) the disparity from which on a point is hidden in some of
/// them, pixel by pixel.
pub struct Hidden {
    /// +1 where nearer is smaller, −1 where it is larger.
    sign: f32,
    limits: [Vec<f32>; 4],
}

impl Hidden {
    /// Of the map `first`, `width` pixels a row; views reach `reach` steps away. Differences up to `margin` hide nothing.
    pub fn of(first: &[f32], width: usize, reach: f32, margin: f32, order: DepthOrder) -> Self {
        let height = first.len().checked_div(width).unwrap_or(0);
        let sign = -order.sign();
        let step = 1.0 / reach.max(1.0);
        let mut limits = [(); 4].map(|()| vec![f32::INFINITY; first.len()]);
        for t in 0..height {
            let row = t * width;
            let mut scan = |side: usize, places: &mut dyn Iterator<Item = usize>| {
                let mut least = f32::INFINITY;
                for s in places {
                    limits[side][row + s] = least + margin;
                    least = least.min(sign * first[row + s]) + step;
                }
            };
            scan(0, &mut (0..width));
            scan(1, &mut (0..width).rev());
        }
        let mut scan = |side: usize, rows: &mut dyn Iterator<Item = usize>| {
            let mut least = vec![f32::INFINITY; width];
            for t in rows {
                let span = t * width..(t + 1) * width;
                for ((limit, l), d) in limits[side][span.clone()].iter_mut().zip(&mut least).zip(&first[span]) {
                    *limit = *l + margin;
                    *l = l.min(sign * d) + step;
                }
            }
        };
        scan(2, &mut (0..height));
        scan(3, &mut (0..height).rev());
        if sign < 0.0 {
            // Surfaces to the left then hide what is behind them in views to the right.
            limits.swap(0, 1);
            limits.swap(2, 3);
        }
        Hidden { sign, limits }
    }

    /// Whether a point at pixel `k` with disparity `d` is hidden in some views of the half `side`.
    #[inline]
    pub fn hides(&self, side: usize, k: usize, d: f32) -> bool {
        self.sign * d > self.limits[side][k]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_hides_what_is_behind_it() {
        let (w, h) = (24, 20);
        for (order, near) in [(DepthOrder::NearerIsSmaller, -1i32), (DepthOrder::NearerIsLarger, 1)] {
            let square = |x: i32, y: i32| (10..14).contains(&x) && (8..12).contains(&y);
            let place = |k: usize| ((k % w) as i32, (k / w) as i32);
            let map: Vec<f32> =
                (0..w * h).map(|k| if square(place(k).0, place(k).1) { near as f32 } else { 0.0 }).collect();
            let hidden = Hidden::of(&map, w, 3.5, 0.1, order);
            for k in 0..w * h {
                let (x, y) = place(k);
                assert!((0..4).all(|side| !hidden.hides(side, k, near as f32)));
                for side in (0..4).filter(|_| !square(x, y)) {
                    // By the definition: there is a view in that half in which the square lies over the point.
                    let covered = (1..=3).any(|u| {
                        let moved = near * if side % 2 == 0 { -u } else { u };
                        if side < 2 { square(x - moved, y) } else { square(x, y - moved) }
                    });
                    assert_eq!(hidden.hides(side, k, 0.0), covered, "side {side} at {x},{y}, {order:?}");
                }
            }
        }
    }
}
