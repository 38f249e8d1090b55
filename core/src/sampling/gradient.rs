//! Gradients at scattered samples: the slope of the smoothest surface through each sample's neighbourhood.
//!
//! Objective, for each centre: of all surfaces through its neighbours that minimise the polyharmonic energy of φ(r) =
//! r³ and reproduce planes, take the slope at the centre. It is linear in the values, so each centre gets a fixed
//! stencil.

use rayon::prelude::*;

use crate::linalg::gauss_with_back_substitution;

/// Neighbours within this many mean edge lengths take part: two rings of a hexagonal lattice.
/// Source: chosen, the second ring reaches to 2.
const REACH: f64 = 2.1;
/// Largest number of neighbours used (the nearest); bounds the work where centres are dense.
/// Source: chosen, two rings have 18.
const MOST: usize = 24;
/// A smaller pivot means neighbours on one line; offsets are in units of the spacing.
/// Source: chosen, far above the rounding of f64.
const LEAST_PIVOT: f64 = 1e-9;

/// Slope stencils: the gradient of centre k is Σ (wx, wy)·(value of the neighbour) over `start[k]..start[k+1]`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stencils {
    pub start: Vec<u32>,
    pub neighbour: Vec<u32>,
    pub weight: Vec<[f32; 2]>,
}

/// Stencils at `points`, whose typical spacing is `spacing`.
pub(super) fn stencils(points: &[[f64; 2]], spacing: f64) -> Stencils {
    let buckets = Buckets::new(points, spacing * REACH);
    let each: Vec<Vec<(u32, [f32; 2])>> = (0..points.len())
        .into_par_iter()
        .map_init(Scratch::default, |scratch, k| stencil(points, k, spacing, &buckets, scratch))
        .collect();
    let mut out = Stencils { start: vec![0], neighbour: Vec::new(), weight: Vec::new() };
    for list in each {
        for (n, w) in list {
            out.neighbour.push(n);
            out.weight.push(w);
        }
        out.start.push(out.neighbour.len() as u32);
    }
    out
}

#[derive(Default)]
struct Scratch {
    near: Vec<(f64, u32)>,
    matrix: Vec<f64>,
}

fn stencil(
    points: &[[f64; 2]],
    k: usize,
    spacing: f64,
    buckets: &Buckets,
    scratch: &mut Scratch,
) -> Vec<(u32, [f32; 2])> {
    let p = points[k];
    let near = &mut scratch.near;
    near.clear();
    buckets.within(points, p, spacing * REACH, near);
    near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    near.truncate(MOST);
    let m = near.len();
    if m < 3 {
        return Vec::new();
    }
    // Offsets in units of the spacing keep the system well scaled.
    let q: Vec<[f64; 2]> = near
        .iter()
        .map(|&(_, n)| {
            let o = points[n as usize];
            [(o[0] - p[0]) / spacing, (o[1] - p[1]) / spacing]
        })
        .collect();
    // [Φ P; Pᵀ 0] [w; μ] = right, with two right-hand sides: d/dx and d/dy at the centre.
    let (n, columns) = (m + 3, m + 5);
    let a = &mut scratch.matrix;
    a.clear();
    a.resize(n * columns, 0.0);
    for i in 0..m {
        for j in 0..m {
            let r = (q[i][0] - q[j][0]).hypot(q[i][1] - q[j][1]);
            a[i * columns + j] = r * r * r;
        }
        for (c, v) in [1.0, q[i][0], q[i][1]].into_iter().enumerate() {
            a[i * columns + m + c] = v;
            a[(m + c) * columns + i] = v;
        }
        // Gradient at 0 of φ(x − q) = |x − q|³ is −3|q|·q.
        let r = q[i][0].hypot(q[i][1]);
        a[i * columns + n] = -3.0 * r * q[i][0];
        a[i * columns + n + 1] = -3.0 * r * q[i][1];
    }
    a[(m + 1) * columns + n] = 1.0;
    a[(m + 2) * columns + n + 1] = 1.0;
    if gauss_with_back_substitution(a, n, columns, LEAST_PIVOT).is_none() {
        return Vec::new();
    }
    (0..m).map(|i| (near[i].1, [0, 1].map(|c| (a[i * columns + n + c] / spacing) as f32))).collect()
}

/// Points in square cells as wide as the reach.
struct Buckets {
    low: [f64; 2],
    cell: f64,
    columns: usize,
    rows: usize,
    start: Vec<u32>,
    list: Vec<u32>,
}

impl Buckets {
    fn new(points: &[[f64; 2]], reach: f64) -> Self {
        let fold = |pick: fn(f64, f64) -> f64, from: f64| {
            points.iter().fold([from; 2], |m, p| [pick(m[0], p[0]), pick(m[1], p[1])])
        };
        let (low, high) = (fold(f64::min, f64::INFINITY), fold(f64::max, f64::NEG_INFINITY));
        let extent = (high[0] - low[0]).max(high[1] - low[1]).max(1e-9);
        // Never more than about 4096 cells a side, whatever the points are.
        let cell = reach.max(extent / 4096.0).max(1e-9);
        let columns = ((high[0] - low[0]) / cell) as usize + 1;
        let rows = ((high[1] - low[1]) / cell) as usize + 1;
        let mut out =
            Buckets { low, cell, columns, rows, start: vec![0; columns * rows + 1], list: vec![0; points.len()] };
        for p in points {
            let c = out.cell_of(*p);
            out.start[c + 1] += 1;
        }
        for c in 0..columns * rows {
            out.start[c + 1] += out.start[c];
        }
        let mut next = out.start.clone();
        for (k, p) in points.iter().enumerate() {
            let c = out.cell_of(*p);
            out.list[next[c] as usize] = k as u32;
            next[c] += 1;
        }
        out
    }

    fn cell_along(&self, v: f64, k: usize, n: usize) -> usize {
        (((v - self.low[k]) / self.cell).max(0.0) as usize).min(n - 1)
    }

    fn cell_of(&self, p: [f64; 2]) -> usize {
        self.cell_along(p[1], 1, self.rows) * self.columns + self.cell_along(p[0], 0, self.columns)
    }

    fn within(&self, points: &[[f64; 2]], p: [f64; 2], reach: f64, out: &mut Vec<(f64, u32)>) {
        let (x0, x1) = (self.cell_along(p[0] - reach, 0, self.columns), self.cell_along(p[0] + reach, 0, self.columns));
        let (y0, y1) = (self.cell_along(p[1] - reach, 1, self.rows), self.cell_along(p[1] + reach, 1, self.rows));
        for y in y0..=y1 {
            let row = y * self.columns;
            for &n in &self.list[self.start[row + x0] as usize..self.start[row + x1 + 1] as usize] {
                let q = points[n as usize];
                let d = (q[0] - p[0]).hypot(q[1] - p[1]);
                if d <= reach {
                    out.push((d, n));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Lattice, Size};

    #[test]
    fn slopes_of_planes_are_exact_and_of_parabolas_close() {
        let mut points =
            Lattice::hexagonal(3.3, 0.01, 1.0005, [20.0, 20.0]).points_within(Size::new(60, 50), 0.0).centres;
        for (k, p) in points.iter_mut().enumerate() {
            p[0] += ((k * 37) % 11) as f64 * 0.02;
        }
        let stencils = stencils(&points, 3.3);
        for k in 0..points.len() {
            let p = points[k];
            let range = stencils.start[k] as usize..stencils.start[k + 1] as usize;
            assert!(range.len() >= 5);
            let slope = |f: &dyn Fn([f64; 2]) -> f64| {
                range.clone().fold([0.0; 2], |s, n| {
                    let v = f(points[stencils.neighbour[n] as usize]);
                    let w = stencils.weight[n];
                    [s[0] + v * f64::from(w[0]), s[1] + v * f64::from(w[1])]
                })
            };
            let plane = slope(&|q| 2.0 + 0.3 * q[0] - 0.2 * q[1]);
            assert!((plane[0] - 0.3).abs() < 1e-4 && (plane[1] + 0.2).abs() < 1e-4, "{plane:?}");
            if p[0] > 8.0 && p[1] > 8.0 && p[0] < 50.0 && p[1] < 40.0 {
                let bowl = slope(&|q| 0.01 * (q[0] - 30.0).powi(2) + 0.02 * q[0] * q[1]);
                assert!((bowl[0] - (0.02 * (p[0] - 30.0) + 0.02 * p[1])).abs() < 0.01);
            }
        }
    }

    #[test]
    fn a_point_without_neighbours_has_no_slope() {
        let stencils = stencils(&[[0.0, 0.0], [100.0, 0.0], [0.0, 100.0]], 1.0);
        assert_eq!(stencils.start, vec![0, 0, 0, 0]);
    }

    #[test]
    fn surfaces_of_the_family_have_their_own_slopes() {
        // φ at the corners of a parallelogram with the signs + − − + minimises the energy that is asked for.
        let points: Vec<[f64; 2]> = (0..30).map(|k| [f64::from(k % 6) * 1.1, f64::from(k / 6) * 0.9]).collect();
        let stencils = stencils(&points, 1.0);
        let p = points[14];
        let corners = [(7, 1.0), (8, -1.0), (13, -1.0), (14, 1.0)];
        let value = |x: [f64; 2]| -> f64 {
            corners
                .iter()
                .map(|&(n, w): &(usize, f64)| w * (x[0] - points[n][0]).hypot(x[1] - points[n][1]).powi(3))
                .sum()
        };
        let truth = [0, 1].map(|c| {
            corners
                .iter()
                .map(|&(n, w)| {
                    let d = [p[0] - points[n][0], p[1] - points[n][1]];
                    w * 3.0 * d[0].hypot(d[1]) * d[c]
                })
                .sum::<f64>()
        });
        let range = stencils.start[14] as usize..stencils.start[15] as usize;
        let found = range.fold([0.0; 2], |s, n| {
            let v = value(points[stencils.neighbour[n] as usize]);
            [0, 1].map(|c| s[c] + v * f64::from(stencils.weight[n][c]))
        });
        for c in 0..2 {
            assert!(truth[c].abs() > 0.1 && (found[c] - truth[c]).abs() < 1e-5, "{found:?} against {truth:?}");
        }
    }

    #[test]
    fn the_nearest_24_take_part_where_centres_are_dense() {
        let points: Vec<[f64; 2]> = (0..81).map(|k| [f64::from(k % 9) * 0.5, f64::from(k / 9) * 0.501]).collect();
        let stencils = stencils(&points, 1.0);
        let range = stencils.start[40] as usize..stencils.start[41] as usize;
        assert_eq!(range.len(), MOST);
        let distance = |n: usize| (points[n][0] - points[40][0]).hypot(points[n][1] - points[40][1]);
        let mut all: Vec<f64> = (0..81).map(distance).collect();
        all.sort_by(f64::total_cmp);
        assert!(range.map(|k| distance(stencils.neighbour[k] as usize)).all(|d| d <= all[MOST - 1]));
    }

    #[test]
    fn buckets_find_what_a_search_of_all_points_finds() {
        // Far from the origin, wide, high, one cell, and a few points a great distance apart.
        for (n, low, extent, reach) in [
            (300, [-70.0, 1000.0], [60.0, 30.0], 2.7),
            (300, [1000.0, -70.0], [20.0, 80.0], 2.7),
            (300, [0.0, 50.0], [30.0, 30.0], 40.0),
            (60, [5.0, 3.0], [1e9, 1e8], 1.0),
        ] {
            let points: Vec<[f64; 2]> = (0..n)
                .map(|k| {
                    [
                        low[0] + f64::from(k * 37 % 101) / 101.0 * extent[0],
                        low[1] + f64::from(k * 53 % 97) / 97.0 * extent[1],
                    ]
                })
                .collect();
            let buckets = Buckets::new(&points, reach);
            assert!(buckets.columns <= 4097 && buckets.rows <= 4097, "{} {}", buckets.columns, buckets.rows);
            for p in &points {
                let mut found = Vec::new();
                buckets.within(&points, *p, reach, &mut found);
                let mut found: Vec<u32> = found.into_iter().map(|f| f.1).collect();
                found.sort_unstable();
                let near = |k: &u32| {
                    let q = points[*k as usize];
                    (q[0] - p[0]).hypot(q[1] - p[1]) <= reach
                };
                assert_eq!(found, (0..n as u32).filter(near).collect::<Vec<u32>>());
            }
        }
    }
}
