//! How much light each view holds: the corner views of many cameras are dark or black, and absent views are black.

use lenslet_core::colour::srgb_decode;
use ndarray::{ArrayView3, ArrayView5, s};
use rayon::prelude::*;

/// Least share of the middle view's light with which a view is used at all.
///
/// Source: chosen; darker corner views are cut by the aperture, so that part of them is black.
const LEAST: f32 = 0.6;

/// Least weight that a light field states for a view that is used.
///
/// Source: chosen; below it views lie at the border of their micro-images.
const LEAST_STATED: f32 = 0.3;

/// Difference of light up to which views are taken as they are.
///
/// Source: chosen; views of an even exposure differ by what parallax brings in and takes out at the borders.
const EVEN: f32 = 0.05;

/// Blocks a side over which light is compared.
///
/// Source: chosen.
const BLOCKS: usize = 12;

/// The light of every view, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewLight {
    /// Weight, 0 (dark or absent: not used) to 1.
    pub weights: Vec<f32>,
    /// Factor on linear light that makes a view as bright as the others; 1 for those that are even or not used.
    pub gains: Vec<f32>,
}

impl ViewLight {
    /// Every view in full light.
    #[must_use]
    pub fn even(views: usize) -> Self {
        ViewLight { weights: vec![1.0; views], gains: vec![1.0; views] }
    }

    /// Measured on the light field `data` (v, u, t, s, c), in linear light or else sRGB-encoded; `stated`: weights that
    /// the light field itself gives.
    ///
    /// ```
    /// use lenslet_views::disparity::ViewLight;
    /// use ndarray::Array5;
    ///
    /// // The last of nine views is black, and the first one has three quarters of the light.
    /// let light = [0.75, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0];
    /// let field = Array5::from_shape_fn((3, 3, 24, 24, 1), |(v, u, t, s, _)| light[3 * v + u] * (0.2 + 0.01 * (t + s) as f32));
    /// let found = ViewLight::of(&field.view(), true, None);
    /// assert_eq!((found.weights[8], found.weights[4]), (0.0, 1.0));
    /// assert!((found.gains[0] - 4.0 / 3.0).abs() < 1e-3 && found.weights[0] < 0.8);
    /// ```
    #[must_use]
    pub fn of(data: &ArrayView5<f32>, linear: bool, stated: Option<&[f32]>) -> Self {
        let (rows, columns, ..) = data.dim();
        let n = rows * columns;
        let blocks: Vec<Vec<f32>> = (0..n)
            .into_par_iter()
            .map(|k| block_means(&data.slice(s![k / columns, k % columns, .., .., ..]), linear))
            .collect();
        let total = |k: usize| blocks[k].iter().sum::<f32>();
        let mut totals: Vec<f32> = (0..n).map(total).collect();
        totals.sort_unstable_by(f32::total_cmp);
        let middle = (rows / 2) * columns + columns / 2;
        // A middle view that is itself dark is no measure.
        let bright = totals[(3 * n / 4).min(n - 1)];
        let reference =
            if total(middle) >= LEAST * bright { Some(middle) } else { (0..n).find(|&k| total(k) >= bright) };
        let Some(reference) = reference.filter(|&k| total(k) > 0.0) else { return ViewLight::even(n) };
        let mut out = ViewLight::even(n);
        for k in 0..n {
            let light = relative_light(&blocks[k], &blocks[reference]);
            let stated = stated.and_then(|w| w.get(k)).copied().unwrap_or(1.0);
            if light < LEAST || stated < LEAST_STATED {
                out.weights[k] = 0.0;
            } else if (light - 1.0).abs() > EVEN {
                out.gains[k] = 1.0 / light;
                // Noise grows as light falls.
                out.weights[k] = (light * light).min(1.0);
            }
        }
        out
    }

    /// How many views are not used.
    #[must_use]
    pub fn unused(&self) -> usize {
        self.weights.iter().filter(|w| **w <= 0.0).count()
    }
}

/// Mean light of blocks of a view; what is not finite counts as black.
fn block_means(view: &ArrayView3<f32>, linear: bool) -> Vec<f32> {
    let (height, width, channels) = view.dim();
    let (rows, columns) = (height.min(BLOCKS), width.min(BLOCKS));
    let mut sums = vec![[0f64; 2]; rows * columns];
    // Every fourth pixel of large views is enough.
    let step = 1 + height.min(width) / 256;
    for t in (0..height).step_by(step) {
        for s in (0..width).step_by(step) {
            let cell = &mut sums[t * rows / height * columns + s * columns / width];
            for c in 0..channels {
                let x = view[[t, s, c]];
                let x = if x.is_finite() { x.max(0.0) } else { 0.0 };
                cell[0] += f64::from(if linear { x } else { srgb_decode(x) });
            }
            cell[1] += channels as f64;
        }
    }
    sums.into_iter().map(|[sum, count]| (sum / count.max(1.0)) as f32).collect()
}

/// Median over the blocks of their light relative to those of the reference, which parallax changes little.
fn relative_light(own: &[f32], reference: &[f32]) -> f32 {
    let bright = reference.iter().copied().fold(0.0, f32::max);
    let mut ratios: Vec<f32> =
        own.iter().zip(reference).filter(|(_, r)| **r > 0.02 * bright).map(|(o, r)| o / r).collect();
    ratios.sort_unstable_by(f32::total_cmp);
    ratios.get(ratios.len() / 2).copied().unwrap_or(1.0)
}

#[cfg(test)]
mod tests {
    use ndarray::Array5;

    use super::*;

    fn field(light: impl Fn(usize, usize) -> f32) -> Array5<f32> {
        Array5::from_shape_fn((5, 5, 60, 70, 3), |(v, u, t, s, c)| {
            let (x, y) = (s as f32 - 1.3 * u as f32, t as f32 - 1.3 * v as f32);
            light(v, u) * (0.4 + 0.2 * (0.3 * x).sin() * (0.2 * y).cos() + 0.05 * c as f32)
        })
    }

    #[test]
    fn parallax_is_no_darkness() {
        assert_eq!(ViewLight::of(&field(|_, _| 1.0).view(), true, None), ViewLight::even(25));
        assert_eq!(ViewLight::of(&field(|_, _| 0.0).view(), true, None), ViewLight::even(25), "nothing to see at all");
    }

    #[test]
    fn dark_views_are_not_used_and_dim_ones_are_evened_out() {
        let corner = |v: usize, u: usize| (v == 0 || v == 4) && (u == 0 || u == 4);
        for dark in [0.0, 0.3, 0.5] {
            let found = ViewLight::of(&field(|v, u| if corner(v, u) { dark } else { 1.0 }).view(), true, None);
            assert_eq!(found.unused(), 4, "{dark}");
        }
        let found = ViewLight::of(&field(|v, u| if corner(v, u) { 0.8 } else { 1.0 }).view(), true, None);
        assert!(found.unused() == 0 && (found.gains[0] - 1.25).abs() < 0.02, "{}", found.gains[0]);
        let mut stated = vec![1.0; 25];
        stated[7] = 0.0;
        assert_eq!(ViewLight::of(&field(|_, _| 1.0).view(), true, Some(&stated)).weights[7], 0.0);
    }
}
