//! White balance estimated from the capture itself: shades of grey.

use rayon::prelude::*;

use super::mosaic::Mosaic;
use crate::container::Cfa;

/// Side of the blocks whose means are compared, pixels.
///
/// Source: chosen; about two micro-images.
const BLOCK: usize = 16;
/// Order of the mean: between grey world (1) and white patch (∞).
///
/// Source: Finlayson and Trezzi, "Shades of gray and colour constancy", 2004.
const NORM: i32 = 6;
/// Blocks with a brighter pixel are left out; share of full light.
///
/// Source: chosen.
const SATURATED: f32 = 0.95;
/// Blocks with less green light are left out; share of full light.
///
/// Source: chosen.
const DARK: f64 = 0.01;
/// Largest gain.
///
/// Source: chosen.
const MAX_GAIN: f32 = 16.0;

/// White balance estimated from a mosaic, as gains of red, green, blue with the least at 1, none above 16.
///
/// Shades of grey: the sixth-power means of the three colours are made equal, over blocks of 16×16 pixels that are
/// neither dark nor saturated. Bright surfaces have the most weight, but no single highlight dominates.
pub(super) fn estimate_gains(mosaic: &Mosaic, cfa: Cfa) -> [f32; 3] {
    let (width, height) = (mosaic.width, mosaic.height);
    let bands: Vec<[f64; 3]> = (0..height / BLOCK)
        .into_par_iter()
        .map(|by| {
            let mut sums = [0f64; 3];
            for bx in 0..width / BLOCK {
                let mut mean = [0f64; 3];
                let mut most = 0f32;
                for y in by * BLOCK..(by + 1) * BLOCK {
                    for x in bx * BLOCK..(bx + 1) * BLOCK {
                        let value = mosaic.data[y * width + x];
                        most = most.max(value);
                        mean[cfa.colour(x, y)] += f64::from(value.max(0.0));
                    }
                }
                let count = (BLOCK * BLOCK / 4) as f64;
                let mean = [mean[0] / count, mean[1] / (2.0 * count), mean[2] / count];
                if most < SATURATED && mean[1] > DARK {
                    for (s, m) in sums.iter_mut().zip(mean) {
                        *s += m.powi(NORM);
                    }
                }
            }
            sums
        })
        .collect();
    let mut total = [0f64; 3];
    for band in bands {
        for (t, b) in total.iter_mut().zip(band) {
            *t += b;
        }
    }
    if total.iter().any(|&t| t <= 0.0) {
        return [1.0; 3];
    }
    let norm = total.map(|t| t.powf(1.0 / f64::from(NORM)));
    let most = norm.iter().copied().fold(0.0, f64::max);
    norm.map(|n| ((most / n) as f32).min(MAX_GAIN))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_colour_cast_is_found() {
        let cast = [0.5f32, 1.0, 0.25];
        let (width, height) = (64, 64);
        let data = (0..width * height)
            .map(|k| {
                let (x, y) = (k % width, k / width);
                cast[Cfa::Bggr.colour(x, y)] * (0.2 + 0.6 * (x / 16) as f32 / 4.0)
            })
            .collect();
        let gains = estimate_gains(&Mosaic { width, height, data }, Cfa::Bggr);
        for c in 0..3 {
            assert!((gains[c] * cast[c] - 1.0).abs() < 1e-3, "{gains:?}");
        }
        let dark = Mosaic { width, height, data: vec![0.0; width * height] };
        assert_eq!(estimate_gains(&dark, Cfa::Bggr), [1.0; 3]);
    }
}
