//! Gaussian smoothing of planes and lists; the pixels at the ends repeat.

use crate::geometry::Size;
use rayon::prelude::*;

/// A Gaussian cut off at some distance, its weights summing to 1.
///
/// ```
/// use lenslet_core::image::GaussianFilter;
/// let mut line = vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
/// GaussianFilter::new(1.0, 4.0).smooth_line(&mut line);
/// assert!((line[3] - 0.3989).abs() < 1e-3 && line[2] == line[4]);
/// ```
#[derive(Debug, Clone)]
pub struct GaussianFilter {
    /// Weights at 0, 1, 2 … steps.
    taps: Vec<f32>,
}

impl GaussianFilter {
    /// A Gaussian of standard deviation `sigma` (above 0), pixels, cut off at `reach` standard deviations, rounded up.
    #[must_use]
    pub fn new(sigma: f32, reach: f32) -> Self {
        let radius = (reach * sigma).ceil() as usize;
        let mut taps: Vec<f32> = (0..=radius).map(|k| (-(k as f32 / sigma).powi(2) / 2.0).exp()).collect();
        let sum = taps[0] + 2.0 * taps[1..].iter().sum::<f32>();
        taps.iter_mut().for_each(|t| *t /= sum);
        GaussianFilter { taps }
    }

    /// Smooths `width`×`height` values, row after row, in place: along the rows, then along the columns.
    pub fn smooth(&self, data: &mut [f32], size: Size) {
        let Size { width, height } = size;
        if width == 0 || height == 0 {
            return;
        }
        data.par_chunks_exact_mut(width).for_each(|row| self.smooth_line(row));
        let before = data.to_vec();
        data.par_chunks_exact_mut(width).enumerate().for_each(|(t, row)| {
            for (s, o) in row.iter_mut().enumerate() {
                *o = self.mean_at(t, height, |k| before[k * width + s]);
            }
        });
    }

    /// Smooths a list in place.
    pub fn smooth_line(&self, line: &mut [f32]) {
        let before = line.to_vec();
        for (k, o) in line.iter_mut().enumerate() {
            *o = self.mean_at(k, before.len(), |k| before[k]);
        }
    }

    #[inline]
    fn mean_at(&self, at: usize, length: usize, value: impl Fn(usize) -> f32) -> f32 {
        let mut sum = self.taps[0] * value(at);
        for (d, tap) in self.taps.iter().enumerate().skip(1) {
            sum += tap * (value(at.saturating_sub(d)) + value((at + d).min(length - 1)));
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smoothing_keeps_planes_and_has_the_variance_it_is_asked_for() {
        let data: Vec<f32> = (0..40 * 30).map(|k| 0.02 * (k % 40) as f32 + 0.01 * (k / 40) as f32).collect();
        let mut smooth = data.clone();
        GaussianFilter::new(1.6, 4.0).smooth(&mut smooth, Size::new(40, 30));
        assert!((smooth[15 * 40 + 20] - data[15 * 40 + 20]).abs() < 1e-5);
        assert!((smooth[0] - data[0]).abs() > 1e-3);
        let mut point = vec![0f32; 41 * 41];
        point[20 * 41 + 20] = 1.0;
        GaussianFilter::new(2.5, 4.0).smooth(&mut point, Size::new(41, 41));
        let moment = |along: fn(usize) -> usize| {
            point.iter().enumerate().map(|(k, p)| p * (along(k) as f32 - 20.0).powi(2)).sum::<f32>()
        };
        assert!((moment(|k| k % 41) - 6.25).abs() < 0.02 && (moment(|k| k / 41) - 6.25).abs() < 0.02);
    }
}
