//! Section 4.1 as printed: the raw is downsampled by the diameter of a micro-image, so that every low pixel is the one
//! raw value of the nearest lenslet, and the low image enlarged bicubically. The usual row `bicubic` interpolates the
//! low image between three lenslets instead.

use anyhow::Result;
use lenslet_core::decode::HexSamples;
use lenslet_core::geometry::{SensorToView, Size};
use lenslet_core::sampling::bicubic::resize_bicubic;
use lenslet_views::native_size;
use ndarray::Array3;

/// The views (row v, column u) wanted, in linear light.
pub(super) fn downsampled_views(
    samples: &HexSamples,
    target: &Size,
    wanted: &[(usize, usize)],
) -> Result<Vec<Array3<f32>>> {
    let low = native_size(samples);
    let nearest = nearest_lenslets(samples, low);
    wanted
        .iter()
        .map(|&(v, u)| {
            let values = samples.view(v, u);
            let picture = Array3::from_shape_fn((low.height, low.width, values.dim().1), |(t, s, c)| {
                values[[nearest[t * low.width + s], c]]
            });
            Ok(resize_bicubic(picture.view(), *target)?)
        })
        .collect()
}

/// The lenslet nearest to every pixel of the low image, row by row.
fn nearest_lenslets(samples: &HexSamples, low: Size) -> Vec<usize> {
    let map = SensorToView::new(samples.sensor, low);
    // Lenslets by the low pixel that holds them; the nearest one is at most a pitch and a half away.
    let clamp = |p: f64, n: usize| (p.round().max(0.0) as usize).min(n - 1);
    let mut cells = vec![Vec::new(); low.width * low.height];
    for (k, c) in samples.centres.iter().enumerate() {
        let [s, t] = map.to_view(*c);
        cells[clamp(t, low.height) * low.width + clamp(s, low.width)].push(k);
    }
    let all: Vec<usize> = (0..samples.centres.len()).collect();
    (0..low.width * low.height)
        .map(|pixel| {
            let (s, t) = (pixel % low.width, pixel / low.width);
            let [x, y] = map.to_sensor([s as f64, t as f64]);
            let around: Vec<usize> = (t.saturating_sub(2)..=(t + 2).min(low.height - 1))
                .flat_map(|t| (s.saturating_sub(2)..=(s + 2).min(low.width - 1)).map(move |s| (s, t)))
                .flat_map(|(s, t)| cells[t * low.width + s].iter().copied())
                .collect();
            let away = |k: &usize| (samples.centres[*k][0] - x).hypot(samples.centres[*k][1] - y);
            let near = if around.is_empty() { &all } else { &around };
            near.iter().copied().min_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or(0)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_low_pixel_is_one_lenslets_value() {
        let centres: Vec<[f64; 2]> = (0..140)
            .map(|k| [5.0 + 10.0 * f64::from(k % 12) + 5.0 * f64::from(k / 12 % 2), 5.0 + 8.66 * f64::from(k / 12)])
            .filter(|c| c[0] < 120.0 && c[1] < 100.0)
            .collect();
        let n = centres.len();
        let samples = HexSamples {
            sensor: Size::new(120, 100),
            index: vec![[0, 0]; n],
            views: 1,
            view_step: 1.0,
            weights: vec![1.0],
            values: Array3::from_shape_fn((1, n, 1), |(_, k, _)| k as f32),
            centres,
        };
        let low = native_size(&samples);
        let view = downsampled_views(&samples, &low, &[(0, 0)]).unwrap().remove(0);
        for t in 0..low.height {
            for s in 0..low.width {
                let (x, y) = (
                    (s as f64 + 0.5) * 120.0 / low.width as f64 - 0.5,
                    (t as f64 + 0.5) * 100.0 / low.height as f64 - 0.5,
                );
                let away = |k: usize| (samples.centres[k][0] - x).hypot(samples.centres[k][1] - y);
                let k = view[[t, s, 0]].round() as usize;
                assert!((view[[t, s, 0]] - k as f32).abs() < 1e-4);
                assert!((0..n).all(|other| away(k) <= away(other) + 1e-9), "pixel ({s}, {t}) has lenslet {k}");
            }
        }
    }
}
