//! Which triangle holds each output pixel: triangles drawn into the output grid, band by band.

use rayon::prelude::*;

use crate::geometry::{Size, Triangulation};

/// Rows of one band; bands are drawn independently.
/// Source: chosen; results do not depend on it.
const BAND: usize = 32;
/// Tolerance, in barycentric weight, by which rounding may put a pixel on an edge outside its triangle.
/// Source: chosen, far above the rounding of f64.
const EDGE: f64 = 1e-9;

/// Three vertices and their weights (≥ 0, sum 1); `index[0] == u32::MAX` marks a pixel outside all triangles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Entry {
    pub index: [u32; 3],
    pub weight: [f32; 3],
}

pub(super) const EMPTY: Entry = Entry { index: [u32::MAX, 0, 0], weight: [0.0; 3] };

/// Barycentric weights of (`x`, `y`) in the triangle `p` (paper, eq. 2), not yet clamped.
#[inline]
pub(super) fn barycentric(p: [[f64; 2]; 3], x: f64, y: f64) -> [f64; 3] {
    let (ax, ay) = (p[1][0] - p[0][0], p[1][1] - p[0][1]);
    let (bx, by) = (p[2][0] - p[0][0], p[2][1] - p[0][1]);
    let (dx, dy) = (x - p[0][0], y - p[0][1]);
    let det = ax * by - ay * bx;
    let w1 = (dx * by - dy * bx) / det;
    let w2 = (ax * dy - ay * dx) / det;
    [1.0 - w1 - w2, w1, w2]
}

/// Draws the triangles over `points` (already in output pixels) into a table of `size`. A pixel on an edge goes
/// to the first triangle of the list that holds it.
pub(super) fn draw(mesh: &Triangulation, points: &[[f64; 2]], size: Size) -> Vec<Entry> {
    let Size { width, height } = size;
    let corners = |t: &[u32; 3]| t.map(|v| points[v as usize]);
    let bands = height.div_ceil(BAND);
    let mut bucket: Vec<Vec<u32>> = vec![Vec::new(); bands];
    for (n, t) in mesh.triangles.iter().enumerate() {
        let p = corners(t);
        let (low, high) = span(p.map(|q| q[1]), height);
        if low <= high {
            for list in &mut bucket[low / BAND..=high / BAND] {
                list.push(n as u32);
            }
        }
    }
    let mut table = vec![EMPTY; width * height];
    table.par_chunks_mut(width * BAND).zip(bucket.into_par_iter()).enumerate().for_each(|(band, (rows, list))| {
        let first = band * BAND;
        let last = first + rows.len() / width - 1;
        for n in list {
            let t = mesh.triangles[n as usize];
            let p = corners(&t);
            let (top, bottom) = span(p.map(|q| q[1]), height);
            let (left, right) = span(p.map(|q| q[0]), width);
            for y in top.max(first)..=bottom.min(last) {
                for x in left..(right + 1).max(left) {
                    let entry = &mut rows[(y - first) * width + x];
                    if entry.index[0] != u32::MAX {
                        continue;
                    }
                    let w = barycentric(p, x as f64, y as f64);
                    if w.iter().all(|&w| w >= -EDGE) {
                        *entry = weighted(t, w);
                    }
                }
            }
        }
    });
    table
}

/// Clamps away rounding and makes the weights sum to one.
pub(super) fn weighted(index: [u32; 3], w: [f64; 3]) -> Entry {
    let w = w.map(|w| w.max(0.0));
    let sum = w[0] + w[1] + w[2];
    Entry { index, weight: w.map(|w| (w / sum) as f32) }
}

/// Whole numbers in 0..len that lie between the smallest and largest of three coordinates (empty when low > high).
fn span(v: [f64; 3], len: usize) -> (usize, usize) {
    let low = (v[0].min(v[1]).min(v[2]) - 1e-6).ceil().max(0.0);
    let high = (v[0].max(v[1]).max(v[2]) + 1e-6).floor().min((len - 1) as f64);
    if high < low { (1, 0) } else { (low as usize, high as usize) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::triangulate;

    #[test]
    fn pixels_on_edges_and_corners_belong_to_a_triangle() {
        let points = [[1.0, 1.0], [5.0, 1.0], [1.0, 6.0], [5.0, 6.0]];
        let table = draw(&triangulate(&points).unwrap(), &points, Size::new(8, 9));
        for (k, entry) in table.iter().enumerate() {
            let (x, y) = (k % 8, k / 8);
            let inside = (1..=5).contains(&x) && (1..=6).contains(&y);
            assert_eq!(entry.index[0] != u32::MAX, inside, "({x}, {y})");
            if inside {
                let place = |c: usize| {
                    (0..3).map(|n| f64::from(entry.weight[n]) * points[entry.index[n] as usize][c]).sum::<f64>()
                };
                assert!((place(0) - x as f64).abs() < 1e-6 && (place(1) - y as f64).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn whole_numbers_between_three_coordinates() {
        assert_eq!(span([3.2, -4.0, 7.0], 20), (0, 7));
        assert_eq!(span([3.2, 5.9, 4.0], 20), (4, 5));
        assert_eq!(span([3.0, 30.0, 4.0], 20), (3, 19));
        let (low, high) = span([3.2, 3.9, 3.5], 20);
        assert!(low > high);
    }
}
