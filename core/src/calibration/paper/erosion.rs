//! Algorithm 1, "erode rotated image" (figure 6a): each pixel becomes the minimum over a disc around it, which leaves
//! one sharp maximum a lenslet.

use rayon::prelude::*;

use crate::calibration::sensor_image::SensorImage;

/// Erodes by a disc of `radius` pixels; pixels beyond the border are ignored.
pub fn erode_by_disc(image: &SensorImage, radius: f64) -> SensorImage {
    let (width, height) = (image.width, image.height);
    let reach = radius.max(0.0) as usize;
    // Half-widths of the disc's rows; rows of equal half-width share one horizontal pass.
    let halves: Vec<usize> =
        (0..=reach).map(|dy| (radius * radius - (dy * dy) as f64).max(0.0).sqrt() as usize).collect();
    let mut data = vec![f32::INFINITY; width * height];
    let mut done: Vec<usize> = halves.clone();
    done.sort_unstable();
    done.dedup();
    for half in done {
        let narrow = row_minimum(image, half);
        data.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (dy, _) in halves.iter().enumerate().filter(|(_, h)| **h == half) {
                let above = y.checked_sub(dy);
                let below = (dy > 0 && y + dy < height).then_some(y + dy);
                for source in [above, below].into_iter().flatten() {
                    for (out, &v) in row.iter_mut().zip(&narrow[source * width..(source + 1) * width]) {
                        *out = out.min(v);
                    }
                }
            }
        });
    }
    SensorImage { width, height, data, limit: image.limit }
}

/// Minimum over `half` pixels to either side, in each row.
fn row_minimum(image: &SensorImage, half: usize) -> Vec<f32> {
    let width = image.width;
    let mut out = image.data.clone();
    out.par_chunks_mut(width).zip(image.data.par_chunks(width)).for_each(|(out, row)| {
        for shift in 1..=half.min(width - 1) {
            for (o, &v) in out.iter_mut().zip(&row[shift..]) {
                *o = o.min(v);
            }
            for (o, &v) in out[shift..].iter_mut().zip(row) {
                *o = o.min(v);
            }
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The definition, written out.
    fn slow(image: &SensorImage, radius: f64) -> Vec<f32> {
        let (w, h, r) = (image.width as i64, image.height as i64, radius as i64);
        (0..w * h)
            .map(|k| {
                let (x, y) = (k % w, k / w);
                let mut least = f32::INFINITY;
                for dy in -r..=r {
                    for dx in -r..=r {
                        let inside = (dx * dx + dy * dy) as f64 <= radius * radius;
                        if inside && x + dx >= 0 && x + dx < w && y + dy >= 0 && y + dy < h {
                            least = least.min(image.at((x + dx) as usize, (y + dy) as usize));
                        }
                    }
                }
                least
            })
            .collect()
    }

    proptest! {
        #[test]
        fn fast_is_the_definition(w in 1usize..14, h in 1usize..14, radius in 0.0f64..5.0, seed in 0u32..1000) {
            let data = (0..w * h).map(|k| ((k as u32).wrapping_mul(2_654_435_761).wrapping_add(seed * 977) >> 20) as f32).collect();
            let image = SensorImage { width: w, height: h, data, limit: [f32::MAX; 4] };
            prop_assert_eq!(erode_by_disc(&image, radius).data, slow(&image, radius));
        }
    }
}
