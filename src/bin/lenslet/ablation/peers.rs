//! Light fields decoded by other tools, scored after registration: an affine map onto the truth estimated on the middle
//! view, gain and offset of each channel matched, the alignment reported.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context as _, Result};
use lenslet_core::geometry::Size;
use lenslet_core::lightfield::{self, ColourSpace, ReadOptions, ViewSource, colour};
use lenslet_core::metrics::{Alignment, BORDER, Scores, Window};
use ndarray::Array3;

use super::crops;
use super::matrix::Run;
use super::record::Scored;
use super::settings::Settings;

/// Scores the peer's middle view.
pub(super) fn score_peer(name: &str, path: &Path, settings: &Settings, out: &Path, run: &Run) -> Result<Scored> {
    let truth = settings.truth.as_ref().context("peers are scored on a truth: name its light field with --truth")?;
    let peer = lightfield::open(path, &ReadOptions::default())?;
    let truth = lightfield::open(truth, &ReadOptions::default())?;
    let (a, b) = (middle(peer.as_ref())?, middle(truth.as_ref())?);
    let alignment = Alignment::estimate(a.view(), b.view()).with_context(|| format!("cannot align {name}"))?;
    let (height, width, _) = b.dim();
    let mut moved = alignment.apply(a.view(), Size::new(width, height));
    moved.mapv_inplace(|x| x.clamp(0.0, 1.0));
    // Where the peer's view ends is not known to a pixel, so the border is wide.
    let border = (5 * BORDER).min(height.min(width) / 4);
    let mut scored = Scored { notes: Some(serde_json::json!({"alignment": alignment})), ..Scored::default() };
    let found = Scores::between(moved.view(), b.view(), &Window::without_border(border))?;
    scored.scores.insert("psnr".into(), found.psnr_rgb);
    scored.scores.insert("psnr_y".into(), found.psnr_y);
    scored.scores.insert("ssim".into(), found.ssim_y);
    moves(&alignment, (a.dim().0, a.dim().1), (height, width), &mut scored.scores);
    if b.dim().2 == 3 {
        let mut linear = moved;
        colour::convert(&mut linear, ColourSpace::Srgb, ColourSpace::Linear);
        scored.pictures = crops::save_crops(
            out,
            &run.key(),
            &linear,
            Some(&b),
            ((width / 2).saturating_sub(70), (height / 2).saturating_sub(70)),
        )?;
    }
    Ok(scored)
}

/// The alignment in three numbers; all of it is in the record's notes. Sizes are (height, width) of result and truth.
fn moves(alignment: &Alignment, from: (usize, usize), to: (usize, usize), scores: &mut BTreeMap<String, f64>) {
    let [a, b, c, d, e, f] = alignment.affine;
    // The same field of view: as many result pixels a pixel of the truth.
    let (ratio_x, ratio_y) = (from.1 as f64 / to.1 as f64, from.0 as f64 / to.0 as f64);
    let middle = |n: usize| (n as f64 - 1.0) / 2.0;
    let (x, y) = (middle(to.1), middle(to.0));
    let off_x = (a * x + b * y + c - middle(from.1)) / ratio_x;
    let off_y = (d * x + e * y + f - middle(from.0)) / ratio_y;
    scores.insert("align_px".into(), off_x.hypot(off_y));
    scores.insert("align_scale".into(), (ratio_x * ratio_y / (a * e - b * d).abs()).sqrt());
    let gains: f64 = alignment.gain.iter().map(|[gain, _]| gain).sum();
    scores.insert("align_gain".into(), gains / alignment.gain.len().max(1) as f64);
}

/// The middle view, sRGB-encoded.
fn middle(source: &dyn ViewSource) -> Result<Array3<f32>> {
    let [rows, columns] = source.meta().views;
    let mut view = source.read(rows / 2, columns / 2)?;
    colour::convert(&mut view, source.meta().colour, ColourSpace::Srgb);
    Ok(view)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_alignment_in_numbers() {
        // A result of half the size, of which the truth shows the part from x = 4 on, at 1.25 times the scale.
        let ratio = 0.5 / 1.25;
        let affine = [ratio, 0.0, 4.0 + 49.5 - ratio * 99.5, 0.0, ratio, 29.5 - ratio * 59.5];
        let alignment = Alignment { affine, gain: vec![[1.5, 0.0], [0.5, 0.1]] };
        let mut scores = BTreeMap::new();
        moves(&alignment, (60, 100), (120, 200), &mut scores);
        assert!((scores["align_px"] - 8.0).abs() < 1e-9, "{scores:?}");
        assert!((scores["align_scale"] - 1.25).abs() < 1e-9 && (scores["align_gain"] - 1.0).abs() < 1e-9, "{scores:?}");
    }
}
