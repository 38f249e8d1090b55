//! Section 4.1, the paper's baseline: a regular grid of about one value a pitch first, then bicubic to the target.

use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::Size;
use lenslet_core::sampling::{Weights, bicubic};
use ndarray::{Array3, ArrayView2};

use super::interpolator::ViewInterpolator;
use crate::Error;
use crate::target::native_size;

/// The low-resolution grid's table, and the size of the result.
#[derive(Debug, Clone)]
pub struct Bicubic {
    low: Weights,
    target: Size,
}

impl Bicubic {
    /// The table of the low-resolution grid for the centres of `samples`.
    ///
    /// # Errors
    /// Centres that cannot be triangulated.
    pub fn prepare(samples: &HexSamples, target: &Size) -> Result<Self, Error> {
        let low = native_size(samples);
        let low = Weights::new(&samples.centres, samples.sensor, low)?;
        Ok(Bicubic { low, target: *target })
    }
}

impl ViewInterpolator for Bicubic {
    fn interpolate_view(&self, values: ArrayView2<'_, f32>) -> Result<Array3<f32>, Error> {
        let low = self.low.apply(values)?;
        Ok(bicubic::resize_bicubic(low.view(), self.target)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 7×7 lenslets, each in the middle of a pixel of the low grid.
    fn samples(value: impl Fn(usize, usize) -> f32) -> HexSamples {
        let place = |k: usize| (k as f64 + 0.5) * 100.0 / 7.0 - 0.5;
        HexSamples {
            sensor: Size::new(100, 100),
            index: (0..49).map(|k| [k % 7, k / 7]).collect(),
            centres: (0..49).map(|k| [place(k % 7), place(k / 7)]).collect(),
            views: 1,
            view_step: 1.0,
            weights: vec![1.0],
            values: Array3::from_shape_fn((1, 49, 1), |(_, k, _)| value(k % 7, k / 7)),
        }
    }

    fn enlarged(samples: &HexSamples) -> Array3<f32> {
        let size = native_size(samples);
        assert_eq!((size.width, size.height), (7, 7));
        let table = Bicubic::prepare(samples, &Size { width: 14, height: 14 }).unwrap();
        table.interpolate_view(samples.values.index_axis(ndarray::Axis(0), 0)).unwrap()
    }

    #[test]
    fn one_bright_lenslet_becomes_keys_kernel() {
        let view = enlarged(&samples(|i, j| f32::from(u8::from((i, j) == (3, 3)))));
        // Keys with a = −½ at 1.75, 1.25, 0.75, 0.25 low pixels and back.
        let half = [-0.023_437_5, -0.070_312_5, 0.226_562_5, 0.867_187_5];
        let kernel: Vec<f32> = half.into_iter().chain(half.into_iter().rev()).collect();
        for t in 0..14 {
            for s in 0..14 {
                let at = |k: usize| k.checked_sub(3).and_then(|k| kernel.get(k)).copied().unwrap_or(0.0);
                let expected = at(s) * at(t);
                assert!((view[[t, s, 0]] - expected).abs() < 1e-5, "({s}, {t}): {} {expected}", view[[t, s, 0]]);
            }
        }
    }

    #[test]
    fn a_plane_and_a_parabola_come_back_inside() {
        let low = |k: usize| (k as f64 + 0.5) / 2.0 - 0.5;
        let plane = enlarged(&samples(|i, j| 0.1 * i as f32 - 0.05 * j as f32 + 0.3));
        let parabola = enlarged(&samples(|i, _| 0.02 * (i * i) as f32));
        for t in 3..11 {
            for s in 3..11 {
                let expected = 0.1 * low(s) - 0.05 * low(t) + 0.3;
                assert!((f64::from(plane[[t, s, 0]]) - expected).abs() < 1e-5);
                assert!((f64::from(parabola[[t, s, 0]]) - 0.02 * low(s) * low(s)).abs() < 1e-5);
            }
        }
    }
}
