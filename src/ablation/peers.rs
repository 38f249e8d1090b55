//! Light fields decoded by other tools, scored as kindly as possible: registered onto the truth by an affine map found on the
//! middle view, gain and offset of each channel matched, the alignment reported.

use std::path::Path;

use anyhow::{Context as _, Result};
use lenslet_core::lightfield::{self, ColourSpace, ReadOptions, ViewSource, colour};
use lenslet_core::metrics::align;
use ndarray::Array3;

use super::record::Scored;
use super::scores::BORDER;
use super::{Run, Settings, picture};

/// Scores the peer's middle view.
pub(super) fn score(name: &str, path: &Path, settings: &Settings, out: &Path, run: &Run) -> Result<Scored> {
    let truth = settings.truth.as_ref().context("peers are scored on a truth: name its light field with --truth")?;
    let peer = lightfield::open(path, &ReadOptions::default())?;
    let truth = lightfield::open(truth, &ReadOptions::default())?;
    let (a, b) = (middle(peer.as_ref())?, middle(truth.as_ref())?);
    let alignment = align::register(a.view(), b.view()).with_context(|| format!("cannot align {name}"))?;
    let (height, width, _) = b.dim();
    let mut moved = align::aligned(a.view(), &alignment, (height, width));
    moved.mapv_inplace(|x| x.clamp(0.0, 1.0));
    // Where the peer's view ends is not known to a pixel, so the border is wide.
    let border = (5 * BORDER).min(height.min(width) / 4);
    let mut scored = Scored { notes: Some(serde_json::json!({"alignment": alignment})), ..Scored::default() };
    let cut = |v: &Array3<f32>| lenslet_core::metrics::inner(&v.view(), border).map(|v| v.to_owned());
    let (x, y) = (cut(&moved).context("views are too small")?, cut(&b).context("views are too small")?);
    let (lx, ly) = (lenslet_core::metrics::luminance(x.view()), lenslet_core::metrics::luminance(y.view()));
    use lenslet_core::metrics::{Window, psnr, ssim};
    scored.scores.insert("psnr".into(), psnr(x.view().into_dyn(), y.view().into_dyn())?);
    scored.scores.insert("psnr_y".into(), psnr(lx.view().into_dyn(), ly.view().into_dyn())?);
    scored.scores.insert("ssim".into(), ssim(lx.view(), ly.view(), Window::Gaussian)?);
    if b.dim().2 == 3 {
        let mut linear = moved;
        colour::convert(&mut linear, ColourSpace::Srgb, ColourSpace::Linear);
        scored.pictures = picture::save(
            out,
            &run.key(),
            &linear,
            &b,
            ((width / 2).saturating_sub(70), (height / 2).saturating_sub(70)),
        )?;
    }
    Ok(scored)
}

/// The middle view, sRGB-encoded.
fn middle(source: &dyn ViewSource) -> Result<Array3<f32>> {
    let [rows, columns] = source.meta().views;
    let mut view = source.read(rows / 2, columns / 2)?;
    colour::convert(&mut view, source.meta().colour, ColourSpace::Srgb);
    Ok(view)
}
