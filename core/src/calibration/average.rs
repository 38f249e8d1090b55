//! Algorithm 1, "compute average white images": the mean of n captures has √n times less noise than one.
//! Values become light above the black level as a share of full scale, `(DN − black) / (white − black)`.

use std::borrow::Borrow;

use rayon::prelude::*;

use super::checks;
use super::error::Error;
use super::sensor_image::SensorImage;
use crate::container::Capture;

/// Largest share of saturated pixels (0 to 1) of an image that can be calibrated.
/// Source: chosen
const MOST_SATURATED: f64 = 0.5;
/// Mean light (share of full scale) below which an image counts as black.
/// Source: chosen
const LEAST_LIGHT: f64 = 0.004;

/// Averages captures of one camera, each colour with its own black and white level. `encode` is applied to each value
/// before averaging: the paper's gamma, or the identity where light stays linear (the default). A pixel saturated in
/// any capture is saturated in the average.
///
/// # Errors
/// No captures, sizes or cameras that differ, images too small, black or saturated ones.
pub fn average_captures<C: Borrow<Capture>>(
    captures: &[C],
    encode: impl Fn(f32) -> f32 + Sync,
) -> Result<SensorImage, Error> {
    checks::check_same_camera(captures)?;
    let first = &captures[0].borrow().mosaic;
    let (width, height) = (first.width, first.height);
    let mut data = vec![0f32; width * height];
    let share = 1.0 / captures.len() as f32;
    let full = encode(1.0);
    let mut saturated = 0u64;
    for capture in captures {
        let capture: &Capture = capture.borrow();
        let tables = light_tables(capture, &encode);
        let counts: Vec<u64> = data
            .par_chunks_mut(width)
            .zip(capture.mosaic.data.par_chunks(width))
            .enumerate()
            .map(|(y, (out, row))| {
                let pair = [&tables[(y & 1) * 2], &tables[(y & 1) * 2 + 1]];
                let mut count = 0;
                for (x, (out, &dn)) in out.iter_mut().zip(row).enumerate() {
                    let table = pair[x & 1];
                    let v = table.values.get(usize::from(dn)).copied().unwrap_or(f32::INFINITY);
                    count += u64::from(v.is_infinite());
                    *out += v * share;
                }
                count
            })
            .collect();
        saturated += counts.iter().sum::<u64>();
    }
    let percent = 100.0 * saturated as f64 / (data.len() * captures.len()) as f64;
    if percent > 100.0 * MOST_SATURATED {
        return Err(Error::Saturated { percent });
    }
    let sums: Vec<f64> = data
        .par_chunks_mut(width)
        .map(|row| {
            let mut sum = 0f64;
            for v in row.iter_mut() {
                if v.is_infinite() {
                    *v = full;
                }
                sum += f64::from(*v);
            }
            sum
        })
        .collect();
    let mean = sums.iter().sum::<f64>() / data.len() as f64;
    if mean < f64::from(encode(LEAST_LIGHT as f32)) {
        return Err(Error::Black { percent: 100.0 * mean });
    }
    Ok(SensorImage { width, height, data, limit: [full; 4] })
}

/// Light of each digital number at one place of the 2×2 tile; infinite from the white level on.
struct LightTable {
    values: Vec<f32>,
}

fn light_tables(capture: &Capture, encode: &impl Fn(f32) -> f32) -> [LightTable; 4] {
    [0, 1, 2, 3].map(|k| {
        let plane = capture.cfa.plane(k & 1, k >> 1);
        let (black, white) = (capture.levels.black[plane], capture.levels.white[plane]);
        let scale = 1.0 / (white - black);
        let top = white.clamp(1.0, 65535.0) as usize;
        let values = (0..=top)
            .map(|dn| {
                let dn = dn as f32;
                if dn >= white { f32::INFINITY } else { encode(((dn - black) * scale).max(-0.1)) }
            })
            .collect();
        LightTable { values }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::container::{Cfa, Levels, RawMosaic};

    fn capture(data: Vec<u16>) -> Capture {
        let levels = Levels { black: [100.0, 110.0, 120.0, 130.0], white: [1100.0; 4] };
        Capture::bare(RawMosaic { width: 64, height: data.len() / 64, data }, Cfa::Rggb, levels)
    }

    #[test]
    fn light_is_a_share_of_full_scale_and_saturation_stays() {
        // The white level itself is saturated, one below is not, and below black is negative light.
        let mut data = vec![600u16; 64 * 64];
        (data[0], data[2], data[4], data[6]) = (1100, 1099, 0, 5000);
        let found = average_captures(&[capture(data.clone())], |v| v).unwrap();
        assert_eq!((found.width, found.height, found.limit), (64, 64, [1.0; 4]));
        assert_eq!((found.data[0], found.data[6]), (1.0, 1.0));
        assert!((found.data[2] - 0.999).abs() < 1e-6 && (found.data[4] + 0.1).abs() < 1e-6);
        // One plane each at the places of the tile.
        let light = [500.0 / 1000.0, 490.0 / 990.0, 480.0 / 980.0, 470.0 / 970.0];
        for (k, plane) in [(10, 0), (11, 1), (64 + 10, 2), (64 + 11, 3)] {
            let (x, y) = (k % 64, k / 64);
            assert_eq!(Cfa::Rggb.plane(x & 1, y & 1), plane);
            assert!((found.data[k] - light[plane]).abs() < 1e-6, "{k}");
        }
        data[0] = 300;
        let brighter = vec![800u16; 64 * 64];
        let both = average_captures(&[capture(data), capture(brighter)], |v| v * v).unwrap();
        assert!((both.data[0] - (0.2f32.powi(2) + 0.7f32.powi(2)) / 2.0).abs() < 1e-6, "{}", both.data[0]);
        assert_eq!(both.data[6], 1.0);
    }

    #[test]
    fn black_and_saturated_images_are_refused() {
        let rows = |white: usize| {
            let mut data = vec![600u16; 64 * 64];
            data[..64 * white].fill(1100);
            average_captures(&[capture(data)], |v| v)
        };
        assert!(rows(32).is_ok());
        let Err(Error::Saturated { percent }) = rows(48) else { panic!("not refused") };
        assert!((percent - 75.0).abs() < 1e-9);
        let dim = |dn: u16| {
            let levels = Levels { black: [100.0; 4], white: [1100.0; 4] };
            let mosaic = RawMosaic { width: 64, height: 64, data: vec![dn; 64 * 64] };
            average_captures(&[Capture::bare(mosaic, Cfa::Rggb, levels)], |v| v)
        };
        assert!(matches!(dim(102), Err(Error::Black { .. })) && dim(106).is_ok());
    }
}
