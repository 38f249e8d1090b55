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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_place_of_the_tile_has_the_mean_one() {
        // Odd sides: the last column counts for no mean, but is scaled too.
        let (width, height) = (5, 3);
        let level = [[0.5f32, 2.0], [0.0, 4.0]];
        let data = (0..width * height).map(|k| level[(k / width) & 1][(k % width) & 1]).collect();
        let mut image = SensorImage { width, height, data, limit: [1.0, 3.0, 5.0, 7.0] };
        image.data[4] = 9.0;
        let gains = equalise_channels(&mut image);
        assert_eq!(gains, [2.0, 0.5, 1.0, 0.25]);
        assert_eq!(image.limit, [2.0, 1.5, 5.0, 1.75]);
        assert_eq!(image.data, [1.0, 1.0, 1.0, 1.0, 18.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
    }
}
