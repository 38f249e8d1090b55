//! Patch pairs out of crops (paper section 4.4, after its ref. [22]): features of the low image and the residual high −
//! low.

use lenslet_core::dictionary::{extract_features, pad_mirrored};
use ndarray::Array2;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

use super::crop::Crop;
use super::error::Error;
use super::near_duplicates::NearDuplicates;
use super::options::PatchOptions;

/// Crops whose pairs are cut at once.
/// Source: chosen; bounds the memory of pairs in work.
const CROPS_AT_ONCE: usize = 16;

/// Training pairs, one a row.
#[derive(Debug, Clone)]
pub struct Pairs {
    /// Features of the low image, N×m, not normalised.
    pub features: Array2<f32>,
    /// High − low, N×patch².
    pub residuals: Array2<f32>,
    /// Photo of each pair.
    pub photos: Vec<u32>,
}

/// Pairs from all crops, in order of the crops, near duplicates left out. The first `filters_per_input[0]` rows of
/// `filters` (windows of `options.window` + 4 pixels) are applied to the low image, the next `filters_per_input[1]` to
/// the difference of the first side input and the low image, and so on.
///
/// Memory: the pairs once, and those of a few crops.
///
/// # Errors
/// Parameters out of range, crops that lack a side input.
pub fn extract_pairs(
    crops: &[Crop],
    filters: &Array2<f32>,
    filters_per_input: &[usize],
    options: &PatchOptions,
) -> Result<Pairs, Error> {
    options.check()?;
    let support = options.window + 4;
    let fits = filters.ncols() == support * support && filters_per_input.iter().sum::<usize>() == filters.nrows();
    let inputs = filters_per_input.len();
    if !fits || inputs == 0 || crops.iter().any(|c| c.side_inputs.len() + 1 < inputs) {
        let shape = filters.dim();
        return Err(Error::Parameter(format!(
            "filters of shape {shape:?} for {filters_per_input:?} of {inputs} inputs"
        )));
    }
    let features = |crop: &Crop, centres: &[(usize, usize)]| {
        let padded = |plane: &Array2<f32>| pad_mirrored(plane.view(), support / 2);
        let differences = crop.side_inputs[..inputs - 1].iter().map(|side| padded(&(side - &crop.low)));
        let planes: Vec<Array2<f32>> = std::iter::once(padded(&crop.low)).chain(differences).collect();
        extract_features(&planes, support, filters, filters_per_input, centres)
    };
    collect_pairs(crops, filters.nrows(), &features, options)
}

/// Gives the features of a crop at centres (y, x) of patches, one a row.
type Features<'a> = &'a (dyn Fn(&Crop, &[(usize, usize)]) -> Array2<f32> + Sync);

fn collect_pairs(crops: &[Crop], m: usize, features_of: Features<'_>, options: &PatchOptions) -> Result<Pairs, Error> {
    let p = options.patch * options.patch;
    let most: usize = crops.iter().map(|c| options.per_crop.min(c.low.len())).sum();
    let (mut features, mut residuals) = (Vec::with_capacity(most * m), Vec::with_capacity(most * p));
    let (mut photos, mut seen) = (Vec::with_capacity(most), NearDuplicates::default());
    for (g, group) in crops.chunks(CROPS_AT_ONCE).enumerate() {
        let parts: Vec<(Array2<f32>, Array2<f32>)> = group
            .par_iter()
            .enumerate()
            .map(|(c, crop)| pairs_of_crop(crop, (g * CROPS_AT_ONCE + c) as u64, m, features_of, options))
            .collect();
        for ((f, r), crop) in parts.iter().zip(group) {
            for (f, r) in f.rows().into_iter().zip(r.rows()) {
                let (from, to) = (features.len(), residuals.len());
                features.extend(f);
                residuals.extend(r);
                if options.keep_near_duplicates || seen.is_new(&features, &residuals, m, p) {
                    photos.push(crop.photo as u32);
                } else {
                    features.truncate(from);
                    residuals.truncate(to);
                }
            }
        }
    }
    let total = photos.len();
    let shaped = |values, columns| {
        Array2::from_shape_vec((total, columns), values).map_err(|e| Error::Parameter(format!("pairs: {e}")))
    };
    Ok(Pairs { features: shaped(features, m)?, residuals: shaped(residuals, p)?, photos })
}

fn pairs_of_crop(
    crop: &Crop,
    stream: u64,
    m: usize,
    features_of: Features<'_>,
    options: &PatchOptions,
) -> (Array2<f32>, Array2<f32>) {
    let (h, w) = crop.low.dim();
    let (p, r) = (options.patch, options.patch / 2);
    if h < p || w < p {
        return (Array2::zeros((0, m)), Array2::zeros((0, p * p)));
    }
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    rng.set_stream((1 << 63) | stream);
    let count = (options.per_crop * options.candidates).min(h * w);
    let centres: Vec<(usize, usize)> =
        (0..count).map(|_| (rng.random_range(r..h - r), rng.random_range(r..w - r))).collect();
    let features = features_of(crop, &centres);
    // Patches with more texture are likelier: ranked by the norm times the root of a uniform deviate.
    let mut ranked: Vec<(f32, usize)> = features
        .rows()
        .into_iter()
        .enumerate()
        .map(|(n, f)| {
            let norm = f.dot(&f).sqrt();
            let chance = rng.random::<f32>().sqrt();
            (if norm > options.min_norm { norm * chance } else { -1.0 }, n)
        })
        .filter(|(rank, _)| *rank >= 0.0)
        .collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    ranked.truncate(options.per_crop);
    let kept: Vec<usize> = ranked.into_iter().map(|(_, n)| n).collect();
    let mut residuals = Array2::zeros((kept.len(), p * p));
    for (mut row, &n) in residuals.rows_mut().into_iter().zip(&kept) {
        let (y, x) = centres[n];
        for (i, v) in row.iter_mut().enumerate() {
            let at = [y + i / p - r, x + i % p - r];
            *v = crop.high[at] - crop.low[at];
        }
    }
    (features.select(ndarray::Axis(0), &kept), residuals)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pairs::{learn_difference_filters, learn_filters};

    fn crop() -> Crop {
        let high = Array2::from_shape_fn((50, 60), |(y, x)| ((x * x + 3 * y) % 17) as f32 / 17.0);
        let low = Array2::from_shape_fn((50, 60), |(y, x)| 0.5 + 0.2 * (x as f32 * 0.4).sin() * (y as f32 * 0.3).cos());
        Crop { photo: 5, high, low, side_inputs: Vec::new() }
    }

    #[test]
    fn a_pair_is_features_and_residual_of_one_place() {
        let crops = [crop(), crop()];
        let (filters, _) = learn_filters(&crops, 5, 6).unwrap();
        let options = PatchOptions {
            patch: 3,
            window: 5,
            per_crop: 40,
            min_norm: 0.0,
            keep_near_duplicates: true,
            ..PatchOptions::default()
        };
        let pairs = extract_pairs(&crops, &filters, &[filters.nrows()], &options).unwrap();
        assert_eq!(pairs.features.dim(), (80, 6));
        assert!(pairs.photos.iter().all(|p| *p == 5));
        // Each pair is found by brute force at some place of the crop.
        let c = crop();
        let padded = pad_mirrored(c.low.view(), 4);
        for n in (0..80).step_by(7) {
            let mut found = false;
            for y in 1..49 {
                for x in 1..59 {
                    let same = (0..9).all(|i| {
                        let at = [y + i / 3 - 1, x + i % 3 - 1];
                        (pairs.residuals[[n, i]] - (c.high[at] - c.low[at])).abs() < 1e-6
                    });
                    let plain =
                        |f: usize| -> f32 { (0..81).map(|j| filters[[f, j]] * padded[[y + j / 9, x + j % 9]]).sum() };
                    found |= same && (0..6).all(|f| (plain(f) - pairs.features[[n, f]]).abs() < 1e-4);
                }
            }
            assert!(found, "pair {n}");
        }
    }

    #[test]
    fn side_inputs_give_features_of_their_differences() {
        let mut crops = [crop()];
        let (low, _) = learn_filters(&crops, 5, 6).unwrap();
        let options = PatchOptions {
            patch: 3,
            window: 5,
            per_crop: 40,
            candidates: 1,
            min_norm: 0.0,
            keep_near_duplicates: true,
            seed: 4,
        };
        assert!(learn_difference_filters(&crops, 0, 9, 3).is_err());
        let other = crops[0].low.mapv(|v| v * v);
        crops[0].side_inputs.push(other);
        let (beside, kept) = learn_difference_filters(&crops, 0, 9, 3).unwrap();
        assert!(kept > 0.1 && kept <= 1.0, "{kept}");
        let both = ndarray::concatenate(ndarray::Axis(0), &[low.view(), beside.view()]).unwrap();
        let found = extract_pairs(&crops, &both, &[6, 3], &options).unwrap();
        assert_eq!(found.features.dim(), (40, 9));
        // The difference to the side input, taken as the low image of another crop, gives the same features.
        let difference = &crops[0].side_inputs[0] - &crops[0].low;
        let alone = Crop { low: difference, ..crops[0].clone() };
        let plain = extract_pairs(std::slice::from_ref(&alone), &beside, &[beside.nrows()], &options).unwrap();
        let same = |a: &ndarray::ArrayView1<'_, f32>| {
            found.features.rows().into_iter().any(|f| (&f.slice(ndarray::s![6..]) - a).iter().all(|d| d.abs() < 1e-4))
        };
        assert!(plain.features.rows().into_iter().all(|f| same(&f)));
        assert!(extract_pairs(&crops, &both, &[6, 2], &options).is_err());
        assert!(extract_pairs(&crops, &both, &[5, 3, 1], &options).is_err());
    }

    #[test]
    fn a_crop_given_twice_brings_nothing_new() {
        let crops = [crop(), crop()];
        let (filters, _) = learn_filters(&crops, 5, 6).unwrap();
        let whole =
            PatchOptions { patch: 3, window: 5, per_crop: 3000, candidates: 1, min_norm: 0.0, ..Default::default() };
        let count = |crops: &[Crop], twins| {
            extract_pairs(
                crops,
                &filters,
                &[filters.nrows()],
                &PatchOptions { keep_near_duplicates: twins, ..whole.clone() },
            )
            .unwrap()
            .features
            .nrows()
        };
        let (once, twice) = (count(&crops[..1], false), count(&crops, false));
        // Places are drawn with repetition: of 3000 draws among 48 times 58 places about 63 in a hundred differ.
        assert!(once > 1000 && once < 2200, "{once}");
        assert!(twice as f64 <= 1.45 * once as f64 && twice >= once, "{once} {twice}");
        assert_eq!(count(&crops, true), 6000);
    }

    #[test]
    fn flat_patches_are_left_out_and_sizes_checked() {
        let plane = |v: f32| Array2::from_elem((30, 30), v);
        let flat = Crop { photo: 0, high: plane(0.5), low: plane(0.4), side_inputs: Vec::new() };
        let (filters, _) = learn_filters(&[crop()], 5, 6).unwrap();
        let options = PatchOptions { patch: 3, window: 5, ..PatchOptions::default() };
        assert_eq!(
            extract_pairs(std::slice::from_ref(&flat), &filters, &[filters.nrows()], &options)
                .unwrap()
                .features
                .nrows(),
            0
        );
        assert!(learn_filters(&[flat], 5, 6).is_err());
        assert!(
            extract_pairs(&[crop()], &filters, &[filters.nrows()], &PatchOptions { patch: 4, ..options.clone() })
                .is_err()
        );
        assert!(
            extract_pairs(&[crop()], &filters, &[filters.nrows()], &PatchOptions { window: 7, ..options }).is_err()
        );
    }
}
