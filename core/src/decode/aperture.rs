//! The views' positions in the aperture, from the white image: the middle of the aperture, and the light of each view.
//!
//! A micro-image is a picture of the main lens's aperture, so its middle is the optical axis: view (0, 0) belongs
//! there, and views near the border are dark. Both are read from the mean micro-image of the calibration's white
//! image.

use super::micro_image::is_within;
use super::samples::view_offset;
use crate::calibration::{Calibration, Vignetting};
use crate::image::bilinear_by_weights;
use crate::linalg::gauss_jordan;

/// Lenslets that are averaged, spread over the sensor.
///
/// Source: chosen.
const LENSLETS: usize = 4000;
/// Share of the sensor's half diagonal within which micro-images show the whole aperture.
///
/// Source: chosen.
const CENTRAL: f64 = 0.6;
/// Largest correction, in pitches: a larger one means that the calibration is wrong, not slightly off.
///
/// Source: chosen.
const FARTHEST: f64 = 0.15;
/// A smaller pivot of the normal equations means that there is no light to fit.
///
/// Source: chosen.
const LEAST_PIVOT: f64 = 1e-12;

/// From the calibration's lenslet centres to the middle of the mean micro-image, in sensor pixels: moved by it, the
/// middle view lies on the optical axis. 0 without a white image, or where the light has no maximum within reach.
///
/// Objective: the paraboloid a + b·x + c·y + e·(x² + y²) with the least squared error to the white image about the
/// centres, and its apex; repeated about the apex, where b = c = 0 for every symmetric profile.
pub(super) fn aperture_middle(calibration: &Calibration) -> [f64; 2] {
    let Some(white) = &calibration.vignetting else { return [0.0; 2] };
    let pitch = calibration.lattice.pitch();
    let mut at = [0.0; 2];
    for _ in 0..6 {
        let Some(step) = apex(calibration, white, at, 0.38 * pitch) else { return [0.0; 2] };
        at = [at[0] + step[0], at[1] + step[1]];
        if at[0].hypot(at[1]) > FARTHEST * pitch {
            return [0.0; 2];
        }
        if step[0].hypot(step[1]) < 1e-4 {
            break;
        }
    }
    at
}

/// Apex of the paraboloid within `radius` of the centres moved by `at`, relative to these.
fn apex(calibration: &Calibration, white: &Vignetting, at: [f64; 2], radius: f64) -> Option<[f64; 2]> {
    // Sums of w·(1, x, y, r²)ᵀ(1, x, y, r²) and of the light times it. The window is round; w falls to 0 at its edge,
    // so that pixels enter gradually.
    let mut sums = [[0f64; 5]; 4];
    let reach = radius.ceil() as i64 + 1;
    let (cx, cy) = (calibration.width as f64 / 2.0, calibration.height as f64 / 2.0);
    let central = CENTRAL * cx.hypot(cy);
    for l in spread_centres(calibration).filter(|c| (c[0] - cx).hypot(c[1] - cy) < central) {
        let c = [l[0] + at[0], l[1] + at[1]];
        let (x0, y0) = (c[0].round() as i64, c[1].round() as i64);
        if x0 < reach || y0 < reach || x0 + reach >= white.width as i64 || y0 + reach >= white.height as i64 {
            continue;
        }
        for y in y0 - reach..=y0 + reach {
            for x in x0 - reach..=x0 + reach {
                let (dx, dy) = (x as f64 - c[0], y as f64 - c[1]);
                let r2 = dx * dx + dy * dy;
                let w = (1.0 - r2 / (radius * radius)).max(0.0).powi(2);
                if w > 0.0 {
                    let light = f64::from(white.white[y as usize * white.width + x as usize]) / 32768.0;
                    let row = [1.0, dx, dy, r2];
                    for (a, sums) in sums.iter_mut().enumerate() {
                        for b in 0..4 {
                            sums[b] += w * row[a] * row[b];
                        }
                        sums[4] += w * row[a] * light;
                    }
                }
            }
        }
    }
    gauss_jordan(&mut sums, LEAST_PIVOT)?;
    let [_, b, c, e] = sums.map(|row| row[4]);
    let apex = [-b / (2.0 * e), -c / (2.0 * e)];
    (e < 0.0 && apex.iter().all(|v| v.abs() <= radius)).then_some(apex)
}

/// How reliable each view is, 0..=1, in the order of `HexSamples`: the white image's mean light at the view, the
/// brightest view being 1; 0 for views beyond the border of their micro-image, whose values are only extrapolated.
/// `centres` are the lenslets'.
pub(super) fn view_weights(calibration: &Calibration, centres: &[[f64; 2]], views: usize, step: f64) -> Vec<f32> {
    let every = (centres.len() / LENSLETS).max(1);
    let light: Vec<f64> = (0..views * views)
        .map(|k| {
            let [u, v] = view_offset(views, step, k);
            if !is_within(&calibration.lattice, [u, v]) {
                return 0.0;
            }
            let Some(white) = &calibration.vignetting else { return 1.0 };
            let seen = centres.iter().step_by(every).filter_map(|c| bilinear(white, c[0] + u, c[1] + v));
            let (sum, n) = seen.fold((0.0, 0usize), |(s, n), v| (s + v, n + 1));
            sum / n.max(1) as f64
        })
        .collect();
    let full = light.iter().copied().fold(0.0, f64::max);
    // Without any light in the white image all views count alike.
    light.iter().map(|&l| if full > 0.0 { (l / full) as f32 } else { 1.0 }).collect()
}

fn bilinear(white: &Vignetting, x: f64, y: f64) -> Option<f64> {
    let (x0, y0) = (x.floor(), y.floor());
    if x0 < 0.0 || y0 < 0.0 || x0 + 1.0 >= white.width as f64 || y0 + 1.0 >= white.height as f64 {
        return None;
    }
    let (fx, fy) = (x - x0, y - y0);
    let at = |dx: usize, dy: usize| f64::from(white.white[(y0 as usize + dy) * white.width + x0 as usize + dx]);
    Some(bilinear_by_weights([at(0, 0), at(1, 0), at(0, 1), at(1, 1)], fx, fy))
}

fn spread_centres(calibration: &Calibration) -> impl Iterator<Item = [f64; 2]> {
    let every = (calibration.lenslets.len() / LENSLETS).max(1);
    calibration.lenslets.iter().step_by(every).map(|l| [l.x, l.y])
}
