//! The guided filter (He, Sun and Tang 2013): in every box the values are a linear function a·I + b of the guide I, with
//! a = cov(I, p) / (var(I) + ε) and b = mean(p) − a·mean(I); a pixel gets the mean over the boxes that hold it.

use crate::geometry::Size;
use ndarray::Array2;

use super::box_mean::{box_mean, box_mean_in_bands};

/// How the means over boxes are made; the rounding of the two differs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BoxMeans {
    /// [`box_mean`], on the calling thread: for many pictures side by side.
    OneThread,
    /// [`box_mean_in_bands`], on all threads: for one large picture.
    AllThreads,
}

/// A guide image made ready: any number of pictures of its size can be filtered by it.
///
/// ```
/// use lenslet_core::image::{BoxMeans, GuidedFilter};
/// use lenslet_core::geometry::Size;
///
/// // Noise around 0 and 1, guided by a clean step: the step stays, the noise goes.
/// let guide: Vec<f32> = (0..8).map(|x| if x < 4 { 0.0 } else { 1.0 }).collect();
/// let mut values = vec![0.1, -0.1, 0.1, -0.1, 0.9, 1.1, 0.9, 1.1];
/// GuidedFilter::new(&guide, Size::new(8, 1), 2, 1e-4, BoxMeans::OneThread).filter(&mut values);
/// assert!(values[..4].iter().all(|v| v.abs() < 0.06) && values[4..].iter().all(|v| (v - 1.0).abs() < 0.06));
/// ```
#[derive(Debug, Clone)]
pub struct GuidedFilter<'a> {
    guide: &'a [f32],
    width: usize,
    height: usize,
    radius: usize,
    means: BoxMeans,
    mean: Vec<f32>,
    /// 1 / (variance + ε).
    inverse: Vec<f32>,
}

impl<'a> GuidedFilter<'a> {
    /// A guide of `width`×`height` values, rows one after the other; boxes of 2·`radius` + 1 pixels a side, cut at the
    /// frame. Where the variance of the guide in a box is well below `epsilon`, the result is the mean of the box.
    ///
    /// # Panics
    /// When the guide has another number of values.
    #[must_use]
    pub fn new(guide: &'a [f32], size: Size, radius: usize, epsilon: f32, means: BoxMeans) -> Self {
        let Size { width, height } = size;
        assert_eq!(guide.len(), width * height, "the guide has another size");
        let mut filter = GuidedFilter { guide, width, height, radius, means, mean: Vec::new(), inverse: Vec::new() };
        let (mut mean, mut square) = (Vec::new(), Vec::new());
        filter.box_means(guide, &mut mean);
        let squares: Vec<f32> = guide.iter().map(|v| v * v).collect();
        filter.box_means(&squares, &mut square);
        filter.inverse = square.iter().zip(&mean).map(|(q, m)| 1.0 / ((q - m * m).max(0.0) + epsilon)).collect();
        filter.mean = mean;
        filter
    }

    /// Filters `values` in place.
    ///
    /// # Panics
    /// When there is another number of values than the guide has.
    pub fn filter(&self, values: &mut [f32]) {
        assert_eq!(values.len(), self.guide.len(), "the values have another size than their guide");
        let (mut mean, mut cross) = (Vec::new(), Vec::new());
        self.box_means(values, &mut mean);
        let product: Vec<f32> = values.iter().zip(self.guide).map(|(a, b)| a * b).collect();
        self.box_means(&product, &mut cross);
        let (mut slope, mut offset) = (product, Vec::with_capacity(values.len()));
        for k in 0..values.len() {
            slope[k] = (cross[k] - mean[k] * self.mean[k]) * self.inverse[k];
            offset.push(mean[k] - slope[k] * self.mean[k]);
        }
        self.box_means(&slope, &mut mean);
        self.box_means(&offset, &mut cross);
        for (k, v) in values.iter_mut().enumerate() {
            *v = mean[k] * self.guide[k] + cross[k];
        }
    }

    fn box_means(&self, values: &[f32], out: &mut Vec<f32>) {
        match self.means {
            BoxMeans::OneThread => box_mean(values, Size::new(self.width, self.height), self.radius, out),
            BoxMeans::AllThreads => {
                let plane = Array2::from_shape_fn((self.height, self.width), |(t, s)| values[t * self.width + s]);
                *out = box_mean_in_bands(plane, self.radius).into_raw_vec_and_offset().0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition, box by box.
    fn by_definition(guide: &[f32], values: &[f32], w: usize, h: usize, r: usize, epsilon: f64) -> Vec<f64> {
        let boxed = |t: usize, s: usize| {
            let rows = t.saturating_sub(r)..=(t + r).min(h - 1);
            rows.flat_map(move |y| (s.saturating_sub(r)..=(s + r).min(w - 1)).map(move |x| y * w + x))
        };
        let mut lines = Vec::new();
        for k in 0..w * h {
            let cells: Vec<usize> = boxed(k / w, k % w).collect();
            let mean = |f: &dyn Fn(usize) -> f64| cells.iter().map(|&c| f(c)).sum::<f64>() / cells.len() as f64;
            let (i, p) = (|c: usize| f64::from(guide[c]), |c: usize| f64::from(values[c]));
            let (mi, mp) = (mean(&i), mean(&p));
            let a = (mean(&|c| i(c) * p(c)) - mi * mp) / (mean(&|c| i(c) * i(c)) - mi * mi + epsilon);
            lines.push((a, mp - a * mi));
        }
        (0..w * h)
            .map(|k| {
                let cells: Vec<usize> = boxed(k / w, k % w).collect();
                let n = cells.len() as f64;
                let (a, b) = cells.iter().fold((0.0, 0.0), |sum, &c| (sum.0 + lines[c].0, sum.1 + lines[c].1));
                a / n * f64::from(guide[k]) + b / n
            })
            .collect()
    }

    #[test]
    fn both_kinds_of_means_give_the_definition() {
        let (w, h, r) = (17, 80, 3);
        let guide: Vec<f32> = (0..w * h).map(|k| ((k * 7919) % 101) as f32 / 101.0).collect();
        let values: Vec<f32> = (0..w * h).map(|k| ((k * 104_729) % 97) as f32 / 97.0).collect();
        let wanted = by_definition(&guide, &values, w, h, r, 0.01);
        for means in [BoxMeans::OneThread, BoxMeans::AllThreads] {
            let mut found = values.clone();
            GuidedFilter::new(&guide, Size::new(w, h), r, 0.01, means).filter(&mut found);
            let worst = found.iter().zip(&wanted).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-5, "{means:?}: {worst}");
        }
    }
}
