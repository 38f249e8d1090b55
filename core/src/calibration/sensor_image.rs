//! One grey value per pixel, and the saturation limits: the image that the steps of Algorithm 1 work on.

/// A grey image of the sensor. Light is linear unless a step says otherwise; 1 is full scale, or the mean once
/// equalised.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorImage {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width·height` values, row-major.
    pub data: Vec<f32>,
    /// Pixels at or above this are saturated; one limit for each place of the 2×2 tile, `(y&1)·2 + (x&1)`.
    pub limit: [f32; 4],
}

impl SensorImage {
    /// One row.
    #[inline]
    pub fn row(&self, y: usize) -> &[f32] {
        &self.data[y * self.width..(y + 1) * self.width]
    }

    /// Value at a pixel.
    #[inline]
    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.data[y * self.width + x]
    }

    /// Multiplies each place of the 2×2 tile by its gain, limits too.
    pub fn scale(&mut self, gains: [f32; 4]) {
        use rayon::prelude::*;
        let width = self.width;
        self.data.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let (even, odd) = (gains[(y & 1) * 2], gains[(y & 1) * 2 + 1]);
            for (x, v) in row.iter_mut().enumerate() {
                *v *= if x & 1 == 0 { even } else { odd };
            }
        });
        for (limit, gain) in self.limit.iter_mut().zip(gains) {
            *limit *= gain;
        }
    }
}
