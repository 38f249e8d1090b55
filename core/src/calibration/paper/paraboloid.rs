//! Algorithm 1, "fit paraboloid" (figure 6b): min over the six coefficients of Σ (I(x, y) − c0 − c1·x − c2·y − c3·x² −
//! c4·xy − c5·y²)² over a small square around a local maximum; its top is the sub-pixel centre.

use crate::calibration::sensor_image::SensorImage;
use crate::linalg::solve_small;

/// Top of the least-squares paraboloid over the (2·`reach`+1)² pixels around (`x`, `y`); `None` at the border, where
/// the paraboloid has no top, or where the top lies more than a pixel and a half away.
pub fn paraboloid_top(image: &SensorImage, x: usize, y: usize, reach: usize) -> Option<[f64; 2]> {
    if x < reach || y < reach || x + reach >= image.width || y + reach >= image.height {
        return None;
    }
    let mut normal = [[0f64; 6]; 6];
    let mut right = [0f64; 6];
    for py in y - reach..=y + reach {
        for px in x - reach..=x + reach {
            let (dx, dy) = (px as f64 - x as f64, py as f64 - y as f64);
            let row = [1.0, dx, dy, dx * dx, dx * dy, dy * dy];
            let v = f64::from(image.at(px, py));
            for (k, line) in normal.iter_mut().enumerate() {
                for (cell, other) in line.iter_mut().zip(row) {
                    *cell += row[k] * other;
                }
                right[k] += row[k] * v;
            }
        }
    }
    let [_, c1, c2, c3, c4, c5] = solve_small(normal, right)?;
    // A top, not a saddle or a bottom.
    let det = 4.0 * c3 * c5 - c4 * c4;
    if det <= 1e-12 || c3 >= 0.0 {
        return None;
    }
    let (dx, dy) = ((c4 * c2 - 2.0 * c5 * c1) / det, (c4 * c1 - 2.0 * c3 * c2) / det);
    (dx.abs() <= 1.5 && dy.abs() <= 1.5).then_some([x as f64 + dx, y as f64 + dy])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_exact_paraboloid_gives_its_top() {
        let (cx, cy) = (5.37, 6.81);
        let at = |k: usize, sign: f64| {
            let (x, y) = ((k % 12) as f64 - cx, (k / 12) as f64 - cy);
            (3.0 - sign * (0.2 * x * x + 0.1 * x * y + 0.3 * y * y)) as f32
        };
        let image = |sign| SensorImage {
            width: 12,
            height: 12,
            data: (0..144).map(|k| at(k, sign)).collect(),
            limit: [f32::MAX; 4],
        };
        for reach in 1..=3 {
            let [x, y] = paraboloid_top(&image(1.0), 5, 7, reach).unwrap();
            assert!((x - cx).hypot(y - cy) < 1e-4);
        }
        assert!(paraboloid_top(&image(-1.0), 5, 7, 1).is_none());
        assert!(paraboloid_top(&image(1.0), 0, 7, 1).is_none());
    }
}
