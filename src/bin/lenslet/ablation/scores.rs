//! Scores of rendered views: against the truth, on the chart's edges and lines, and of lenslet centres.

use std::collections::{BTreeMap, HashMap};

use anyhow::Result;
use lenslet_core::colour::luminance;
use lenslet_core::lightfield::{ColourSpace, colour};
use lenslet_core::metrics::{self, BORDER, Window};
use lenslet_data_gen::simulate::Region;
use ndarray::{Array2, Array3, ArrayView2, s};

/// Scores by name.
type Scores = BTreeMap<String, f64>;

/// sRGB-encoded and clamped, as it is displayed.
pub(super) fn encoded(linear: &Array3<f32>) -> Array3<f32> {
    let mut view = linear.clone();
    colour::convert(&mut view, ColourSpace::Linear, ColourSpace::Srgb);
    view.mapv_inplace(|x| x.clamp(0.0, 1.0));
    view
}

/// PSNR and SSIM of the first image (the middle view), PSNR of the others; images linear, truths sRGB-encoded.
pub(super) fn score_against_truth(images: &[Array3<f32>], truths: &[Array3<f32>], scores: &mut Scores) -> Result<()> {
    let mut outer = Vec::new();
    for (k, (image, truth)) in images.iter().zip(truths).enumerate() {
        let image = encoded(image);
        let window = Window::without_border(BORDER);
        if k > 0 {
            outer.push(metrics::psnr(window.crop(image.view())?, window.crop(truth.view())?)?);
            continue;
        }
        let middle = metrics::Scores::between(image.view(), truth.view(), &window)?;
        scores.insert("psnr".into(), middle.psnr_rgb);
        scores.insert("psnr_y".into(), middle.psnr_y);
        scores.insert("ssim".into(), middle.ssim_y);
    }
    if !outer.is_empty() {
        scores.insert("psnr_outer".into(), outer.iter().sum::<f64>() / outer.len() as f64);
    }
    Ok(())
}

/// How well the second image agrees with the first, `steps` (u, v) away.
pub(super) fn score_agreement(
    images: &[Array3<f32>],
    disparity: &Array2<f32>,
    steps: (f64, f64),
    scores: &mut Scores,
) -> Result<()> {
    if let [centre, other, ..] = images {
        // Beyond the border something else may come into view.
        let border = BORDER + (steps.0.abs().max(steps.1.abs()) * 4.0) as usize;
        let (a, b) = (encoded(centre), encoded(other));
        scores.insert(
            "consistency".into(),
            metrics::view_consistency(a.view(), b.view(), disparity.view(), steps, border)?,
        );
    }
    Ok(())
}

/// Sharpness, jaggedness, and contrast of line pairs on the chart; in linear light. `pitch`: output pixels a lenslet.
pub(super) fn score_chart(
    image: &Array3<f32>,
    truth: &Array3<f32>,
    regions: &[Region],
    pitch: f64,
    scores: &mut Scores,
) {
    let mut truth = truth.clone();
    colour::convert(&mut truth, ColourSpace::Srgb, ColourSpace::Linear);
    let (image, truth) = (luminance(image.view()), luminance(truth.view()));
    let mut sums: BTreeMap<String, (f64, f64)> = BTreeMap::new();
    let mut add = |name: String, value: f64| {
        if value.is_finite() {
            let sum = sums.entry(name).or_default();
            *sum = (sum.0 + value, sum.1 + 1.0);
        }
    };
    for region in regions {
        let (Some(a), Some(b)) = (window(&image, region), window(&truth, region)) else { continue };
        match region.kind.as_str() {
            "edge" => {
                let across = region.angle.is_some_and(|angle| angle.sin().abs() > 0.7);
                let turned = |w: ArrayView2<f32>| if across { w.reversed_axes().to_owned() } else { w.to_owned() };
                if let Some(edge) = metrics::slanted_edge(turned(a).view()) {
                    add("mtf50".into(), edge.mtf50 * pitch);
                    add("jaggedness".into(), edge.jaggedness);
                }
                if let Some(edge) = metrics::slanted_edge(turned(b).view()) {
                    add("mtf50_truth".into(), edge.mtf50 * pitch);
                }
            }
            "lines" => {
                if let (Some(p), Some(frequency)) = (metrics::pattern_contrast(a, b), region.frequency) {
                    add("line_contrast".into(), p.contrast);
                    add("spurious".into(), p.spurious);
                    add(format!("line_contrast_{frequency:.2}"), p.contrast);
                    add(format!("spurious_{frequency:.2}"), p.spurious);
                }
            }
            _ => {}
        }
    }
    scores.extend(sums.into_iter().map(|(name, (sum, n))| (name, sum / n)));
}

/// The region's part of a picture; None unless it lies inside the border and has some size.
fn window<'a>(picture: &'a Array2<f32>, region: &Region) -> Option<ArrayView2<'a, f32>> {
    let (height, width) = picture.dim();
    let [left, top, right, bottom] = region.bounds;
    let at = |share: f64, n: usize| share * n as f64 - 0.5;
    let (s0, s1) = (at(left, width).ceil(), at(right, width).floor());
    let (t0, t1) = (at(top, height).ceil(), at(bottom, height).floor());
    let border = BORDER as f64;
    let inside = s0 >= border && t0 >= border && s1 < width as f64 - border && t1 < height as f64 - border;
    if !(inside && s1 >= s0 + 3.0 && t1 >= t0 + 3.0) {
        return None;
    }
    Some(picture.slice(s![t0 as usize..=t1 as usize, s0 as usize..=s1 as usize]))
}

/// RMS distance of `found` from the nearest of `truth`, pixels, both inside the sensor; NaN when there is none.
pub(super) fn centres_rms(found: &[[f64; 2]], truth: &[[f64; 2]]) -> f64 {
    const CELL: f64 = 16.0;
    let cell = |p: &[f64; 2]| ((p[0] / CELL).floor() as i64, (p[1] / CELL).floor() as i64);
    let mut cells: HashMap<(i64, i64), Vec<&[f64; 2]>> = HashMap::new();
    for p in truth {
        cells.entry(cell(p)).or_default().push(p);
    }
    let (mut sum, mut n) = (0.0, 0usize);
    for p in found {
        let (i, j) = cell(p);
        let near = (-1..=1).flat_map(|a| (-1..=1).map(move |b| (i + a, j + b))).filter_map(|c| cells.get(&c)).flatten();
        let squared = near.map(|q| (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2)).fold(f64::INFINITY, f64::min);
        if squared.is_finite() {
            sum += squared;
            n += 1;
        }
    }
    (sum / n as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_to_the_nearest_centre() {
        let truth: Vec<[f64; 2]> = (0..400).map(|k| [10.0 * f64::from(k % 20), 10.0 * f64::from(k / 20)]).collect();
        let found: Vec<[f64; 2]> = truth.iter().map(|p| [p[0] + 3.0, p[1] - 4.0]).collect();
        assert!((centres_rms(&found, &truth) - 5.0).abs() < 1e-9);
        assert!(centres_rms(&[], &truth).is_nan());
    }

    #[test]
    fn truth_scores_perfectly_and_blur_does_not() {
        // Lines of 8 pixels a pair in one region, an edge in another.
        let picture = Array3::from_shape_fn((120, 120, 3), |(t, s, _)| {
            if t < 60 {
                if (s / 4) % 2 == 0 { 0.1f32 } else { 0.8 }
            } else {
                ((s as f32 - 60.0 - 0.08 * t as f32) * 0.5).clamp(0.1, 0.8)
            }
        });
        let region = |kind: &str, bounds, frequency| Region {
            kind: kind.into(),
            bounds,
            frequency,
            angle: Some(0.0),
            colour: None,
            levels: None,
        };
        let regions = [region("lines", [0.2, 0.2, 0.8, 0.45], Some(0.4)), region("edge", [0.3, 0.55, 0.8, 0.88], None)];
        let truth = encoded(&picture);
        let mut scores = Scores::new();
        score_chart(&picture, &truth, &regions, 3.3, &mut scores);
        assert!((scores["line_contrast"] - 1.0).abs() < 1e-3 && scores["spurious_0.40"] < 1e-2, "{scores:?}");
        assert!((scores["mtf50"] - scores["mtf50_truth"]).abs() < 1e-3);
        let blurred = Array3::from_shape_fn((120, 120, 3), |(t, s, c)| {
            (0..5).map(|k| picture[[t, (s + k).saturating_sub(2).min(119), c]]).sum::<f32>() / 5.0
        });
        let mut worse = Scores::new();
        score_chart(&blurred, &truth, &regions, 3.3, &mut worse);
        score_against_truth(&[blurred], &[truth], &mut worse).unwrap();
        assert!(worse["line_contrast"] < 0.7 && worse["mtf50"] < scores["mtf50"] && worse["psnr"] < 30.0, "{worse:?}");
    }
}
