//! Crops of results and of their differences from the truth, as small PNG files.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use lenslet_core::container::RawMosaic;
use lenslet_core::geometry::Size;
use lenslet_core::output;
use lenslet_data_gen::simulate::Region;
use ndarray::{Array3, s};

use super::scores::encoded;
use crate::report::EmbeddedPicture;
use crate::report::embedded::{difference_map, most_detailed_place};

/// Side of a crop, pixels.
/// Source: chosen.
const SIDE: usize = 140;
/// How much differences are amplified.
/// Source: chosen.
pub(super) const GAIN: f32 = 6.0;

/// Upper left corner of the crop that is shown of a scene. On the chart the line pairs next to the middle.
pub(super) fn corner_in_scene(chart: bool, regions: &[Region], size: Size) -> (usize, usize) {
    let middle = |r: &Region| [(r.bounds[0] + r.bounds[2]) / 2.0, (r.bounds[1] + r.bounds[3]) / 2.0];
    let distance = |r: &&Region| {
        let [x, y] = middle(r);
        (x - 0.5).hypot(y - 0.5)
    };
    let lines = regions.iter().filter(|r| r.kind == "lines" && r.frequency.is_some_and(|f| f > 0.3 && f < 0.4));
    let at = if chart { lines.min_by(|a, b| distance(a).total_cmp(&distance(b))).map(middle) } else { None };
    corner(at.unwrap_or([0.5, 0.5]), size)
}

/// Upper left corner of the crop of a view of `size` of a real capture: where its raw mosaic has most detail, so that
/// all variants show the same place.
pub(super) fn corner_in_capture(mosaic: &RawMosaic, size: Size) -> (usize, usize) {
    // Means of squares that hold some micro-images each.
    const SQUARE: usize = 20;
    let (width, height) = (mosaic.width / SQUARE, mosaic.height / SQUARE);
    let means = Array3::from_shape_fn((height, width, 1), |(t, s, _)| {
        let row = |y: usize| &mosaic.data[y * mosaic.width + s * SQUARE..][..SQUARE];
        (t * SQUARE..(t + 1) * SQUARE).flat_map(row).map(|&x| f32::from(x)).sum::<f32>()
    });
    corner(most_detailed_place(&means, SIDE * width / size.width.max(1)), size)
}

fn corner(at: [f64; 2], size: Size) -> (usize, usize) {
    let one = |share: f64, n: usize| ((share * n as f64) as usize).saturating_sub(SIDE / 2).min(n.saturating_sub(SIDE));
    (one(at[0], size.width), one(at[1], size.height))
}

/// Writes the crop and, where there is a truth, the crop's difference from it, and the truth; names by what they show.
/// `image` linear, `truth` encoded.
pub(super) fn save_crops(
    out: &Path,
    key: &str,
    image: &Array3<f32>,
    truth: Option<&Array3<f32>>,
    (left, top): (usize, usize),
) -> Result<BTreeMap<String, String>> {
    let (height, width, _) = image.dim();
    let window = s![top..(top + SIDE).min(height), left..(left + SIDE).min(width), ..];
    let image = encoded(image).slice(window).to_owned();
    let mut names = BTreeMap::new();
    let mut write = |what: &str, picture: &Array3<f32>| -> Result<()> {
        let name = format!("pictures/{key}-{what}.png");
        output::replace_listed(out, &name, &EmbeddedPicture::png(picture, 1)?.bytes)?;
        names.insert(what.to_owned(), name);
        Ok(())
    };
    write("crop", &image)?;
    if let Some(truth) = truth {
        let truth = truth.slice(window).to_owned();
        write("difference", &difference_map(&image, &truth, GAIN))?;
        write("truth", &truth)?;
    }
    Ok(names)
}
