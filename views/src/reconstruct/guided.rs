//! Colours of reconstructed views, guided by their luminance: colour differences follow the luminance by the guided
//! filter (He, Sun, Tang 2013), and the remainder is kept as far as it exceeds noise (local Wiener filter).

use lenslet_core::colour::LUMINANCE;
use lenslet_core::geometry::Size;
use lenslet_core::image::{BoxMeans, GuidedFilter, box_mean_in_bands};
use ndarray::{Array2, Array3, Axis};
use rayon::prelude::*;

/// Variance of luminance below which colour does not follow it.
///
/// Source: chosen.
const EPSILON: f32 = 3e-5;
/// Half the side of the windows in which the residual of the guided filter is compared with noise, pixels.
///
/// Source: chosen.
const AROUND: usize = 2;
/// Steps of luminance in which noise is estimated.
///
/// Source: chosen.
const STEPS: usize = 8;
/// Share of the windows of one luminance that contain noise alone; the largest variance among them times `FACTOR` is
/// the variance of the noise.
///
/// Source: chosen.
const QUIET: f64 = 0.25;
/// See `QUIET`.
///
/// Source: chosen: variances of small windows scatter.
const FACTOR: f32 = 2.5;
/// Step between the windows in which noise is estimated, pixels along either axis.
///
/// Source: chosen for speed.
const SPARSE: usize = 3;

/// The view (t, s, 3), sRGB-encoded, with the luminance `after` instead of `before`, its own. Its colour differences
/// are smoothed in windows of 2·`radius` + 1 pixels. A view of one channel becomes `after`. Clamped to 0..1.
pub(crate) fn with_luminance(
    view: &Array3<f32>,
    before: &Array2<f32>,
    after: &Array2<f32>,
    radius: usize,
) -> Array3<f32> {
    let mut out = view.clone();
    if view.dim().2 != 3 {
        for (mut pixel, &a) in out.lanes_mut(Axis(2)).into_iter().zip(after) {
            pixel.fill(clamped(a));
        }
        return out;
    }
    // Two differences determine the third: with the weights of luminance they sum to zero.
    let difference = |k: usize| &view.index_axis(Axis(2), k) - before;
    let [red, blue] = smooth(after, [difference(0), difference(2)], radius);
    let [wr, wg, wb] = LUMINANCE;
    for (((mut pixel, &a), &r), &b) in out.lanes_mut(Axis(2)).into_iter().zip(after).zip(&red).zip(&blue) {
        pixel[0] = clamped(a + r);
        pixel[1] = clamped(a - (wr * r + wb * b) / wg);
        pixel[2] = clamped(a + b);
    }
    out
}

fn clamped(v: f32) -> f32 {
    if v.is_finite() { v.clamp(0.0, 1.0) } else { 0.0 }
}

/// Two colour differences, guided by the luminance.
fn smooth(guide: &Array2<f32>, differences: [Array2<f32>; 2], radius: usize) -> [Array2<f32>; 2] {
    let finite = |v: f32| if v.is_finite() { v } else { 0.0 };
    let guide = guide.as_standard_layout().mapv(finite);
    let (h, w) = guide.dim();
    let Some(luminance) = guide.as_slice() else { return differences };
    let filter = GuidedFilter::new(luminance, Size::new(w, h), radius, EPSILON, BoxMeans::AllThreads);
    let followed: Vec<(Array2<f32>, Array2<f32>)> = differences
        .into_par_iter()
        .map(|difference| {
            let difference = difference.as_standard_layout().mapv(finite);
            let mut guided = difference.clone();
            if let Some(values) = guided.as_slice_mut() {
                filter.filter(values);
            }
            let left = difference - &guided;
            (guided, left)
        })
        .collect();
    // The remainder is attenuated by the energy of all three colours together.
    let [wr, wg, wb] = LUMINANCE;
    let mut energy = Array2::zeros(guide.dim());
    ndarray::Zip::from(&mut energy).and(&followed[0].1).and(&followed[1].1).for_each(|e: &mut f32, &r, &b| {
        let g = (wr * r + wb * b) / wg;
        *e = r * r + b * b + g * g;
    });
    let energy = box_mean_in_bands(energy, AROUND);
    let noise = noise(&guide, &energy);
    let share = ndarray::Zip::from(&energy).and(&guide).map_collect(|&e, &i| {
        let n = noise_at(&noise, i);
        if e > n { (e - n) / e } else { 0.0 }
    });
    let kept = followed.into_iter().map(|(mut guided, left)| {
        ndarray::Zip::from(&mut guided).and(&left).and(&share).for_each(|g, l, s| *g += s * l);
        guided
    });
    let mut kept = kept.collect::<Vec<_>>().into_iter();
    std::array::from_fn(|_| kept.next().unwrap_or_default())
}

fn step(luminance: f32) -> usize {
    ((luminance.max(0.0) * STEPS as f32) as usize).min(STEPS - 1)
}

/// The energy of noise at a luminance, between the steps: a pixel whose luminance lies at the border of two steps does not
/// jump from one to the other when it is rounded otherwise.
fn noise_at(noise: &[f32; STEPS], luminance: f32) -> f32 {
    let at = (luminance * STEPS as f32 - 0.5).clamp(0.0, (STEPS - 1) as f32);
    let (low, part) = (at as usize, at.fract());
    noise[low] + part * (noise[(low + 1).min(STEPS - 1)] - noise[low])
}

/// Energy of noise in windows, by luminance: from the quietest among windows of like luminance. 0 where there are fewer
/// than 16.
fn noise(guide: &Array2<f32>, energy: &Array2<f32>) -> [f32; STEPS] {
    let mut groups: [Vec<f32>; STEPS] = Default::default();
    for (i, e) in guide.rows().into_iter().zip(energy.rows()).step_by(SPARSE) {
        for (&i, &e) in i.iter().zip(e).step_by(SPARSE) {
            groups[step(i)].push(e);
        }
    }
    groups.map(|mut group| {
        let at = (group.len() as f64 * QUIET) as usize;
        if group.len() < 16 {
            return 0.0;
        }
        FACTOR * *group.select_nth_unstable_by(at, f32::total_cmp).1
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use lenslet_core::colour::luminance;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    /// The last digit of one pixel's luminance, at the border of two steps, moved its colours by a hundredth.
    #[test]
    fn rounding_moves_colours_by_rounding() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let [wr, wg, wb] = LUMINANCE;
        // A ramp across all steps, with noise in the colours that grows along it.
        let luminance = Array2::from_shape_fn((60, 800), |(_, x)| (x as f32 + 0.5) / 800.0);
        let view = Array3::from_shape_fn((60, 800, 3), |(_, x, _)| (x as f32 + 0.5) / 800.0);
        let mut noisy = view.clone();
        for mut pixel in noisy.lanes_mut(Axis(2)) {
            let strength = 0.3 * pixel[0].powi(2);
            let (r, b) = (strength * (rng.random::<f32>() - 0.5), strength * (rng.random::<f32>() - 0.5));
            pixel[0] += r;
            pixel[2] += b;
            pixel[1] -= (wr * r + wb * b) / wg;
        }
        let with_pixel = |value: f32| {
            let mut after = luminance.clone();
            after[[30, 300]] = value;
            with_luminance(&noisy, &luminance, &after, 4)
        };
        let off = (&with_pixel(0.375 - 2e-6) - &with_pixel(0.375 + 2e-6)).fold(0f32, |a, x| a.max(x.abs()));
        assert!(off < 1e-4, "{off}");
    }

    fn scene(noise: f32) -> (Array3<f32>, Array3<f32>) {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let clean = Array3::from_shape_fn((90, 110, 3), |(y, x, k)| {
            let disc = (y as f32 - 40.0).hypot(x as f32 - 50.0) < 25.0;
            let bars = if (x / 9) % 2 == 0 { 0.15 } else { 0.0 };
            (if disc { [0.7, 0.3, 0.2][k] } else { [0.3, 0.45, 0.5][k] }) + bars
        });
        // Noise in the colours alone.
        let mut noisy = clean.clone();
        for mut pixel in noisy.lanes_mut(Axis(2)) {
            let (r, b) = (noise * (rng.random::<f32>() - 0.5), noise * (rng.random::<f32>() - 0.5));
            pixel[0] += r;
            pixel[2] += b;
            pixel[1] -= (LUMINANCE[0] * r + LUMINANCE[2] * b) / LUMINANCE[1];
        }
        (clean, noisy)
    }

    fn error(a: &Array3<f32>, b: &Array3<f32>) -> f32 {
        (a - b).mapv(|v| v * v).mean().unwrap()
    }

    #[test]
    fn colour_noise_is_removed_and_colours_stay() {
        let (clean, noisy) = scene(0.12);
        let y = luminance(noisy.view());
        let calm = with_luminance(&noisy, &y, &y, 3);
        assert!(
            error(&calm, &clean) < 0.25 * error(&noisy, &clean),
            "{} {}",
            error(&calm, &clean),
            error(&noisy, &clean)
        );
        // The luminance is what was given.
        assert!((luminance(calm.view()) - &y).iter().all(|d| d.abs() < 1e-4));
        let (clean, _) = scene(0.0);
        let y = luminance(clean.view());
        assert!(error(&with_luminance(&clean, &y, &y, 3), &clean) < 1e-6);
    }

    #[test]
    fn grey_stays_grey_and_flat_colour_as_it_is() {
        let grey = Array3::from_shape_fn((20, 30, 3), |(y, x, _)| ((x * y) % 17) as f32 / 17.0);
        let y = luminance(grey.view());
        let out = with_luminance(&grey, &y, &y, 3);
        assert!((&out - &grey).iter().all(|d| d.abs() < 1e-4));
        let flat = Array3::from_shape_fn((9, 1, 3), |(_, _, k)| [0.8, 0.2, 0.4][k]);
        let y = luminance(flat.view());
        assert!((&with_luminance(&flat, &y, &(&y + 0.1), 3) - &flat).iter().all(|d| (d - 0.1).abs() < 1e-5));
        // One channel is its luminance; NaN counts as 0.
        let one = Array3::from_elem((4, 5, 1), 0.25);
        let after = Array2::from_elem((4, 5), 1.5);
        assert_eq!(
            with_luminance(&one, &Array2::from_elem((4, 5), 0.25), &after, 3),
            Array3::from_elem((4, 5, 1), 1.0)
        );
        let odd = Array3::from_elem((4, 5, 3), f32::NAN);
        let y = luminance(odd.view());
        assert!(with_luminance(&odd, &y, &after, 3).iter().all(|v| (0.0..=1.0).contains(v)));
        assert_eq!(
            with_luminance(&Array3::zeros((0, 5, 3)), &Array2::zeros((0, 5)), &Array2::zeros((0, 5)), 3).dim(),
            (0, 5, 3)
        );
    }
}
