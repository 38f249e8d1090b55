//! Photos to crops: those that train, and those held out for scores.

use std::path::PathBuf;

use lenslet_core::dictionary::{Footprint, Photo};
use lenslet_core::lightfield::ColourSpace;
use lenslet_core::progress::Observer;
use lenslet_data_gen::pairs::{Crop, CropOptions, cut_crops};
use lenslet_data_gen::photo::{LEAST_SIDE, LuminancePhoto, PhotoSet};
use ndarray::{ArrayView2, Axis};

use crate::error::Error;
use crate::parameters::Parameters;

/// Crops of the last photo that are kept for scores, where it is the one held out.
/// Source: chosen.
const MOST_OF_LAST: usize = 6;

/// Which crops are kept for scores.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Split {
    /// None.
    Nothing,
    /// One crop of every n-th photo.
    Every(usize),
    /// Those of the last photo: there are fewer than n.
    Last,
    /// Those of a quarter of each photo: there are fewer than four.
    Within,
}

impl Split {
    fn of(files: usize, every: usize) -> Split {
        match (every, files) {
            (0, _) => Split::Nothing,
            (n, f) if f >= n => Split::Every(n),
            (_, f) if f >= 4 => Split::Last,
            _ => Split::Within,
        }
    }
}

/// The first three quarters of a photo along its longer side, and the rest where it is large enough for crops.
fn cut_apart(photo: &LuminancePhoto) -> (LuminancePhoto, Option<LuminancePhoto>) {
    let (h, w) = photo.luminance.dim();
    let axis = Axis(usize::from(w > h));
    let long = h.max(w);
    let at = long - long / 4;
    if (long / 4).min(h.min(w)) < LEAST_SIDE {
        return (photo.clone(), None);
    }
    let (most, rest) = photo.luminance.view().split_at(axis, at);
    let part = |plane: ArrayView2<'_, f32>| LuminancePhoto { luminance: plane.to_owned(), ..photo.clone() };
    (part(most), Some(part(rest)))
}

/// Crops of one footprint.
#[derive(Debug, Clone)]
pub struct TrainingCrops {
    /// Crops that train.
    pub train: Vec<Crop>,
    /// Crops that do not; none of them shows what a training crop shows.
    pub held_out: Vec<Crop>,
    /// The photos used.
    pub photos: Vec<Photo>,
    /// The photos left out, and why.
    pub skipped: Vec<String>,
}

/// Reads the photos and cuts crops, some of them held out of training: one of every n-th photo; where there are fewer
/// photos those of the last one; of one to three photos a quarter each. A photo that cannot be used is noted and left
/// out. One photo is in memory at a time.
///
/// # Errors
/// When no photo is left, or paths or parameters are wrong.
pub fn cut_training_crops(
    inputs: &[PathBuf],
    parameters: &Parameters,
    footprint: Footprint,
    observer: &dyn Observer,
) -> Result<TrainingCrops, Error> {
    let p = &parameters.pairs;
    let encoding = if p.linear_light { ColourSpace::Linear } else { ColourSpace::Srgb };
    let photos = PhotoSet::find(inputs, encoding)?;
    let options = CropOptions {
        size: p.crop,
        shrink: p.shrink,
        degradation: parameters.degradation.for_footprint(footprint),
        seed: parameters.seed,
    };
    let mut crops = TrainingCrops { train: Vec::new(), held_out: Vec::new(), photos: Vec::new(), skipped: Vec::new() };
    let split = Split::of(photos.len(), p.held_out);
    let report = photos.for_each(observer, |index, _, photo| {
        match split {
            Split::Every(n) if index % n == n - 1 => crops.held_out.extend(cut_crops(photo, index, 1, &options)?),
            Split::Within => {
                let (most, rest) = cut_apart(photo);
                crops.train.extend(cut_crops(&most, index, p.crops, &options)?);
                if let Some(rest) = rest {
                    crops.held_out.extend(cut_crops(&rest, index, 2, &options)?);
                }
            }
            _ => crops.train.extend(cut_crops(photo, index, p.crops, &options)?),
        }
        Ok::<(), Error>(())
    })?;
    (crops.photos, crops.skipped) = (report.used, report.skipped);
    if split == Split::Last && crops.photos.len() > 1 {
        let last = crops.photos.len() - 1;
        let (kept, mut held_out): (Vec<Crop>, Vec<Crop>) = crops.train.into_iter().partition(|c| c.photo != last);
        held_out.truncate(MOST_OF_LAST);
        (crops.train, crops.held_out) = (kept, held_out);
    }
    Ok(crops)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::PairParameters;
    use lenslet_core::progress::Silent;

    fn photos(folder: &std::path::Path, count: u32) -> Vec<PathBuf> {
        let save = |n: u32| {
            let path = folder.join(format!("{n}.png"));
            // The grey value encodes the column, from which the place of a crop follows.
            image::GrayImage::from_fn(400, 100, |x, y| image::Luma([(x / 2) as u8 + (y % 3) as u8]))
                .save(&path)
                .unwrap();
            path
        };
        (0..count).map(save).collect()
    }

    fn gathered(count: u32, held_out: usize) -> TrainingCrops {
        let folder = tempfile::tempdir().unwrap();
        let pairs = PairParameters { held_out, crop: 40, crops: 9, shrink: 1.0, ..PairParameters::default() };
        let parameters = Parameters { pairs, ..Parameters::default() };
        cut_training_crops(&photos(folder.path(), count), &parameters, Footprint::Point, &Silent).unwrap()
    }

    #[test]
    fn some_crops_are_held_out_of_any_number_of_photos() {
        for (count, train, held_out) in [(9, 8, 1), (8, 7, 1), (7, 6, 6), (4, 3, 6), (3, 3, 6), (1, 1, 2)] {
            let data = gathered(count, 8);
            assert_eq!((data.train.len(), data.held_out.len()), (9 * train, held_out), "{count} photos");
            if count >= 4 {
                assert!(data.held_out.iter().all(|h| data.train.iter().all(|t| t.photo != h.photo)));
            }
        }
        assert_eq!(gathered(3, 0).held_out.len(), 0);
    }

    #[test]
    fn parts_of_one_photo_do_not_overlap() {
        let data = gathered(2, 8);
        let bright = |c: &Crop| c.high.iter().copied().fold(0.0, f32::max);
        let dark = |c: &Crop| c.high.iter().copied().fold(1.0, f32::min);
        // Columns up to 299 train, of grey values up to 149 + 2; the border of a crop is cut off.
        assert!(data.train.iter().all(|c| bright(c) <= 151.0 / 255.0 + 1e-3));
        assert!(data.held_out.iter().all(|c| dark(c) >= 150.0 / 255.0 - 1e-3));
    }
}
