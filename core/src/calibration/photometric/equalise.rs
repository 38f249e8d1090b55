//! Algorithm 1, "demosaicking" and "grayscale conversion": a white scene is the same in every channel, so scaling the
//! channels to one mean gives red = green = blue at every pixel, and the grey image is the scaled mosaic itself.
//! Nothing is interpolated.

use rayon::prelude::*;

use crate::calibration::sensor_image::SensorImage;

/// Scales the four places of the 2×2 tile so that the mean of each is 1; returns the gains used (1 for a place without
/// light).
pub fn equalise_channels(image: &mut SensorImage) -> [f32; 4] {
    let width = image.width;
    let rows: Vec<[f64; 2]> = image
        .data
        .par_chunks(width)
        .map(|row| {
            let mut sums = [0f64; 2];
            for pair in row.chunks_exact(2) {
                sums[0] += f64::from(pair[0]);
                sums[1] += f64::from(pair[1]);
            }
            sums
        })
        .collect();
    let mut sums = [0f64; 4];
    for (y, row) in rows.iter().enumerate() {
        sums[(y & 1) * 2] += row[0];
        sums[(y & 1) * 2 + 1] += row[1];
    }
    let pairs = (width / 2) as f64;
    let lines = [image.height.div_ceil(2) as f64, (image.height / 2) as f64];
    let gains = [0, 1, 2, 3].map(|k| {
        let mean = sums[k] / (pairs * lines[k >> 1]);
        if mean > 1e-6 { (1.0 / mean) as f32 } else { 1.0 }
    });
    image.scale(gains);
    gains
}
