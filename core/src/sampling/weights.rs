//! Barycentric interpolation at the target resolution (paper section 4.2, equations 1 and 2), as a table computed once.

use ndarray::{Array3, ArrayView2};
use rayon::prelude::*;

use super::error::{Error, check_size};
use super::raster::{self, Entry};
use crate::geometry::{SensorToView, Size, Triangulation, triangulate};

/// For each output pixel three samples and their weights (≥ 0, sum 1): applied to any view and any channels.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    width: usize,
    height: usize,
    samples: usize,
    entries: Vec<Entry>,
}

impl Weights {
    /// The table for samples at `centres` (pixels of a `sensor` frame) and a `target` view. Outside the triangulation a pixel has the value of the nearest point of its outline.
    ///
    /// # Errors
    /// Sizes out of range; centres that cannot be triangulated (see [`triangulate`]).
    ///
    /// ```
    /// use lenslet_core::geometry::Size;
    /// use lenslet_core::sampling::Weights;
    /// // Four samples at the corners of a 3×3 frame, seen at its own size.
    /// let table = Weights::new(&[[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [2.0, 2.0]], Size::new(3, 3), Size::new(3, 3))?;
    /// let view = table.apply(ndarray::array![[0.0], [2.0], [4.0], [6.0]].view())?;
    /// assert_eq!((view[[0, 1, 0]], view[[1, 1, 0]]), (1.0, 3.0));
    /// # Ok::<(), lenslet_core::sampling::Error>(())
    /// ```
    pub fn new(centres: &[[f64; 2]], sensor: Size, target: Size) -> Result<Self, Error> {
        check_size("sensor", sensor)?;
        check_size("view", target)?;
        let mesh = triangulate(centres)?;
        Ok(Self::from_mesh(&mesh, centres, sensor, target))
    }

    fn from_mesh(mesh: &Triangulation, centres: &[[f64; 2]], sensor: Size, target: Size) -> Self {
        let points = SensorToView::new(sensor, target).all_to_view(centres);
        let Size { width, height } = target;
        let mut entries = raster::draw(mesh, &points, target);
        let outline = Outline::new(mesh, &points);
        entries.par_chunks_mut(width).enumerate().for_each(|(t, row)| {
            for (s, entry) in row.iter_mut().enumerate() {
                if entry.index[0] == u32::MAX {
                    *entry = outline.nearest(&points, s as f64, t as f64);
                }
            }
        });
        Weights { width, height, samples: centres.len(), entries }
    }

    /// Output size.
    pub fn size(&self) -> Size {
        Size::new(self.width, self.height)
    }

    /// Number of samples the table refers to.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// Samples and weights of output pixel (`s`, `t`), if it exists.
    pub fn entry(&self, s: usize, t: usize) -> Option<([u32; 3], [f32; 3])> {
        let inside = s < self.width && t < self.height;
        inside.then(|| &self.entries[t * self.width + s]).map(|e| (e.index, e.weight))
    }

    /// Interpolates `values` (samples, channels): shape (t, s, channels).
    ///
    /// # Errors
    /// When `values` does not have one row per sample.
    pub fn apply(&self, values: ArrayView2<'_, f32>) -> Result<Array3<f32>, Error> {
        let channels = values.ncols();
        if values.nrows() != self.samples {
            return Err(Error::Shape(format!(
                "{} samples given to a weight table made for {}",
                values.nrows(),
                self.samples
            )));
        }
        let mut out = Array3::zeros((self.height, self.width, channels));
        if let Some(flat) = out.as_slice_mut() {
            match channels {
                0 => {}
                1 => self.gather::<1>(&packed(values), flat),
                3 => self.gather::<3>(&packed(values), flat),
                _ => self.gather_any(values, flat),
            }
        }
        Ok(out)
    }

    fn gather<const C: usize>(&self, values: &[[f32; C]], out: &mut [f32]) {
        out.par_chunks_mut(self.width * C).zip(self.entries.par_chunks(self.width)).for_each(|(row, entries)| {
            for (pixel, e) in row.chunks_exact_mut(C).zip(entries) {
                let [a, b, c] = e.index.map(|k| values[k as usize]);
                let w = e.weight;
                for k in 0..C {
                    pixel[k] = w[0] * a[k] + w[1] * b[k] + w[2] * c[k];
                }
            }
        });
    }

    fn gather_any(&self, values: ArrayView2<'_, f32>, out: &mut [f32]) {
        let channels = values.ncols();
        out.par_chunks_mut(self.width * channels).zip(self.entries.par_chunks(self.width)).for_each(
            |(row, entries)| {
                for (pixel, e) in row.chunks_exact_mut(channels).zip(entries) {
                    for (k, p) in pixel.iter_mut().enumerate() {
                        *p = (0..3).map(|n| e.weight[n] * values[[e.index[n] as usize, k]]).sum();
                    }
                }
            },
        );
    }
}

/// Rows of `values` as fixed-size arrays.
fn packed<const C: usize>(values: ArrayView2<'_, f32>) -> Vec<[f32; C]> {
    values.rows().into_iter().map(|r| std::array::from_fn(|k| r[k])).collect()
}

/// The outline's edges in buckets, to find the nearest one quickly.
struct Outline {
    cell: f64,
    origin: [f64; 2],
    columns: usize,
    rows: usize,
    buckets: Vec<Vec<u32>>,
    edges: Vec<[u32; 2]>,
}

impl Outline {
    fn new(mesh: &Triangulation, points: &[[f64; 2]]) -> Self {
        let edges = mesh.outline.clone();
        let ends = || edges.iter().flatten().map(|&v| points[v as usize]);
        let low = ends().fold([f64::INFINITY; 2], |m, p| [m[0].min(p[0]), m[1].min(p[1])]);
        let high = ends().fold([f64::NEG_INFINITY; 2], |m, p| [m[0].max(p[0]), m[1].max(p[1])]);
        // A quarter as many cells along the longer side as there are edges, so that a border cell holds a few edges.
        let extent = (high[0] - low[0]).max(high[1] - low[1]).max(1e-9);
        let cell = extent / (edges.len() as f64 / 4.0).clamp(1.0, 512.0);
        let count = |k: usize| ((high[k] - low[k]) / cell) as usize + 1;
        let (columns, rows) = (count(0), count(1));
        let mut buckets = vec![Vec::new(); columns * rows];
        for (n, e) in edges.iter().enumerate() {
            let [a, b] = e.map(|v| points[v as usize]);
            let at = |v: f64, k: usize| ((v - low[k]) / cell) as usize;
            for y in at(a[1].min(b[1]), 1)..=at(a[1].max(b[1]), 1) {
                for x in at(a[0].min(b[0]), 0)..=at(a[0].max(b[0]), 0) {
                    buckets[y * columns + x].push(n as u32);
                }
            }
        }
        Outline { cell, origin: low, columns, rows, buckets, edges }
    }

    /// The nearest point of the outline to (`x`, `y`), as weights of its edge's ends.
    fn nearest(&self, points: &[[f64; 2]], x: f64, y: f64) -> Entry {
        let at = |v: f64, k: usize, n: usize| (((v - self.origin[k]) / self.cell).max(0.0) as usize).min(n - 1);
        let (cx, cy) = (at(x, 0, self.columns), at(y, 1, self.rows));
        // The cell is clamped to the grid. For a pixel outside the grid the bound below is still valid, only less
        // tight.
        let mut best = (f64::INFINITY, u32::MAX, 0.0);
        for ring in 0..self.columns.max(self.rows) {
            // Edges not yet visited lie outside a square of (ring − 1) whole cells around the pixel's cell.
            if best.0.sqrt() <= (ring as f64 - 1.0) * self.cell {
                break;
            }
            let (x0, x1) = (cx as i64 - ring as i64, cx as i64 + ring as i64);
            let (y0, y1) = (cy as i64 - ring as i64, cy as i64 + ring as i64);
            for gy in y0.max(0)..=y1.min(self.rows as i64 - 1) {
                let whole = gy == y0 || gy == y1;
                let step = if whole || ring == 0 { 1 } else { 2 * ring };
                for gx in (x0..=x1).step_by(step) {
                    if gx < 0 || gx >= self.columns as i64 {
                        continue;
                    }
                    for &n in &self.buckets[gy as usize * self.columns + gx as usize] {
                        let [a, b] = self.edges[n as usize].map(|v| points[v as usize]);
                        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
                        let f = (((x - a[0]) * dx + (y - a[1]) * dy) / (dx * dx + dy * dy)).clamp(0.0, 1.0);
                        let (ex, ey) = (a[0] + f * dx - x, a[1] + f * dy - y);
                        let d = ex * ex + ey * ey;
                        if d < best.0 || (d == best.0 && n < best.1) {
                            best = (d, n, f);
                        }
                    }
                }
            }
        }
        match self.edges.get(best.1 as usize) {
            Some(&[a, b]) => raster::weighted([a, b, b], [1.0 - best.2, best.2, 0.0]),
            None => raster::weighted([0, 0, 0], [1.0, 0.0, 0.0]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Lattice, Size};
    use ndarray::Array2;
    use spade::{DelaunayTriangulation, FloatTriangulation, Point2};

    fn lattice() -> Vec<[f64; 2]> {
        let mut centres =
            Lattice::hexagonal(10.0, 0.003, 1.0004, [102.3, 71.1]).points_within(Size::new(400, 300), 0.0).centres;
        for (k, c) in centres.iter_mut().enumerate() {
            c[0] += ((k * 37) % 11) as f64 * 0.02 - 0.1;
            c[1] += ((k * 53) % 13) as f64 * 0.02 - 0.12;
        }
        centres
    }

    #[test]
    fn a_plane_is_reproduced_inside_and_weights_sum_to_one() {
        let centres = lattice();
        let table = Weights::new(&centres, Size::new(400, 300), Size::new(131, 98)).unwrap();
        let f = |x: f64, y: f64| 0.3 + 0.002 * x - 0.001 * y;
        let values = Array2::from_shape_fn((centres.len(), 1), |(k, _)| f(centres[k][0], centres[k][1]) as f32);
        let view = table.apply(values.view()).unwrap();
        for t in 6..92 {
            for s in 6..125 {
                let (x, y) = ((s as f64 + 0.5) * 400.0 / 131.0 - 0.5, (t as f64 + 0.5) * 300.0 / 98.0 - 0.5);
                assert!((f64::from(view[[t, s, 0]]) - f(x, y)).abs() < 1e-5, "({s}, {t})");
            }
        }
        for t in 0..98 {
            for s in 0..131 {
                let (index, weight) = table.entry(s, t).unwrap();
                assert!((weight.iter().sum::<f32>() - 1.0).abs() < 1e-6);
                assert!(weight.iter().all(|&w| w >= 0.0) && index.iter().all(|&k| (k as usize) < centres.len()));
            }
        }
        assert!(table.entry(131, 0).is_none());
    }

    #[test]
    fn equals_the_plain_query_of_the_triangulation() {
        let centres = lattice();
        let target = Size::new(140, 105);
        let table = Weights::new(&centres, Size::new(400, 300), target).unwrap();
        let points: Vec<Point2<f64>> = centres.iter().map(|c| Point2::new(c[0], c[1])).collect();
        let mesh = DelaunayTriangulation::<Point2<f64>>::bulk_load_stable(points).unwrap();
        let query = mesh.barycentric();
        let values = Array2::from_shape_fn((centres.len(), 1), |(k, _)| ((k * 7919) % 101) as f32 / 100.0);
        let view = table.apply(values.view()).unwrap();
        let mut found = Vec::new();
        for t in 5..100 {
            for s in 5..135 {
                let p = Point2::new((s as f64 + 0.5) * 400.0 / 140.0 - 0.5, (t as f64 + 0.5) * 300.0 / 105.0 - 0.5);
                query.get_weights(p, &mut found);
                let plain: f64 = found.iter().map(|(v, w)| w * f64::from(values[[v.index(), 0]])).sum();
                assert!((f64::from(view[[t, s, 0]]) - plain).abs() < 1e-5, "({s}, {t})");
            }
        }
    }

    #[test]
    fn outside_the_outline_the_nearest_edge_decides() {
        let centres = lattice();
        let target = Size::new(80, 60);
        let table = Weights::new(&centres, Size::new(400, 300), target).unwrap();
        let mesh = triangulate(&centres).unwrap();
        let points = SensorToView::new(Size::new(400, 300), target).all_to_view(&centres);
        let inside = raster::draw(&mesh, &points, target);
        let mut checked = 0;
        for t in 0..60 {
            for s in 0..80 {
                if inside[t * 80 + s].index[0] != u32::MAX {
                    continue;
                }
                let (index, weight) = table.entry(s, t).unwrap();
                let place = |k: usize| (0..3).map(|n| f64::from(weight[n]) * points[index[n] as usize][k]).sum::<f64>();
                let got = (place(0) - s as f64).hypot(place(1) - t as f64);
                let plain = mesh
                    .outline
                    .iter()
                    .map(|e| {
                        let [a, b] = e.map(|v| points[v as usize]);
                        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
                        let f = ((s as f64 - a[0]) * dx + (t as f64 - a[1]) * dy) / (dx * dx + dy * dy);
                        let f = f.clamp(0.0, 1.0);
                        (a[0] + f * dx - s as f64).hypot(a[1] + f * dy - t as f64)
                    })
                    .fold(f64::INFINITY, f64::min);
                assert!((got - plain).abs() < 1e-4, "({s}, {t}): {got} against {plain}");
                checked += 1;
            }
        }
        assert!(checked > 100);
    }

    #[test]
    fn channels_do_not_matter_to_each_other() {
        let centres = lattice();
        let table = Weights::new(&centres, Size::new(400, 300), Size::new(50, 40)).unwrap();
        let values = Array2::from_shape_fn((centres.len(), 4), |(k, c)| ((k * 31 + c * 7) % 17) as f32);
        let all = table.apply(values.view()).unwrap();
        for c in 0..4 {
            let one = table.apply(values.slice(ndarray::s![.., c..=c])).unwrap();
            assert_eq!(one.slice(ndarray::s![.., .., 0]), all.slice(ndarray::s![.., .., c]));
        }
        let three = table.apply(values.slice(ndarray::s![.., ..3])).unwrap();
        assert_eq!(three, all.slice(ndarray::s![.., .., ..3]));
        assert_eq!(table.apply(values.slice(ndarray::s![.., ..0])).unwrap().dim(), (40, 50, 0));
        assert!(table.apply(values.slice(ndarray::s![1.., ..])).is_err());
    }

    #[test]
    fn sizes_out_of_range_are_errors() {
        let centres = lattice();
        assert!(Weights::new(&centres, Size::new(400, 300), Size::new(0, 10)).is_err());
        assert!(Weights::new(&centres, Size::new(0, 300), Size::new(10, 10)).is_err());
        assert!(Weights::new(&centres, Size::new(400, 300), Size::new(usize::MAX, 2)).is_err());
    }

    #[test]
    fn the_nearest_edge_is_found_around_outlines_of_any_shape() {
        // Samples in a part of the frame: wide, high, in a corner, four points, few and many.
        for (n, low, extent, target) in [
            (200, [90.0, 200.0], [220.0, 30.0], (60, 50)),
            (200, [300.0, 20.0], [30.0, 260.0], (60, 50)),
            (60, [10.0, 10.0], [80.0, 50.0], (50, 70)),
            (7, [200.0, 30.0], [100.0, 200.0], (50, 70)),
            (0, [20.0, 20.0], [20.0, 16.0], (80, 60)),
            (500, [200.0, 200.0], [190.0, 90.0], (80, 60)),
        ] {
            let (sensor, target) = (Size::new(400, 300), Size::from(target));
            let mut centres: Vec<[f64; 2]> = (0..n)
                .map(|k| {
                    // In an ellipse, so that the outline has many edges.
                    let (angle, r) = (f64::from(k) * 2.4, (f64::from(k) / f64::from(n)).sqrt());
                    [
                        low[0] + extent[0] * (1.0 + r * angle.cos()) / 2.0,
                        low[1] + extent[1] * (1.0 + r * angle.sin()) / 2.0,
                    ]
                })
                .collect();
            if n == 0 {
                centres = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.1]]
                    .map(|[x, y]| [low[0] + extent[0] * x, low[1] + extent[1] * y])
                    .to_vec();
            }
            let table = Weights::new(&centres, sensor, target).unwrap();
            let mesh = triangulate(&centres).unwrap();
            let points = SensorToView::new(sensor, target).all_to_view(&centres);
            let inside = raster::draw(&mesh, &points, target);
            for (at, _) in inside.iter().enumerate().filter(|(_, e)| e.index[0] == u32::MAX) {
                let (s, t) = (at % target.width, at / target.width);
                let (index, weight) = table.entry(s, t).unwrap();
                let place = |k: usize| (0..3).map(|n| f64::from(weight[n]) * points[index[n] as usize][k]).sum::<f64>();
                let got = (place(0) - s as f64).hypot(place(1) - t as f64);
                let plain = mesh.outline.iter().map(|e| {
                    let [a, b] = e.map(|v| points[v as usize]);
                    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
                    let f = ((s as f64 - a[0]) * dx + (t as f64 - a[1]) * dy) / (dx * dx + dy * dy);
                    let f = f.clamp(0.0, 1.0);
                    (a[0] + f * dx - s as f64).hypot(a[1] + f * dy - t as f64)
                });
                let plain = plain.fold(f64::INFINITY, f64::min);
                assert!((got - plain).abs() < 1e-3, "{n} points, ({s}, {t}): {got} against {plain}");
            }
        }
    }
}
