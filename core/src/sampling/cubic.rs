//! A cubic C¹ surface through the samples: Clough and Tocher's split triangles, a stronger baseline than section 4.2.
//!
//! Every triangle of the triangulation is split at its centroid into three cubics that meet with equal slope and take
//! the samples' values and slopes at the corners. The slope across an edge varies linearly along it, so neighbouring
//! triangles meet with equal slope too. Values and slopes enter linearly: a pixel has nine weights.

use ndarray::{Array3, ArrayView2};
use rayon::prelude::*;

use super::error::Error;
use super::gradient::{self, Stencils};
use super::weights::Weights;
use crate::geometry::{SensorToView, Size};

/// A linear form in the three corner values and the three corner slopes: (f₀ f₁ f₂ gx₀ gx₁ gx₂ gy₀ gy₁ gy₂).
type Form = [f64; 9];

#[derive(Debug, Clone, Copy, PartialEq)]
struct Entry {
    index: [u32; 3],
    weight: [f32; 9],
}

/// The surface's weights for every output pixel, and the slope stencils of the samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Cubic {
    width: usize,
    height: usize,
    samples: usize,
    stencils: Stencils,
    entries: Vec<Entry>,
}

impl Cubic {
    /// The tables for samples at `centres` (pixels of a `sensor` frame) and a `target` = (width, height) view. Outside
    /// the triangulation a pixel has the value of the nearest point of its outline.
    ///
    /// # Errors
    /// As [`Weights::new`].
    ///
    /// ```
    /// use lenslet_core::geometry::{Lattice, Size};
    /// use lenslet_core::sampling::Cubic;
    /// let size = Size::new(30, 24);
    /// let centres = Lattice::hexagonal(3.3, 0.0, 1.0, [1.0, 1.0]).points_within(size, 0.0).centres;
    /// let surface = Cubic::new(&centres, size, size)?;
    /// // Planes are reproduced.
    /// let values =
    ///     ndarray::Array2::from_shape_fn((centres.len(), 1), |(k, _)| (centres[k][0] - centres[k][1]) as f32);
    /// assert!((surface.apply(values.view())?[[10, 14, 0]] - 4.0).abs() < 1e-4);
    /// # Ok::<(), lenslet_core::sampling::Error>(())
    /// ```
    pub fn new(centres: &[[f64; 2]], sensor: Size, target: Size) -> Result<Self, Error> {
        let linear = Weights::new(centres, sensor, target)?;
        let points = SensorToView::new(sensor, target).all_to_view(centres);
        let Size { width, height } = target;
        let blank = Entry { index: [0; 3], weight: [0.0; 9] };
        let mut entries = vec![blank; width * height];
        entries.par_chunks_mut(width).enumerate().for_each(|(t, row)| {
            // Neighbouring pixels often share a triangle.
            let mut last: Option<([u32; 3], Patch)> = None;
            for (s, entry) in row.iter_mut().enumerate() {
                let Some((index, weight)) = linear.entry(s, t) else { continue };
                entry.index = index;
                let form = if index[1] == index[2] {
                    along(index.map(|k| points[k as usize]), f64::from(weight[1]))
                } else {
                    let patch = match &mut last {
                        Some((known, patch)) if *known == index => patch,
                        slot => &mut slot.insert((index, Patch::new(index.map(|k| points[k as usize])))).1,
                    };
                    patch.at(weight.map(f64::from))
                };
                entry.weight = form.map(|w| w as f32);
            }
        });
        let stencils = gradient::stencils(&points, spacing(&points));
        Ok(Cubic { width, height, samples: centres.len(), stencils, entries })
    }

    /// Interpolates `values` (samples, channels): shape (t, s, channels). Signed, may overshoot.
    ///
    /// # Errors
    /// When `values` does not have one row per sample.
    pub fn apply(&self, values: ArrayView2<'_, f32>) -> Result<Array3<f32>, Error> {
        let channels = values.ncols();
        if values.nrows() != self.samples {
            let n = values.nrows();
            return Err(Error::Shape(format!("{n} samples given to a surface made for {}", self.samples)));
        }
        let mut out = Array3::zeros((self.height, self.width, channels));
        if let Some(flat) = out.as_slice_mut() {
            if channels == 3 {
                self.gather::<3>(values, 0, flat, 3);
            } else {
                for c in 0..channels {
                    self.gather::<1>(values, c, flat, channels);
                }
            }
        }
        Ok(out)
    }

    /// Channels `first..first + C` of the output, whose pixels are `channels` values apart.
    fn gather<const C: usize>(&self, values: ArrayView2<'_, f32>, first: usize, out: &mut [f32], channels: usize) {
        let value: Vec<[f32; C]> = values.rows().into_iter().map(|r| std::array::from_fn(|c| r[first + c])).collect();
        // Value, d/dx and d/dy are stored together, so that each lenslet takes one memory read.
        let jet: Vec<[[f32; C]; 3]> = (0..self.samples)
            .into_par_iter()
            .with_min_len(1024)
            .map(|k| {
                let mut slope = [[0f32; C]; 2];
                for n in self.stencils.start[k] as usize..self.stencils.start[k + 1] as usize {
                    let w = self.stencils.weight[n];
                    let v = value[self.stencils.neighbour[n] as usize];
                    for c in 0..C {
                        slope[0][c] += w[0] * v[c];
                        slope[1][c] += w[1] * v[c];
                    }
                }
                [value[k], slope[0], slope[1]]
            })
            .collect();
        let width = self.width;
        out.par_chunks_mut(width * channels).zip(self.entries.par_chunks(width)).for_each(|(row, entries)| {
            for (pixel, e) in row.chunks_exact_mut(channels).zip(entries) {
                let mut sum = [0f32; C];
                for (corner, &k) in e.index.iter().enumerate() {
                    let j = &jet[k as usize];
                    for (part, values) in j.iter().enumerate() {
                        let w = e.weight[3 * part + corner];
                        for c in 0..C {
                            sum[c] += w * values[c];
                        }
                    }
                }
                pixel[first..first + C].copy_from_slice(&sum);
            }
        });
    }
}

/// Typical distance of neighbours, from how densely the points lie.
fn spacing(points: &[[f64; 2]]) -> f64 {
    let fold = |pick: fn(f64, f64) -> f64, from: f64| {
        points.iter().fold([from; 2], |m, p| [pick(m[0], p[0]), pick(m[1], p[1])])
    };
    let (low, high) = (fold(f64::min, f64::INFINITY), fold(f64::max, f64::NEG_INFINITY));
    let area = (high[0] - low[0]) * (high[1] - low[1]);
    (area / points.len() as f64 * 2.0 / 3f64.sqrt()).sqrt().max(1e-9)
}

/// The cubic along an edge from corner 0 to corner 1 at fraction `f` (Hermite).
fn along(p: [[f64; 2]; 3], f: f64) -> Form {
    let e = [p[1][0] - p[0][0], p[1][1] - p[0][1]];
    let (f2, f3) = (f * f, f * f * f);
    let (h0, h1) = (f3 - 2.0 * f2 + f, f3 - f2);
    let v1 = 3.0 * f2 - 2.0 * f3;
    [1.0 - v1, v1, 0.0, h0 * e[0], h1 * e[0], 0.0, h0 * e[1], h1 * e[1], 0.0]
}

/// The Bézier ordinates of one split triangle, each a linear form. `n` counts the corners.
struct Patch {
    corner: [Form; 3],
    /// `edge[i][0]`, `edge[i][1]`: on the edge opposite corner i, near its first (i+1) and second (i+2) end.
    edge: [[Form; 2]; 3],
    /// One third of the way from corner n to the centroid.
    spoke: [Form; 3],
    /// The inner ordinate of the part opposite corner i.
    inner: [Form; 3],
    /// Two thirds of the way from corner n to the centroid.
    hub: [Form; 3],
    centre: Form,
}

fn mix<const N: usize>(parts: [(f64, &Form); N]) -> Form {
    let mut out = [0.0; 9];
    for (w, form) in parts {
        for (o, v) in out.iter_mut().zip(form) {
            *o += w * v;
        }
    }
    out
}

/// Value at corner `n` plus slope there times (`dx`, `dy`).
fn taylor(n: usize, dx: f64, dy: f64) -> Form {
    let mut out = [0.0; 9];
    out[n] = 1.0;
    out[3 + n] = dx;
    out[6 + n] = dy;
    out
}

impl Patch {
    fn new(p: [[f64; 2]; 3]) -> Self {
        let s = [(p[0][0] + p[1][0] + p[2][0]) / 3.0, (p[0][1] + p[1][1] + p[2][1]) / 3.0];
        let toward = |n: usize, q: [f64; 2]| taylor(n, (q[0] - p[n][0]) / 3.0, (q[1] - p[n][1]) / 3.0);
        let corner = [0, 1, 2].map(|n| taylor(n, 0.0, 0.0));
        let edge = [0, 1, 2].map(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            [toward(j, p[k]), toward(k, p[j])]
        });
        let spoke = [0, 1, 2].map(|n| toward(n, s));
        let inner = [0, 1, 2].map(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            let (e, h) = ([p[k][0] - p[j][0], p[k][1] - p[j][1]], [s[0] - p[j][0], s[1] - p[j][1]]);
            let tau = (h[0] * e[0] + h[1] * e[1]) / (e[0] * e[0] + e[1] * e[1]);
            // The normal from the edge to the centroid, and its barycentric parts in (corner j, corner k, centroid).
            let normal = [h[0] - tau * e[0], h[1] - tau * e[1]];
            let (da, db) = (tau - 1.0, -tau);
            // Slope across the edge at its middle: mean of the ends (first line) = Bézier derivative (the rest).
            let mut want = [0.0; 9];
            for n in [j, k] {
                want[3 + n] = normal[0] / 2.0;
                want[6 + n] = normal[1] / 2.0;
            }
            mix([
                (2.0 / 3.0, &want),
                (-0.5 * da, &corner[j]),
                (-0.5 * db - da, &edge[i][0]),
                (-0.5 * da - db, &edge[i][1]),
                (-0.5 * db, &corner[k]),
                (-0.5, &spoke[j]),
                (-0.5, &spoke[k]),
            ])
        });
        let third = 1.0 / 3.0;
        let hub =
            [0, 1, 2].map(|n| mix([(third, &spoke[n]), (third, &inner[(n + 1) % 3]), (third, &inner[(n + 2) % 3])]));
        let centre = mix([(third, &hub[0]), (third, &hub[1]), (third, &hub[2])]);
        Patch { corner, edge, spoke, inner, hub, centre }
    }

    /// The surface at barycentric `l`.
    fn at(&self, l: [f64; 3]) -> Form {
        // The part opposite the corner that is farthest: there the barycentric coordinates are these.
        let i = (0..3).min_by(|&a, &b| l[a].total_cmp(&l[b])).unwrap_or(0);
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        let (c, a, b) = (3.0 * l[i], l[j] - l[i], l[k] - l[i]);
        mix([
            (a * a * a, &self.corner[j]),
            (3.0 * a * a * b, &self.edge[i][0]),
            (3.0 * a * b * b, &self.edge[i][1]),
            (b * b * b, &self.corner[k]),
            (3.0 * a * a * c, &self.spoke[j]),
            (3.0 * b * b * c, &self.spoke[k]),
            (6.0 * a * b * c, &self.inner[i]),
            (3.0 * a * c * c, &self.hub[j]),
            (3.0 * b * c * c, &self.hub[k]),
            (c * c * c, &self.centre),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Lattice, Size};
    use crate::sampling::raster::barycentric;
    use ndarray::Array2;

    const P: [[f64; 2]; 3] = [[0.0, 0.0], [3.2, 0.3], [1.1, 2.9]];
    const Q: [[f64; 2]; 3] = [[4.6, 3.1], [1.1, 2.9], [3.2, 0.3]];

    fn value(p: [[f64; 2]; 3], data: &[[f64; 3]; 3], x: f64, y: f64) -> f64 {
        let form = Patch::new(p).at(barycentric(p, x, y));
        (0..3).map(|n| form[n] * data[n][0] + form[3 + n] * data[n][1] + form[6 + n] * data[n][2]).sum()
    }

    #[test]
    fn quadratics_are_reproduced() {
        let f = |x: f64, y: f64| 1.0 + 0.5 * x - 0.2 * y + 0.3 * x * x - 0.4 * x * y + 0.1 * y * y;
        let data = P.map(|[x, y]| [f(x, y), 0.5 + 0.6 * x - 0.4 * y, -0.2 - 0.4 * x + 0.2 * y]);
        for a in 0..=10 {
            for b in 0..=10 - a {
                let l = [f64::from(a) / 10.0, f64::from(b) / 10.0, f64::from(10 - a - b) / 10.0];
                let x: f64 = (0..3).map(|n| l[n] * P[n][0]).sum();
                let y: f64 = (0..3).map(|n| l[n] * P[n][1]).sum();
                assert!((value(P, &data, x, y) - f(x, y)).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn slopes_agree_across_every_seam() {
        // Arbitrary data at the four corners of two triangles that share the edge P1–P2.
        let shared = [[0.7, -1.1, 0.4], [-0.3, 0.8, 1.7]];
        let left = [[1.0, 0.3, -0.6], shared[0], shared[1]];
        let right = [[-2.0, 0.9, 0.2], shared[1], shared[0]];
        let h = 1e-5;
        let slope = |p, data: &[[f64; 3]; 3], x: f64, y: f64| {
            [
                (value(p, data, x + h, y) - value(p, data, x - h, y)) / (2.0 * h),
                (value(p, data, x, y + h) - value(p, data, x, y - h)) / (2.0 * h),
            ]
        };
        for k in 1..10 {
            let f = f64::from(k) / 10.0;
            let (x, y) = (P[1][0] + f * (P[2][0] - P[1][0]), P[1][1] + f * (P[2][1] - P[1][1]));
            assert!((value(P, &left, x, y) - value(Q, &right, x, y)).abs() < 1e-9);
            let (a, b) = (slope(P, &left, x, y), slope(Q, &right, x, y));
            assert!((a[0] - b[0]).abs() < 1e-4 && (a[1] - b[1]).abs() < 1e-4, "{a:?} {b:?}");
            // And across a spoke inside: two small steps to either side of it.
            let s = [(P[0][0] + P[1][0] + P[2][0]) / 3.0, (P[0][1] + P[1][1] + P[2][1]) / 3.0];
            let (x, y) = (P[0][0] + f * (s[0] - P[0][0]), P[0][1] + f * (s[1] - P[0][1]));
            let (a, b) = (slope(P, &left, x + 1e-4, y - 1e-4), slope(P, &left, x - 1e-4, y + 1e-4));
            assert!((a[0] - b[0]).abs() < 1e-2 && (a[1] - b[1]).abs() < 1e-2, "{a:?} {b:?}");
        }
    }

    #[test]
    fn planes_come_back_and_samples_are_met() {
        let centres =
            Lattice::hexagonal(10.0, 0.003, 1.0004, [102.3, 71.1]).points_within(Size::new(400, 300), 0.0).centres;
        let surface = Cubic::new(&centres, Size::new(400, 300), Size::new(132, 99)).unwrap();
        let f = |x: f64, y: f64| 0.3 + 0.002 * x - 0.001 * y;
        let values =
            Array2::from_shape_fn((centres.len(), 2), |(k, c)| (f(centres[k][0], centres[k][1]) + c as f64) as f32);
        let view = surface.apply(values.view()).unwrap();
        for t in 4..95 {
            for s in 4..128 {
                let (x, y) = ((s as f64 + 0.5) * 400.0 / 132.0 - 0.5, (t as f64 + 0.5) * 300.0 / 99.0 - 0.5);
                assert!((f64::from(view[[t, s, 0]]) - f(x, y)).abs() < 1e-4);
                assert!((view[[t, s, 1]] - view[[t, s, 0]] - 1.0).abs() < 1e-4);
            }
        }
        // A target on whose pixels the lattice points lie: the surface passes through the samples.
        let grid: Vec<[f64; 2]> =
            (0..30).flat_map(|j| (0..30).map(move |i| [f64::from(i * 4 + 2 * (j % 2)), f64::from(j) * 3.0])).collect();
        let surface = Cubic::new(&grid, Size::new(120, 90), Size::new(120, 90)).unwrap();
        let values = Array2::from_shape_fn((grid.len(), 3), |(k, c)| ((k * 7919 + c * 31) % 101) as f32 / 100.0);
        let view = surface.apply(values.view()).unwrap();
        for (k, g) in grid.iter().enumerate() {
            for c in 0..3 {
                assert!((view[[g[1] as usize, g[0] as usize, c]] - values[[k, c]]).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn spacing_is_the_pitch_of_a_hexagonal_lattice_as_dense() {
        // Four points on 12 square pixels; a hexagonal cell of 3 has the pitch √(3·2/√3).
        let found = spacing(&[[1.0, 2.0], [5.0, 2.0], [1.0, 5.0], [5.0, 5.0]]);
        assert!((found - 1.861_209_718_2).abs() < 1e-9, "{found}");
    }

    #[test]
    fn along_an_edge_cubics_are_met() {
        let f = |x: f64, y: f64| 0.4 + x - 0.5 * y + 0.3 * x * x * y - 0.2 * y * y * y + 0.1 * x * x;
        let slope = |x: f64, y: f64| [1.0 + 0.6 * x * y + 0.2 * x, -0.5 + 0.3 * x * x - 0.6 * y * y];
        let p = [[0.7, -0.4], [2.9, 1.3], [2.9, 1.3]];
        for k in 0..=10 {
            let part = f64::from(k) / 10.0;
            let form = along(p, part);
            let found: f64 = (0..3)
                .map(|n| {
                    let [gx, gy] = slope(p[n][0], p[n][1]);
                    form[n] * f(p[n][0], p[n][1]) + form[3 + n] * gx + form[6 + n] * gy
                })
                .sum();
            let truth = f(p[0][0] + part * (p[1][0] - p[0][0]), p[0][1] + part * (p[1][1] - p[0][1]));
            assert!((found - truth).abs() < 1e-12, "{part}: {found} against {truth}");
        }
    }
}
