//! Crops of results and of their differences from the truth, as small PNG files.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result};
use lenslet_data_gen::simulate::{Kind, Region};
use ndarray::{Array3, s};

use super::scores::encoded;
use crate::report::Picture;
use crate::report::picture::difference;

/// Side of a crop, pixels.
const SIDE: usize = 140;
/// How much differences are enlarged.
pub(super) const GAIN: f32 = 6.0;

/// Where a scene is looked at closely: the upper left corner of the crop. On the chart the line pairs next to the middle.
pub(super) fn place(kind: Kind, regions: &[Region], size: (usize, usize)) -> (usize, usize) {
    let middle = |r: &Region| ((r.bounds[0] + r.bounds[2]) / 2.0, (r.bounds[1] + r.bounds[3]) / 2.0);
    let distance = |r: &&Region| {
        let (x, y) = middle(r);
        (x - 0.5).hypot(y - 0.5)
    };
    let lines = regions.iter().filter(|r| r.kind == "lines" && r.frequency.is_some_and(|f| f > 0.3 && f < 0.4));
    let at = match kind {
        Kind::Chart => lines.min_by(|a, b| distance(a).total_cmp(&distance(b))).map(middle),
        _ => None,
    };
    let (x, y) = at.unwrap_or((0.5, 0.5));
    let corner =
        |share: f64, n: usize| ((share * n as f64) as usize).saturating_sub(SIDE / 2).min(n.saturating_sub(SIDE));
    (corner(x, size.0), corner(y, size.1))
}

/// Writes the crop, its difference from the truth, and the truth; names by what they show. `image` linear, `truth` encoded.
pub(super) fn save(
    out: &Path,
    key: &str,
    image: &Array3<f32>,
    truth: &Array3<f32>,
    (left, top): (usize, usize),
) -> Result<BTreeMap<String, String>> {
    let (height, width, _) = truth.dim();
    let window = s![top..(top + SIDE).min(height), left..(left + SIDE).min(width), ..];
    let (image, truth) = (encoded(image).slice(window).to_owned(), truth.slice(window).to_owned());
    let difference = difference(&image, &truth, GAIN);
    let mut names = BTreeMap::new();
    for (what, picture) in [("crop", &image), ("difference", &difference), ("truth", &truth)] {
        let name = format!("pictures/{key}-{what}.png");
        fs::write(out.join(&name), Picture::png(picture, 1)?.bytes).with_context(|| format!("cannot write {name}"))?;
        names.insert(what.to_owned(), name);
    }
    Ok(names)
}
