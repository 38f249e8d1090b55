//! A score with no ground truth: hide some lenslets of a real capture, render from the rest, measure where they were.

use lenslet_core::decode::HexSamples;
use lenslet_core::ensure;
use lenslet_core::geometry::SensorToView;
use lenslet_core::geometry::Size;
use lenslet_core::sampling::bicubic::bicubic_at;
use ndarray::{Array3, Axis};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use crate::Error;
use crate::target::mean_pitch;

/// The score of the prediction of hidden lenslets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HiddenScore {
    /// PSNR over all channels, dB, of the values as they are (linear light for decoded captures).
    pub psnr: f64,
    /// Lenslets hidden and measured.
    pub lenslets: usize,
}

/// Hides a random `share` of the lenslets (all views of each), calls `render` for view (row, column) `at` of size
/// `target` with the rest, and compares it with what the hidden lenslets measured. Lenslets within two pitches of the
/// border are not measured.
///
/// # Errors
/// A share outside 0..0.5, a view that does not exist, errors of `render`.
pub fn hidden_score<E: From<Error>>(
    samples: &HexSamples,
    target: &Size,
    share: f64,
    seed: u64,
    at: (usize, usize),
    render: &mut dyn FnMut(&HexSamples) -> Result<Array3<f32>, E>,
) -> Result<HiddenScore, E> {
    ensure!(
        Error::Shape,
        share > 0.0 && share < 0.5,
        "the share of hidden lenslets must be above 0 and below 0.5, not {share}"
    );
    let (views, n, channels) = samples.values.dim();
    let inside = at.0 < samples.views && at.1 < samples.views && views == samples.views * samples.views;
    ensure!(Error::Shape, inside, "there is no view {},{}", at.0, at.1);
    let index = samples.view_index(at.0, at.1);
    ensure!(
        Error::Shape,
        n == samples.centres.len(),
        "the samples contradict each other: {n} values at {} places",
        samples.centres.len()
    );
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let hidden: Vec<bool> = (0..n).map(|_| generator.random::<f64>() < share).collect();
    let kept: Vec<usize> = (0..n).filter(|&k| !hidden[k]).collect();
    let rest = HexSamples {
        sensor: samples.sensor,
        centres: kept.iter().map(|&k| samples.centres[k]).collect(),
        index: kept.iter().filter_map(|&k| samples.index.get(k).copied()).collect(),
        views: samples.views,
        view_step: samples.view_step,
        weights: samples.weights.clone(),
        values: samples.values.select(Axis(1), &kept),
    };
    let image = render(&rest)?;
    ensure!(
        Error::Shape,
        image.dim() == (target.height, target.width, channels),
        "the rendered view has another size: {:?}",
        image.dim()
    );
    let map = SensorToView::new(samples.sensor, *target);
    let margin = 2.0 * mean_pitch(samples);
    let (mut sum, mut count) = (0f64, 0usize);
    let mut found = vec![0f32; channels];
    for (k, c) in samples.centres.iter().enumerate().filter(|(k, _)| hidden[*k]) {
        let inside = |x: f64, size: usize| x > margin && x < size as f64 - 1.0 - margin;
        if !(inside(c[0], samples.sensor.width) && inside(c[1], samples.sensor.height)) {
            continue;
        }
        let [x, y] = map.to_view(*c);
        bicubic_at(image.view(), x, y, &mut found);
        for (l, f) in found.iter().enumerate() {
            sum += f64::from(f - samples.values[[index, k, l]]).powi(2);
        }
        count += 1;
    }
    ensure!(Error::Shape, count > 0, "no lenslet was hidden away from the border");
    Ok(HiddenScore { psnr: -10.0 * (sum / (count * channels) as f64).max(1e-20).log10(), lenslets: count })
}
