//! Hot pixels: bright without light, found in black images (captures with the lens covered). Each image votes for the
//! pixels that exceed its own noise; a pixel with more than half of the votes is hot. (Not part of Algorithm 1; a hot
//! pixel under a lenslet biases its centre.)

use rayon::prelude::*;

use crate::calibration::checks;
use crate::calibration::error::Error;
use crate::calibration::sensor_image::SensorImage;
use crate::container::Capture;

/// Threshold above the median of a black image, in robust standard deviations (1.4826 · median absolute deviation).
/// Source: chosen
const OUTLIER: f64 = 8.0;
/// Lower bound of that threshold, as a share of the range between black and white level.
/// Source: chosen
const LEAST: f64 = 0.01;
/// Median above the black level, as a share of the range, from which an image is not black.
/// Source: chosen
const LIGHT: f64 = 0.05;

/// At most one of this many pixels of a sensor may be hot.
/// Source: chosen
pub const PIXELS_PER_HOT_PIXEL: usize = 100;

/// Pixels (`y·width + x`, ascending) that are bright in more than half of the black images; none without images.
///
/// ```
/// use lenslet_core::calibration::find_hot_pixels;
/// use lenslet_core::container::{Capture, Cfa, Levels, RawMosaic};
///
/// let mut data: Vec<u16> = (0..96 * 80u32).map(|k| 166 + (k * 7919 % 5) as u16).collect(); // dark noise around 168
/// data[1234] = 400;
/// let levels = Levels { black: [168.0; 4], white: [4095.0; 4] };
/// let black = Capture::bare(RawMosaic { width: 96, height: 80, data }, Cfa::Bggr, levels);
/// assert_eq!(find_hot_pixels(&[black])?, [1234]);
/// # Ok::<(), lenslet_core::calibration::Error>(())
/// ```
///
/// # Errors
/// [`Error::SizesDiffer`], [`Error::CamerasDiffer`], [`Error::BadImage`]; [`Error::NotBlack`] for an image with light
/// on it, or when more than one pixel in a hundred is hot.
pub fn find_hot_pixels(blacks: &[Capture]) -> Result<Vec<u32>, Error> {
    if blacks.is_empty() {
        return Ok(Vec::new());
    }
    checks::check_same_camera(blacks)?;
    let width = blacks[0].mosaic.width;
    let mut votes = vec![0u8; blacks[0].mosaic.data.len()];
    // Votes are counted in a u8; 255 suffice.
    let voters = &blacks[..blacks.len().min(usize::from(u8::MAX))];
    for (n, black) in voters.iter().enumerate() {
        let limits = noise_limits(black).ok_or(Error::NotBlack { index: n + 1 })?;
        votes.par_chunks_mut(width).zip(black.mosaic.data.par_chunks(width)).enumerate().for_each(
            |(y, (votes, row))| {
                for (x, (vote, &dn)) in votes.iter_mut().zip(row).enumerate() {
                    *vote += u8::from(f64::from(dn) > limits[(y & 1) * 2 + (x & 1)]);
                }
            },
        );
    }
    let hot: Vec<u32> =
        votes.iter().enumerate().filter(|(_, v)| 2 * usize::from(**v) > voters.len()).map(|(k, _)| k as u32).collect();
    if hot.len() > votes.len() / PIXELS_PER_HOT_PIXEL {
        return Err(Error::NotBlack { index: 1 });
    }
    Ok(hot)
}

/// Largest digital number at each place of the 2×2 tile that is still noise; `None` for an image with light on it.
fn noise_limits(black: &Capture) -> Option<[f64; 4]> {
    let width = black.mosaic.width;
    let mut limits = [0f64; 4];
    for (k, limit) in limits.iter_mut().enumerate() {
        let mut counts = vec![0u64; 1 << 16];
        for row in black.mosaic.data.chunks(width).skip(k >> 1).step_by(2) {
            row.iter().skip(k & 1).step_by(2).for_each(|&v| counts[usize::from(v)] += 1);
        }
        let median = histogram_median(&counts);
        let mut off = vec![0u64; 1 << 16];
        for (v, &count) in counts.iter().enumerate() {
            off[v.abs_diff(median)] += count;
        }
        // Quantisation: the noise is at least half a step of the digital numbers.
        let noise = (1.4826 * histogram_median(&off) as f64).max(0.5);
        let channel = black.cfa.plane(k & 1, k >> 1);
        let (dark, white) = (f64::from(black.levels.black[channel]), f64::from(black.levels.white[channel]));
        if median as f64 > dark + LIGHT * (white - dark) {
            return None;
        }
        *limit = median as f64 + (OUTLIER * noise).max(LEAST * (white - dark));
    }
    Some(limits)
}

/// Median of numbers given as a histogram.
fn histogram_median(counts: &[u64]) -> usize {
    let half = counts.iter().sum::<u64>() / 2;
    let mut seen = 0;
    counts
        .iter()
        .position(|&c| {
            seen += c;
            seen > half
        })
        .unwrap_or(0)
}

/// Refuses a list of hot pixels that is not ascending, not on a sensor of `pixels` pixels, or too long.
pub fn check_hot_pixels(hot: &[u32], pixels: usize) -> Result<(), Error> {
    let ordered = hot.windows(2).all(|w| w[0] < w[1]);
    if ordered && hot.last().is_none_or(|&k| (k as usize) < pixels) && hot.len() <= pixels / PIXELS_PER_HOT_PIXEL {
        return Ok(());
    }
    Err(Error::Parameter("the hot pixels must be ascending, on the sensor, and at most one in a hundred".into()))
}

/// Replaces each hot pixel by the mean of the four nearest pixels of the same colour that are not hot.
pub fn fill_hot_pixels(image: &mut SensorImage, hot: &[u32]) {
    let (width, height) = (image.width, image.height);
    let found: Vec<f32> = hot
        .iter()
        .map(|&k| {
            let (x, y) = (k as usize % width, k as usize / width);
            let (mut sum, mut n) = (0f32, 0f32);
            for (x, y) in [(x.wrapping_sub(2), y), (x + 2, y), (x, y.wrapping_sub(2)), (x, y + 2)] {
                if x < width && y < height && hot.binary_search(&((y * width + x) as u32)).is_err() {
                    sum += image.at(x, y);
                    n += 1.0;
                }
            }
            if n > 0.0 { sum / n } else { image.at(x, y).min(1.0) }
        })
        .collect();
    for (&k, v) in hot.iter().zip(found) {
        image.data[k as usize] = v;
    }
}

/// Marks hot pixels as saturated, which measuring leaves out.
pub fn mask_hot_pixels(image: &mut SensorImage, hot: &[u32]) {
    hot.iter().for_each(|&k| image.data[k as usize] = f32::INFINITY);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::tests::planted::capture;

    /// Black images with the hot pixels planted, each at 400 DN, in 4 DN of noise.
    fn blacks(hot: &[u32], count: usize) -> Vec<Capture> {
        let of = |n: usize| {
            let noise = |k: usize| {
                (0..4).map(|r| (((k * 7919 + n * 31 + r * 104_729) * 2_654_435_761) >> 7) % 5).sum::<usize>()
            };
            let mut data: Vec<u16> = (0..96 * 80).map(|k| (160 + noise(k)) as u16).collect();
            hot.iter().for_each(|&k| data[k as usize] = 400);
            capture(96, 80, data)
        };
        (0..count).map(of).collect()
    }

    #[test]
    fn planted_hot_pixels_are_found_and_nothing_else() {
        let planted = [0, 95, 96, 1234, 1236, 5000, 96 * 80 - 1];
        for count in [1, 2, 3] {
            assert_eq!(find_hot_pixels(&blacks(&planted, count)).unwrap(), planted);
        }
        // A bright pixel in one image of three, or of two, may be due to a cosmic ray; it is not hot.
        for count in [2, 3] {
            let mut images = blacks(&planted, count);
            images[0].mosaic.data[777] = 4000;
            assert_eq!(find_hot_pixels(&images).unwrap(), planted);
        }
        assert_eq!(find_hot_pixels(&[]).unwrap(), Vec::<u32>::new());
    }

    #[test]
    fn images_with_light_or_of_two_cameras_are_refused() {
        let mut images = blacks(&[5], 2);
        images[1].mosaic.data.iter_mut().for_each(|v| *v += 400);
        assert!(matches!(find_hot_pixels(&images), Err(Error::NotBlack { index: 2 })));
        images[1] = capture(80, 96, vec![168; 96 * 80]);
        assert!(matches!(find_hot_pixels(&images), Err(Error::SizesDiffer { index: 2, .. })));
        let everywhere: Vec<u32> = (0..96 * 80).step_by(50).collect();
        assert!(matches!(find_hot_pixels(&blacks(&everywhere, 1)), Err(Error::NotBlack { .. })));
    }

    #[test]
    fn a_hot_pixel_is_filled_from_its_colour() {
        let mut image =
            SensorImage { width: 8, height: 6, data: (0..48).map(|k| k as f32).collect(), limit: [99.0; 4] };
        let hot = [0, 20, 22];
        mask_hot_pixels(&mut image, &hot);
        assert!(hot.iter().all(|&k| image.data[k as usize] >= image.limit[0]));
        fill_hot_pixels(&mut image, &hot);
        assert_eq!(
            [image.data[0], image.data[20], image.data[22]],
            [(2.0 + 16.0) / 2.0, (18.0 + 4.0 + 36.0) / 3.0, 22.0]
        );
        assert!(
            check_hot_pixels(&hot, 300).is_ok()
                && check_hot_pixels(&hot, 22).is_err()
                && check_hot_pixels(&[3, 3], 300).is_err()
        );
    }
}
