//! The prior: differences of neighbouring pixels, Σ a (I_1 − I_2)², with weights that fall where the picture has an edge.

/// Weights of the differences to the right (`right`) and below (`below`) every pixel of a grid; 0 at its end.
#[derive(Debug, Clone)]
pub struct EdgeWeights {
    pub(super) width: usize,
    pub(super) right: Vec<f32>,
    pub(super) below: Vec<f32>,
}

impl EdgeWeights {
    /// From the guide: `weight(difference, pixel, neighbour)` for every pair of neighbours.
    pub(super) fn of_guide(guide: &[f32], width: usize, weight: impl Fn(f32, usize, usize) -> f32) -> Self {
        let height = guide.len() / width.max(1);
        let (mut right, mut below) = (vec![0f32; guide.len()], vec![0f32; guide.len()]);
        for t in 0..height {
            for s in 0..width {
                let k = t * width + s;
                if s + 1 < width {
                    right[k] = weight(guide[k + 1] - guide[k], k, k + 1);
                }
                if t + 1 < height {
                    below[k] = weight(guide[k + width] - guide[k], k, k + width);
                }
            }
        }
        EdgeWeights { width, right, below }
    }

    /// Adds Gᵀ A G `x` to `out`.
    #[inline(always)]
    pub(super) fn add_product(&self, x: &[f32], out: &mut [f32]) {
        let w = self.width;
        let h = x.len() / w.max(1);
        for t in 0..h {
            let row = t * w..(t + 1) * w;
            let (x0, a) = (&x[row.clone()], &self.right[row.clone()]);
            let out0 = &mut out[row.clone()];
            for s in 1..w {
                let flow = a[s - 1] * (x0[s - 1] - x0[s]);
                out0[s - 1] += flow;
                out0[s] -= flow;
            }
            if t + 1 < h {
                let (upper, lower) = out.split_at_mut((t + 1) * w);
                let (upper, lower) = (&mut upper[row.clone()], &mut lower[..w]);
                let (x1, b) = (&x[(t + 1) * w..(t + 2) * w], &self.below[row]);
                for s in 0..w {
                    let flow = b[s] * (x0[s] - x1[s]);
                    upper[s] += flow;
                    lower[s] -= flow;
                }
            }
        }
    }

    /// Adds the diagonal of Gᵀ A G to `out`.
    pub(super) fn add_diagonal(&self, out: &mut [f32]) {
        let w = self.width;
        for k in 0..out.len() {
            let (a, b) = (self.right[k], self.below[k]);
            out[k] += a + b;
            if k + 1 < out.len() {
                out[k + 1] += a;
            }
            if k + w < out.len() {
                out[k + w] += b;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_product_is_the_gradient_of_the_sum_of_squares() {
        let (w, h) = (7, 5);
        let x: Vec<f32> = (0..w * h).map(|k| ((k * 29) % 13) as f32 / 13.0).collect();
        let weights = EdgeWeights::of_guide(&x, w, |d, a, b| 1.0 + d.abs() + (a + b) as f32 * 0.01);
        let sum = |x: &[f32]| -> f64 {
            let mut total = 0.0;
            for t in 0..h {
                for s in 0..w {
                    let k = t * w + s;
                    if s + 1 < w {
                        total += f64::from(weights.right[k]) * f64::from(x[k + 1] - x[k]).powi(2);
                    }
                    if t + 1 < h {
                        total += f64::from(weights.below[k]) * f64::from(x[k + w] - x[k]).powi(2);
                    }
                }
            }
            total
        };
        let mut product = vec![0f32; w * h];
        weights.add_product(&x, &mut product);
        let quadratic: f64 = product.iter().zip(&x).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
        assert!((quadratic / sum(&x) - 1.0).abs() < 1e-5);
        let mut diagonal = vec![0f32; w * h];
        weights.add_diagonal(&mut diagonal);
        for k in [0, 3, w, 2 * w + 6, w * h - 1] {
            let mut unit = vec![0f32; w * h];
            unit[k] = 1.0;
            assert!((f64::from(diagonal[k]) - sum(&unit)).abs() < 1e-5, "pixel {k}");
        }
    }
}
