//! Colours outside sRGB, moved into it towards the grey of the same luminance; the hue is kept.
//!
//! A camera's colour matrix subtracts colours from each other, so deep colours, and dark ones with noise on them, come
//! out with channels below 0. Cutting those at 0 changes hue and luminance and leaves bright specks. Here a colour
//! `y + d` (y its luminance, d the rest) becomes `y + k·d`, k the same for the three channels: the line through grey is
//! the line of constant hue in linear light. With x = the distance of the colour from grey as a share of the way to the
//! border of the cube, k = f(x)/x, f(x) = x up to `KNEE` and from there towards 1 without reaching it.
//!
//! Above the range there is a choice: darken and keep the colour, or keep the light and fade to white. The mean of
//! both is taken.

use ndarray::Array3;
use rayon::prelude::*;

use crate::colour::luminance_of_linear;

/// Share of the way to the border up to which nothing changes.
///
/// Source: chosen.
const KNEE: f32 = 0.95;

/// Fits every colour of `values` (…, …, 3) into 0..=1; other numbers of channels stay as they are.
pub(super) fn fit_colours(values: &mut Array3<f32>) {
    if values.dim().2 != 3 {
        return;
    }
    if let Some(flat) = values.as_slice_mut() {
        flat.par_chunks_mut(3 * 4096).for_each(|part| {
            for p in part.as_chunks_mut::<3>().0 {
                *p = fit_colour(*p);
            }
        });
    }
}

/// One colour in linear sRGB, of any size, as one within 0..=1. Greys within the range and colours not near its border
/// are returned as they are; NaN becomes black.
fn fit_colour(rgb: [f32; 3]) -> [f32; 3] {
    let least = rgb[0].min(rgb[1]).min(rgb[2]);
    let most = rgb[0].max(rgb[1]).max(rgb[2]);
    let y = luminance_of_linear(rgb);
    // The usual case.
    if y - least <= KNEE * y && most - y <= KNEE * (1.0 - y) {
        return rgb;
    }
    let light = y > 0.0 && most.is_finite() && least.is_finite();
    if !light {
        return [0.0; 3];
    }
    let faded = towards_grey(rgb, y.min(1.0), y);
    if most <= 1.0 {
        return faded;
    }
    let darkened = towards_grey(rgb.map(|v| v / most), y / most, y / most);
    std::array::from_fn(|c| 0.5 * (faded[c] + darkened[c]))
}

/// `rgb` of luminance `y`, moved to luminance `grey` (0..=1); its colour is reduced until it fits.
fn towards_grey(rgb: [f32; 3], grey: f32, y: f32) -> [f32; 3] {
    let d = rgb.map(|v| v - y);
    let below = -d[0].min(d[1]).min(d[2]);
    let above = d[0].max(d[1]).max(d[2]);
    // x·(1 − grey) ≥ above and x·grey ≥ below, without dividing by a room that may be 0.
    let tight = |room: f32, need: f32| if need > KNEE * room { squeeze(room, need) } else { 1.0 };
    let k = tight(grey, below).min(tight(1.0 - grey, above));
    d.map(|v| (grey + k * v).clamp(0.0, 1.0))
}

/// f(x)/x for x = need/room, also where the room is 0.
fn squeeze(room: f32, need: f32) -> f32 {
    // f(x) = K + (x − K)/(1 + (x − K)/(1 − K)), both sides times room.
    let over = need - KNEE * room;
    let rest = (1.0 - KNEE) * room;
    (KNEE * room + over * rest / (rest + over)) / need
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Colours of every kind: a raster over −1..2 in all three channels.
    fn raster() -> impl Iterator<Item = [f32; 3]> {
        let at = |k: usize| -1.0 + 3.0 * k as f32 / 30.0 + 0.003;
        (0..31 * 31 * 31).map(move |n| [at(n / 961), at(n / 31 % 31), at(n % 31)])
    }

    #[test]
    fn everything_fits_and_keeps_its_hue() {
        let mut changed = 0;
        for p in raster() {
            let q = fit_colour(p);
            assert!(q.iter().all(|v| (0.0..=1.0).contains(v)), "{p:?} {q:?}");
            let (y, z) = (luminance_of_linear(p), luminance_of_linear(q));
            if y <= 0.0 {
                assert_eq!(q, [0.0; 3]);
                continue;
            }
            // The chromatic parts of both have the same direction.
            let (d, e) = (p.map(|v| v - y), q.map(|v| v - z));
            let dot: f32 = (0..3).map(|c| d[c] * e[c]).sum();
            let (dd, ee): (f32, f32) = (d.iter().map(|v| v * v).sum(), e.iter().map(|v| v * v).sum());
            assert!(dot >= -1e-6 && (dot * dot - dd * ee).abs() < 2e-5 * (1.0 + dd * ee), "{p:?} {q:?}");
            if p.iter().all(|v| *v <= 1.0) {
                assert!((y - z).abs() < 1e-5, "luminance of {p:?}: {y} {z}");
            }
            changed += usize::from(p != q);
        }
        assert!(changed > 10_000);
    }

    #[test]
    fn greys_and_colours_inside_stay_and_light_beyond_the_range_is_white() {
        for k in 0..=20 {
            let grey = [k as f32 / 20.0; 3];
            let got = fit_colour(grey);
            assert!(got.iter().all(|v| (v - grey[0]).abs() < 1e-6), "{got:?}");
        }
        assert_eq!(fit_colour([0.7, 0.2, 0.1]), [0.7, 0.2, 0.1]);
        assert_eq!(fit_colour([5.0, 5.0, 5.0]), [1.0; 3]);
        assert_eq!(fit_colour([f32::NAN, 0.2, 0.3]), [0.0; 3]);
        assert_eq!(fit_colour([f32::INFINITY, 0.2, 0.3]), [0.0; 3]);
        // A green leaf that the matrix pushed below 0: cutting would add light and turn it.
        let leaf = fit_colour([-0.05, 0.2, 0.02]);
        assert!(
            leaf[0] > 0.0 && leaf[0] < 0.02 && leaf[1] > leaf[2] && (luminance_of_linear(leaf) - 0.1338).abs() < 1e-3,
            "{leaf:?}"
        );
    }

    #[test]
    fn the_map_is_continuous() {
        for p in raster() {
            let q = fit_colour(p);
            for c in 0..3 {
                let mut near = p;
                near[c] += 1e-4;
                let r = fit_colour(near);
                let step = (0..3).map(|k| (q[k] - r[k]).abs()).fold(0.0, f32::max);
                // Steep only close to black and white, where little colour fits.
                let room = luminance_of_linear(p).min((luminance_of_linear(p) - 1.0).abs().max(0.02));
                assert!(luminance_of_linear(p) <= 0.02 || step < 1e-4 * (2.0 + 8.0 / room), "{p:?} {step}");
            }
        }
    }
}
