//! Sub-pixel centre of each lenslet (paper section 3.2, "fit paraboloid"), on the unrotated, uneroded image: around the
//! predicted centre p, min over g, d of Σ w·(I(x)/F(x) − g·T(x − p − d))², linearised in (g, g·dx, g·dy). T is the
//! micro-image profile common to the sensor, F = 1 + slope·(x − p) the local slope of the illumination, w = rim/(T +
//! [`READ_NOISE`]).

use rayon::prelude::*;

use super::measured::MeasuredLenslet;
use super::predicted::PredictedLenslet;
use super::profile::MicroImageProfile;
use crate::calibration::sensor_image::SensorImage;
use crate::linalg::solve_small;

/// Read noise relative to shot noise at the centre of a lenslet: a pixel's variance is taken as ∝ T + `READ_NOISE`.
/// Source: chosen
const READ_NOISE: f32 = 0.08;

/// Measures every predicted lenslet; the results are in the order of `sites`. Pixels whose residual times √w exceeds
/// `clip` times the gain (hot pixels, dust) are left out; `f64::INFINITY` leaves out none.
pub fn measure_lenslets(
    image: &SensorImage,
    profile: &MicroImageProfile,
    sites: &[PredictedLenslet],
    clip: f64,
) -> Vec<MeasuredLenslet> {
    sites.par_iter().with_min_len(256).map(|site| measure_lenslet(image, profile, site, clip)).collect()
}

fn measure_lenslet(
    image: &SensorImage,
    profile: &MicroImageProfile,
    site: &PredictedLenslet,
    clip: f64,
) -> MeasuredLenslet {
    let reach = profile.radius;
    let mut out = MeasuredLenslet {
        i: site.i,
        j: site.j,
        x: site.x,
        y: site.y,
        gain: 0.0,
        unit: [f64::INFINITY; 2],
        misfit: f64::INFINITY,
        usable: false,
    };
    let (left, top) = ((site.x - reach).ceil().max(0.0), (site.y - reach).ceil().max(0.0));
    let right = (site.x + reach).floor().min(image.width as f64 - 1.0);
    let bottom = (site.y + reach).floor().min(image.height as f64 - 1.0);
    if !(left <= right && top <= bottom) {
        return out;
    }
    let (x0, x1, y0, y1) = (left as usize, right as usize, top as usize, bottom as usize);
    let inverse = (1.0 / (reach * reach)) as f32;
    let terms = profile.terms.map(|t| t as f32);
    let slopes: [f32; 4] = std::array::from_fn(|k| (k + 1) as f32 * terms[k + 1]);
    let (gx, gy) = (site.slope[0] as f32, site.slope[1] as f32);
    let clip2 = (clip * clip * site.gain * site.gain) as f32;
    // Sums of w·(t, tx, ty)², w·(t, tx, ty)·v, w·v², w.
    let mut s = [0f32; 12];
    let mut count = 0u32;
    for y in y0..=y1 {
        let dy = (y as f64 - site.y) as f32;
        let row = &image.row(y)[x0..=x1];
        let limits = [image.limit[(y & 1) * 2], image.limit[(y & 1) * 2 + 1]];
        for (x, &raw) in (x0..).zip(row) {
            let dx = (x as f64 - site.x) as f32;
            let u = (dx * dx + dy * dy) * inverse;
            if u >= 1.0 || raw >= limits[x & 1] {
                continue;
            }
            let t = (((terms[4] * u + terms[3]) * u + terms[2]) * u + terms[1]) * u + terms[0];
            let slope = ((slopes[3] * u + slopes[2]) * u + slopes[1]) * u + slopes[0];
            let v = raw / (1.0 + gx * dx + gy * dy);
            // Tapers to 0 over the last pixel, so that a pixel entering the window does not make the centre jump.
            let rim = ((1.0 - u) * reach as f32 * 0.5).min(1.0);
            let w = rim / (t.max(0.0) + READ_NOISE);
            let off = v - site.gain as f32 * t;
            if w * off * off > clip2 {
                continue;
            }
            let d = -2.0 * slope * inverse;
            let (tx, ty) = (d * dx, d * dy);
            let (wt, wx, wy) = (w * t, w * tx, w * ty);
            for (sum, term) in s.iter_mut().zip([
                wt * t,
                wt * tx,
                wt * ty,
                wx * tx,
                wx * ty,
                wy * ty,
                wt * v,
                wx * v,
                wy * v,
                w * v * v,
                w,
                0.0,
            ]) {
                *sum += term;
            }
            count += 1;
        }
    }
    let s = s.map(f64::from);
    let matrix = [[s[0], s[1], s[2]], [s[1], s[3], s[4]], [s[2], s[4], s[5]]];
    let Some([g, px, py]) = solve_small(matrix, [s[6], s[7], s[8]]) else { return out };
    if g.is_nan() || g <= 0.0 || count < 6 {
        return out;
    }
    let rest = (s[9] - g * s[6] - px * s[7] - py * s[8]).max(0.0);
    out.gain = g * profile.terms[0];
    out.misfit = rest / (g * g * f64::from(count - 3));
    let (dx, dy) = (px / g, py / g);
    for k in 0..2 {
        let mut unit = [0f64; 3];
        unit[k + 1] = 1.0;
        match solve_small(matrix, unit) {
            Some(column) => out.unit[k] = column[k + 1],
            None => return out,
        }
    }
    // The linearisation does not hold for steps beyond half of the window.
    if dx.hypot(dy) < 0.5 * reach {
        out.x = site.x + dx;
        out.y = site.y + dy;
        out.usable = true;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROFILE: MicroImageProfile = MicroImageProfile { terms: [1.0, -0.5, -0.2, 0.1, -0.15], radius: 5.0 };

    /// Light of one lenslet of this gain at a centre, under illumination of this slope about `at`.
    fn image(centre: [f64; 2], gain: f64, slope: [f64; 2], at: [f64; 2]) -> SensorImage {
        let data = (0..24 * 20)
            .map(|k| {
                let (x, y) = (f64::from(k % 24), f64::from(k / 24));
                let u = ((x - centre[0]).powi(2) + (y - centre[1]).powi(2)) / 25.0;
                let light = 1.0 + slope[0] * (x - at[0]) + slope[1] * (y - at[1]);
                (gain * PROFILE.at(u) * light) as f32
            })
            .collect();
        SensorImage { width: 24, height: 20, data, limit: [f32::INFINITY; 4] }
    }

    #[test]
    fn a_displaced_lenslet_is_measured_by_repeated_steps() {
        let (truth, slope) = ([11.38, 9.21], [0.01, -0.006]);
        let mut site = PredictedLenslet { i: 3, j: -2, x: 11.0, y: 9.5, gain: 0.7, slope };
        let mut image = image(truth, 0.7, slope, [11.0, 9.5]);
        let first = measure_lenslet(&image, &PROFILE, &site, f64::INFINITY);
        assert!(first.usable && (first.i, first.j) == (3, -2));
        assert!((first.x - truth[0]).hypot(first.y - truth[1]) < 0.06, "{first:?}");
        image = self::image(truth, 0.7, slope, truth);
        (site.x, site.y) = (truth[0], truth[1]);
        let found = measure_lenslet(&image, &PROFILE, &site, f64::INFINITY);
        assert!((found.x - truth[0]).hypot(found.y - truth[1]) < 1e-4, "{found:?}");
        assert!((found.gain - 0.7).abs() < 1e-4 && found.misfit < 1e-8, "{found:?}");
        // Noise of one part in a hundred of the light, in a chequered pattern, has that variance.
        for (k, v) in image.data.iter_mut().enumerate() {
            *v += if (k + k / 24) % 2 == 0 { 0.007 } else { -0.007 };
        }
        let noisy = measure_lenslet(&image, &PROFILE, &site, f64::INFINITY);
        let expected = 1e-4 / 0.75; // w is about the inverse of the profile's mean
        assert!(noisy.misfit > 0.7 * expected && noisy.misfit < 2.0 * expected, "{noisy:?}");
    }

    #[test]
    fn saturated_and_odd_pixels_are_left_out() {
        let (truth, slope) = ([11.4, 9.2], [0.0; 2]);
        let site = PredictedLenslet { i: 0, j: 0, x: 11.4, y: 9.2, gain: 0.7, slope };
        // A limit for each place of the 2×2 tile: the brightest pixels at odd x and odd y are wrong and above it.
        let mut saturated = image(truth, 0.7, slope, truth);
        saturated.limit = [10.0, 10.0, 10.0, 0.68];
        saturated.data[9 * 24 + 11] = 5.0;
        let found = measure_lenslet(&saturated, &PROFILE, &site, f64::INFINITY);
        assert!(found.usable && (found.x - 11.4).hypot(found.y - 9.2) < 1e-4, "{found:?}");
        let mut spoilt = image(truth, 0.7, slope, truth);
        spoilt.data[7 * 24 + 13] = 3.0;
        let found = measure_lenslet(&spoilt, &PROFILE, &site, 0.2);
        assert!(found.usable && (found.x - 11.4).hypot(found.y - 9.2) < 1e-4, "{found:?}");
        let kept = measure_lenslet(&spoilt, &PROFILE, &site, f64::INFINITY);
        assert!(!kept.usable || (kept.x - 11.4).hypot(kept.y - 9.2) > 0.05, "{kept:?}");
    }

    #[test]
    fn dark_places_and_places_outside_are_not_usable() {
        let site = PredictedLenslet { i: 0, j: 0, x: 11.4, y: 9.2, gain: 0.7, slope: [0.0; 2] };
        let measure =
            |image: &SensorImage, site: &PredictedLenslet| measure_lenslet(image, &PROFILE, site, f64::INFINITY);
        let mut dark = image([11.4, 9.2], 0.7, [0.0; 2], [0.0; 2]);
        dark.data.iter_mut().for_each(|v| *v = -*v);
        assert!(!measure(&dark, &site).usable);
        let bright = image([11.4, 9.2], 0.7, [0.0; 2], [0.0; 2]);
        assert!(!measure(&bright, &PredictedLenslet { x: -20.0, ..site }).usable);
        // Five pixels do not determine it.
        let mut few = bright.clone();
        few.data.iter_mut().for_each(|v| *v += 100.0);
        few.limit = [50.0; 4];
        for k in [0, 1, 2, 24, 25] {
            few.data[8 * 24 + 10 + k] -= 100.0;
        }
        assert!(!measure(&few, &site).usable);
    }
}
