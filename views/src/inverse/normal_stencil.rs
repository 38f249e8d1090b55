//! Bᵀ W B of rows of few pixels: a symmetric matrix that couples each pixel with its neighbours, and Bᵀ W y.

use super::basis::{Basis, weights};
use super::forward::{Grid, Row};

/// Numbers a pixel while rows of `n`×`n` pixels are added: its couplings and three right-hand sides.
const fn lanes(n: usize) -> usize {
    n + (n - 1) * (2 * n - 1) + 3
}

/// Couplings of a pixel with itself and with those after it, as planes over the grid.
#[derive(Debug, Clone)]
pub struct NormalStencil {
    width: usize,
    /// (rows down, columns right) of the neighbour, and the coupling at every pixel; the first is the diagonal.
    couplings: Vec<([isize; 2], Vec<f32>)>,
}

/// Adds rows up.
pub(super) struct Accumulator {
    width: usize,
    basis: Basis,
    /// [`lanes`] of every pixel.
    sums: Vec<f32>,
}

/// Neighbours at or after a pixel that share a row of `n`×`n` pixels with it, in the order of the lanes.
fn neighbours(n: isize) -> Vec<[isize; 2]> {
    let mut all: Vec<[isize; 2]> = (0..n).map(|right| [0, right]).collect();
    for down in 1..n {
        all.extend((1 - n..n).map(|right| [down, right]));
    }
    all
}

impl Accumulator {
    pub(super) fn new(grid: &Grid) -> Self {
        Accumulator { width: grid.width, basis: grid.basis, sums: vec![0.0; grid.pixels() * lanes(grid.basis.taps())] }
    }

    /// Adds one row of `N`×`N` pixels with its `weight` and value.
    #[inline(always)]
    pub(super) fn add<const N: usize>(&mut self, row: &Row, weight: f32, value: &[f32; 4]) {
        let (bx, by) = (weights::<N>(row.fx), weights::<N>(row.fy));
        let right_hand = const { lanes(N) - 3 };
        for j in 0..N {
            let at = (row.cell as usize + j * self.width) * const { lanes(N) };
            let pixels = &mut self.sums[at..at + const { N * lanes(N) }];
            for (i, sums) in pixels.chunks_exact_mut(const { lanes(N) }).enumerate() {
                let b = weight * bx[i] * by[j];
                if N == 2 {
                    // All eight lanes at once; those of pixels that do not share the row add nothing.
                    let mut lane = [0f32; lanes(2)];
                    for right in 0..2 - i {
                        lane[right] = by[j] * bx[i + right];
                    }
                    if j == 0 {
                        lane[3 - i] = by[1] * bx[0];
                        lane[4 - i] = by[1] * bx[1];
                    }
                    lane[5..].copy_from_slice(&value[..3]);
                    for (sum, lane) in sums.iter_mut().zip(&lane) {
                        *sum += b * lane;
                    }
                    continue;
                }
                // To the right in the same line.
                for (right, other) in bx[i..].iter().enumerate() {
                    sums[right] += b * by[j] * other;
                }
                // In the lines below.
                for down in 1..N - j {
                    let line = N + (down - 1) * (2 * N - 1) + N - 1 - i;
                    for (k, other) in bx.iter().enumerate() {
                        sums[line + k] += b * by[j + down] * other;
                    }
                }
                for (sum, v) in sums[right_hand..right_hand + 3].iter_mut().zip(value) {
                    *sum += b * v;
                }
            }
        }
    }

    /// The matrix, and Bᵀ W y of `channels` channels.
    pub(super) fn finish(self, channels: usize) -> (NormalStencil, Vec<Vec<f32>>) {
        let each = lanes(self.basis.taps());
        let neighbours = neighbours(self.basis.taps() as isize);
        let mut planes = vec![vec![0f32; self.sums.len() / each]; neighbours.len() + channels];
        for (k, sums) in self.sums.chunks_exact(each).enumerate() {
            for (plane, sum) in planes.iter_mut().zip(sums) {
                plane[k] = *sum;
            }
        }
        let right = planes.split_off(neighbours.len());
        (NormalStencil { width: self.width, couplings: neighbours.into_iter().zip(planes).collect() }, right)
    }
}

impl NormalStencil {
    /// The diagonal.
    pub(super) fn diagonal(&self) -> &[f32] {
        &self.couplings[0].1
    }

    /// `out` = Bᵀ W B `x`.
    #[inline(always)]
    pub(super) fn multiply(&self, x: &[f32], out: &mut [f32]) {
        let w = self.width;
        let h = x.len() / w.max(1);
        out.fill(0.0);
        for (t, out) in out.chunks_exact_mut(w).enumerate() {
            for ([down, right], plane) in &self.couplings {
                let (down, shift) = (*down as usize, right.unsigned_abs());
                if w <= shift {
                    continue;
                }
                // Columns of the pixel and of its neighbour.
                let (near, far) = if *right >= 0 { (0, shift) } else { (shift, 0) };
                let n = w - shift;
                if t + down < h {
                    let (a, b) = (t * w + near, (t + down) * w + far);
                    add_products(&mut out[near..near + n], &plane[a..a + n], &x[b..b + n]);
                }
                if (down, *right) != (0, 0) && t >= down {
                    let a = (t - down) * w + near;
                    add_products(&mut out[far..far + n], &plane[a..a + n], &x[a..a + n]);
                }
            }
        }
    }
}

#[inline(always)]
fn add_products(out: &mut [f32], a: &[f32], b: &[f32]) {
    for ((o, a), b) in out.iter_mut().zip(a).zip(b) {
        *o += a * b;
    }
}

#[cfg(test)]
mod tests {
    use super::super::forward::interleaved;
    use super::*;
    use lenslet_core::geometry::Size;

    fn the_stencil_is_the_product_of_its_rows<const N: usize>(basis: Basis) {
        let grid = Grid::around(Size::new(9, 7), 4, basis);
        let rows: Vec<Row> = (0..60)
            .filter_map(|k| {
                let (x, y) = ((k * 37 % 89) as f32 / 10.0, (k * 53 % 67) as f32 / 10.0);
                grid.row(x, y, 1.0, 0.5 + (k % 3) as f32, k)
            })
            .collect();
        assert!(rows.len() > 40);
        let picture: Vec<f32> = (0..grid.pixels()).map(|k| ((k * 31) % 17) as f32 / 17.0).collect();
        let mut sums = Accumulator::new(&grid);
        let mut expected = vec![0f32; grid.pixels()];
        for row in &rows {
            sums.add::<N>(row, row.weight, &[2.0, 0.0, 0.0, 0.0]);
            let value = row.weight * row.apply::<N>(&interleaved(std::slice::from_ref(&picture)), grid.width)[0];
            let (bx, by) = (weights::<N>(row.fx), weights::<N>(row.fy));
            for k in 0..N * N {
                expected[row.cell as usize + k / N * grid.width + k % N] += by[k / N] * bx[k % N] * value;
            }
        }
        let (stencil, right) = sums.finish(1);
        let mut product = vec![0f32; grid.pixels()];
        stencil.multiply(&picture, &mut product);
        for (a, b) in product.iter().zip(&expected) {
            assert!((a - b).abs() < 1e-5, "{a} {b}");
        }
        // B applied to ones is one: the right-hand side of constant samples is twice the product with ones.
        stencil.multiply(&vec![2.0; grid.pixels()], &mut product);
        for (a, b) in product.iter().zip(&right[0]) {
            assert!((a - b).abs() < 1e-5, "{a} {b}");
        }
    }

    #[test]
    fn stencils_are_the_products_of_their_rows() {
        the_stencil_is_the_product_of_its_rows::<2>(Basis::Linear);
        the_stencil_is_the_product_of_its_rows::<3>(Basis::Quadratic);
        the_stencil_is_the_product_of_its_rows::<4>(Basis::Cubic);
    }
}
