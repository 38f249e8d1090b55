//! Regular lattices, and which of their points lie in a picture.

use serde::{Deserialize, Serialize};

use super::Size;

/// How the lenslets are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Grid {
    /// Hexagonal, nearest neighbours along the rows (Lytro).
    HexRows,
    /// Hexagonal, nearest neighbours along the columns.
    HexColumns,
    /// Square.
    Square,
}

/// A regular lattice: centre (i, j) = origin + i·a + j·b, in sensor pixels (x right, y down, pixel centres at
/// integers).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Lattice {
    /// Packing.
    pub grid: Grid,
    /// Position of lenslet (0, 0), the one nearest the sensor's centre.
    pub origin: [f64; 2],
    /// Step to the next lenslet of a row (for `HexColumns`: of a column).
    pub a: [f64; 2],
    /// Step to the next row: clockwise on screen from `a` by about 60 degrees for hexagonal grids, by 90 for square
    /// ones.
    pub b: [f64; 2],
}

impl Lattice {
    /// Centre of lenslet (`i`, `j`).
    #[inline]
    pub fn centre(&self, i: i32, j: i32) -> [f64; 2] {
        let (i, j) = (f64::from(i), f64::from(j));
        [self.origin[0] + i * self.a[0] + j * self.b[0], self.origin[1] + i * self.a[1] + j * self.b[1]]
    }

    /// Fractional lattice coordinates of the point (`x`, `y`).
    #[inline]
    pub fn coordinates(&self, x: f64, y: f64) -> [f64; 2] {
        let det = self.a[0] * self.b[1] - self.a[1] * self.b[0];
        let (dx, dy) = (x - self.origin[0], y - self.origin[1]);
        [(dx * self.b[1] - dy * self.b[0]) / det, (self.a[0] * dy - self.a[1] * dx) / det]
    }

    /// Distance between neighbours of a row, |a|, in pixels.
    pub fn pitch(&self) -> f64 {
        self.a[0].hypot(self.a[1])
    }

    /// Rotation of `a` against the x axis (`HexColumns`: against the y axis), radians, positive = clockwise on screen.
    pub fn rotation(&self) -> f64 {
        match self.grid {
            Grid::HexColumns => (-self.a[0]).atan2(self.a[1]),
            _ => self.a[1].atan2(self.a[0]),
        }
    }

    /// Row distance over its ideal (√3/2·pitch, or the pitch for square grids); 1.0004 to 1.0005 in Lytro F01s.
    pub fn row_stretch(&self) -> f64 {
        let det = (self.a[0] * self.b[1] - self.a[1] * self.b[0]).abs();
        let ideal = match self.grid {
            Grid::Square => 1.0,
            _ => 3f64.sqrt() / 2.0,
        };
        det / (self.pitch() * self.pitch() * ideal)
    }

    /// A hexagonal lattice with rows along x: neighbours `pitch` apart, turned by `rotation` (radians, clockwise on
    /// screen), rows `row_stretch`·√3/2·`pitch` apart, lattice point (0, 0) at `origin`.
    #[must_use]
    pub fn hexagonal(pitch: f64, rotation: f64, row_stretch: f64, origin: [f64; 2]) -> Self {
        let (sin, cos) = rotation.sin_cos();
        let row = pitch * 3f64.sqrt() / 2.0 * row_stretch;
        let half = pitch / 2.0;
        Lattice {
            grid: Grid::HexRows,
            origin,
            a: [pitch * cos, pitch * sin],
            b: [half * cos - row * sin, half * sin + row * cos],
        }
    }

    /// The same lattice with (0, 0) at the point nearest the middle of a picture of this size.
    #[must_use]
    pub fn centred_on(self, size: Size) -> Self {
        let middle = [(size.width as f64 - 1.0) / 2.0, (size.height as f64 - 1.0) / 2.0];
        let [i, j] = self.coordinates(middle[0], middle[1]).map(f64::round);
        let mut best = self.origin;
        let mut least = f64::INFINITY;
        for di in -1..=1 {
            for dj in -1..=1 {
                let (i, j) = (i + f64::from(di), j + f64::from(dj));
                let c =
                    [self.origin[0] + i * self.a[0] + j * self.b[0], self.origin[1] + i * self.a[1] + j * self.b[1]];
                let distance = (c[0] - middle[0]).hypot(c[1] - middle[1]);
                if distance < least {
                    (least, best) = (distance, c);
                }
            }
        }
        Lattice { origin: best, ..self }
    }

    /// Every lattice point in a picture of this size or at most `margin` pixels outside of its outermost pixel centres,
    /// sorted by (j, i): −`margin` ≤ x ≤ width − 1 + `margin`, and the same for y.
    ///
    /// ```
    /// use lenslet_core::geometry::{Lattice, Size};
    /// let lattice = Lattice::hexagonal(2.0, 0.0, 1.0, [0.0, 0.0]);
    /// let points = lattice.points_within(Size::new(4, 2), 0.0);
    /// assert_eq!(points.centres, [[0.0, 0.0], [2.0, 0.0]]);
    /// assert_eq!(points.index, [[0, 0], [1, 0]]);
    /// ```
    #[must_use]
    pub fn points_within(&self, size: Size, margin: f64) -> LatticePoints {
        let (right, bottom) = (size.width as f64 - 1.0 + margin, size.height as f64 - 1.0 + margin);
        let corners = [[-margin, -margin], [right, -margin], [-margin, bottom], [right, bottom]];
        let corners = corners.map(|[x, y]| self.coordinates(x, y));
        let bounds = |k: usize| {
            let low = corners.iter().map(|c| c[k]).fold(f64::INFINITY, f64::min);
            let high = corners.iter().map(|c| c[k]).fold(f64::NEG_INFINITY, f64::max);
            ((low.floor() as i64).saturating_sub(1), (high.ceil() as i64).saturating_add(1))
        };
        let ((i0, i1), (j0, j1)) = (bounds(0), bounds(1));
        let mut points = LatticePoints::default();
        for j in j0..=j1 {
            // The part of the row that crosses the picture and one more point at either end; the exact test follows.
            let (mut low, mut high) = (i0, i1);
            for (k, limit) in [(0, right), (1, bottom)] {
                let start = self.origin[k] + j as f64 * self.b[k];
                if self.a[k].abs() > 1e-9 {
                    let (p, q) = ((-margin - start) / self.a[k], (limit - start) / self.a[k]);
                    low = low.max((p.min(q).floor() as i64).saturating_sub(1));
                    high = high.min((p.max(q).ceil() as i64).saturating_add(1));
                }
            }
            for i in low..=high {
                let (Ok(i), Ok(j)) = (i32::try_from(i), i32::try_from(j)) else { continue };
                let [x, y] = self.centre(i, j);
                if (-margin..=right).contains(&x) && (-margin..=bottom).contains(&y) {
                    points.centres.push([x, y]);
                    points.index.push([i, j]);
                }
            }
        }
        points
    }
}

/// Lattice points in a picture, sorted by (j, i).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LatticePoints {
    /// Positions (x, y), pixels.
    pub centres: Vec<[f64; 2]>,
    /// Lattice index (i, j) of each.
    pub index: Vec<[i32; 2]>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_of_the_plain_double_loop_is_found() {
        for rotation in [-0.3, 0.0, 0.002, 1.2, 3.0] {
            for margin in [0.0, 1.0, 2.5] {
                let lattice = Lattice::hexagonal(3.3, rotation, 1.0005, [17.2, 8.9]);
                let points = lattice.points_within(Size::new(61, 47), margin);
                let mut plain = Vec::new();
                for j in -100..=100 {
                    for i in -100..=100 {
                        let [x, y] = lattice.centre(i, j);
                        if x >= -margin && x <= 60.0 + margin && y >= -margin && y <= 46.0 + margin {
                            plain.push([i, j]);
                        }
                    }
                }
                assert_eq!(points.index, plain, "rotation {rotation}, margin {margin}");
                assert!(points.index.iter().zip(&points.centres).all(|(k, c)| lattice.centre(k[0], k[1]) == *c));
            }
        }
    }

    #[test]
    fn pitch_rotation_and_stretch_come_back() {
        let lattice = Lattice::hexagonal(9.93, -0.0049, 1.0005, [0.0, 0.0]);
        assert!((lattice.pitch() - 9.93).abs() < 1e-12);
        assert!((lattice.rotation() + 0.0049).abs() < 1e-12);
        assert!((lattice.row_stretch() - 1.0005).abs() < 1e-9);
    }

    #[test]
    fn the_centred_origin_is_the_point_nearest_the_middle() {
        let lattice = Lattice::hexagonal(7.1, 0.2, 1.0, [-31.0, 12.0]);
        let size = Size::new(200, 120);
        let far = |c: &[f64; 2]| (c[0] - 99.5).hypot(c[1] - 59.5);
        let nearest = lattice.points_within(size, 0.0).centres.into_iter().min_by(|a, b| far(a).total_cmp(&far(b)));
        let (origin, nearest) = (lattice.centred_on(size).origin, nearest.unwrap());
        assert!((origin[0] - nearest[0]).abs() < 1e-9 && (origin[1] - nearest[1]).abs() < 1e-9);
    }
}
