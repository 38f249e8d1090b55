//! Patch pairs out of crops (paper section 4.4, after its ref. [22]): features of the low image and the residual high − low.

use lenslet_core::dictionary::{self, copy_windows, extract_features, pad_mirrored};
use ndarray::Array2;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

use super::twins::Twins;
use super::{Crop, Error};

/// Crops whose pairs are cut at once.
const GROUP: usize = 16;

/// Which patches are taken.
#[derive(Debug, Clone, PartialEq)]
pub struct PatchOptions {
    /// Side of the residual patch, odd.
    pub patch: usize,
    /// Side of the window whose gradients are the features, odd; the filters reach two pixels further.
    pub window: usize,
    /// Pairs a crop.
    pub per_crop: usize,
    /// Candidates drawn for each pair; those with more texture are likelier to stay.
    pub candidates: usize,
    /// Smallest norm of the features: flatter patches are left out.
    pub flat: f32,
    /// Keep pairs that hardly differ from an earlier one.
    pub twins: bool,
    /// Seed.
    pub seed: u64,
}

impl Default for PatchOptions {
    fn default() -> Self {
        PatchOptions { patch: 9, window: 9, per_crop: 1000, candidates: 3, flat: 0.05, twins: false, seed: 1 }
    }
}

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

fn check(options: &PatchOptions) -> Result<(), Error> {
    let odd = |n: usize| n % 2 == 1 && n + 4 <= dictionary::limits::SIDE;
    if !odd(options.patch) || !odd(options.window) || options.patch > options.window + 4 {
        return Err(Error::Parameter(format!(
            "patches of {} pixels in windows of {}: both must be odd, up to {}, and the patch at most 4 larger",
            options.patch,
            options.window,
            dictionary::limits::SIDE - 4
        )));
    }
    if options.candidates == 0 || options.candidates > 100 || !(options.flat >= 0.0) {
        return Err(Error::Parameter("1 to 100 candidates a pair, and a flatness of at least 0".into()));
    }
    Ok(())
}

/// Feature filters learned from windows of all crops, and the part of the gradients' energy that they keep.
///
/// # Errors
/// No crops, parameters out of range, or crops without any gradient.
pub fn learn_filters(crops: &[Crop], window: usize, features: usize) -> Result<(Array2<f32>, f64), Error> {
    check(&PatchOptions { window, patch: 1, ..PatchOptions::default() })?;
    let moments = moments(crops, window + 4, &|crop| crop.low.clone(), true);
    Ok(dictionary::learn_filters(moments.view(), window, features)?)
}

/// Filters of windows of `support` pixels for the differences between image `which` beside the low one and the low one:
/// their `features` strongest principal components, and the part of their energy that these keep.
///
/// # Errors
/// Parameters out of range, crops without that image, or without a difference.
pub fn learn_beside(
    crops: &[Crop],
    which: usize,
    support: usize,
    features: usize,
) -> Result<(Array2<f32>, f64), Error> {
    check(&PatchOptions { window: support.saturating_sub(4), patch: 1, ..PatchOptions::default() })?;
    if crops.iter().any(|c| c.beside.len() <= which) {
        return Err(Error::Parameter(format!("crops without image {which} beside the low one")));
    }
    let moments = moments(crops, support, &|crop| &crop.beside[which] - &crop.low, false);
    Ok(dictionary::learn_components(moments.view(), features)?)
}

/// Second moments of windows of the planes that `of` takes from the crops, without their means where `centred`.
fn moments(crops: &[Crop], support: usize, of: &(dyn Fn(&Crop) -> Array2<f32> + Sync), centred: bool) -> Array2<f64> {
    let n = support * support;
    // Enough windows for the moments, wherever they come from: every 9th pixel of every crop.
    let parts: Vec<Array2<f64>> = crops
        .par_iter()
        .map(|crop| {
            let padded = pad_mirrored(of(crop).view(), support / 2);
            let (h, w) = crop.low.dim();
            let corners: Vec<_> =
                (0..h).step_by(9).flat_map(|y| (0..w).step_by(9).map(move |x| (y, x))).take(4096).collect();
            let mut values = Vec::new();
            copy_windows(&padded, support, &corners, &mut values);
            // Gradients do not see the mean; without it the sums lose nothing to rounding.
            for w in values.chunks_exact_mut(if centred { n } else { usize::MAX }) {
                let mean = w.iter().sum::<f32>() / n as f32;
                w.iter_mut().for_each(|v| *v -= mean);
            }
            let values = Array2::from_shape_vec((corners.len(), n), values).unwrap_or_default();
            values.t().dot(&values).mapv(f64::from)
        })
        .collect();
    let mut moments = Array2::<f64>::zeros((n, n));
    parts.iter().for_each(|p| moments += p);
    moments
}

/// Pairs from all crops, in order of the crops, near twins left out. Memory: the pairs once, and those of a few crops.
///
/// # Errors
/// Parameters out of range.
pub fn pairs(crops: &[Crop], filters: &Array2<f32>, options: &PatchOptions) -> Result<Pairs, Error> {
    check(options)?;
    let support = options.window + 4;
    if filters.ncols() != support * support {
        return Err(Error::Parameter(format!("filters of shape {:?} for windows of {support}", filters.dim())));
    }
    let features = |crop: &Crop, centres: &[(usize, usize)]| {
        let low = pad_mirrored(crop.low.view(), support / 2);
        extract_features(&[low], support, filters, &[filters.nrows()], centres)
    };
    collect(crops, filters.nrows(), &features, options)
}

/// [`pairs`] whose features are of the low image and of the differences of those beside it: the first `shares[0]` rows of
/// `filters` (windows of `options.window` + 4 pixels) see the low image, and so on.
///
/// # Errors
/// Parameters out of range, crops that lack an image.
pub fn pairs_beside(
    crops: &[Crop],
    filters: &Array2<f32>,
    shares: &[usize],
    options: &PatchOptions,
) -> Result<Pairs, Error> {
    check(options)?;
    let support = options.window + 4;
    let fits = filters.ncols() == support * support && shares.iter().sum::<usize>() == filters.nrows();
    if !fits || shares.is_empty() || crops.iter().any(|c| c.beside.len() + 1 < shares.len()) {
        return Err(Error::Parameter(format!("filters of shape {:?} shared as {shares:?}", filters.dim())));
    }
    let features = |crop: &Crop, centres: &[(usize, usize)]| {
        let padded = |plane: &Array2<f32>| pad_mirrored(plane.view(), support / 2);
        let beside = crop.beside[..shares.len() - 1].iter().map(|b| padded(&(b - &crop.low)));
        let planes: Vec<Array2<f32>> = std::iter::once(padded(&crop.low)).chain(beside).collect();
        extract_features(&planes, support, filters, shares, centres)
    };
    collect(crops, filters.nrows(), &features, options)
}

/// Features of a crop at centres of patches.
type Features<'a> = &'a (dyn Fn(&Crop, &[(usize, usize)]) -> Array2<f32> + Sync);

fn collect(crops: &[Crop], m: usize, features_of: Features<'_>, options: &PatchOptions) -> Result<Pairs, Error> {
    let p = options.patch * options.patch;
    let most: usize = crops.iter().map(|c| options.per_crop.min(c.low.len())).sum();
    let (mut features, mut residuals) = (Vec::with_capacity(most * m), Vec::with_capacity(most * p));
    let (mut photos, mut twins) = (Vec::with_capacity(most), Twins::default());
    for (g, group) in crops.chunks(GROUP).enumerate() {
        let parts: Vec<(Array2<f32>, Array2<f32>)> = group
            .par_iter()
            .enumerate()
            .map(|(c, crop)| of_crop(crop, (g * GROUP + c) as u64, m, features_of, options))
            .collect();
        for ((f, r), crop) in parts.iter().zip(group) {
            for (f, r) in f.rows().into_iter().zip(r.rows()) {
                let (from, to) = (features.len(), residuals.len());
                features.extend(f);
                residuals.extend(r);
                if options.twins || twins.is_new(&features, &residuals, m, p) {
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

fn of_crop(
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
    // Textured patches first, but not only they: the norm times the root of a uniform deviate.
    let mut ranked: Vec<(f32, usize)> = features
        .rows()
        .into_iter()
        .enumerate()
        .map(|(n, f)| {
            let norm = f.dot(&f).sqrt();
            let luck = rng.random::<f32>().sqrt();
            (if norm > options.flat { norm * luck } else { -1.0 }, n)
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

    fn crop() -> Crop {
        let high = Array2::from_shape_fn((50, 60), |(y, x)| ((x * x + 3 * y) % 17) as f32 / 17.0);
        let low = Array2::from_shape_fn((50, 60), |(y, x)| 0.5 + 0.2 * (x as f32 * 0.4).sin() * (y as f32 * 0.3).cos());
        Crop { photo: 5, high, low, beside: Vec::new() }
    }

    #[test]
    fn a_pair_is_features_and_residual_of_one_place() {
        let crops = [crop(), crop()];
        let (filters, _) = learn_filters(&crops, 5, 6).unwrap();
        let options =
            PatchOptions { patch: 3, window: 5, per_crop: 40, flat: 0.0, twins: true, ..PatchOptions::default() };
        let pairs = pairs(&crops, &filters, &options).unwrap();
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
    fn images_beside_give_features_of_their_differences() {
        let mut crops = [crop()];
        let (low, _) = learn_filters(&crops, 5, 6).unwrap();
        let options =
            PatchOptions { patch: 3, window: 5, per_crop: 40, candidates: 1, flat: 0.0, twins: true, seed: 4 };
        assert!(learn_beside(&crops, 0, 9, 3).is_err());
        let other = crops[0].low.mapv(|v| v * v);
        crops[0].beside.push(other);
        let (beside, kept) = learn_beside(&crops, 0, 9, 3).unwrap();
        assert!(kept > 0.1 && kept <= 1.0, "{kept}");
        let both = ndarray::concatenate(ndarray::Axis(0), &[low.view(), beside.view()]).unwrap();
        let found = pairs_beside(&crops, &both, &[6, 3], &options).unwrap();
        assert_eq!(found.features.dim(), (40, 9));
        // What the image beside is looks like a low image of its own, if nothing else is seen.
        let difference = &crops[0].beside[0] - &crops[0].low;
        let alone = Crop { low: difference, ..crops[0].clone() };
        let plain = pairs(std::slice::from_ref(&alone), &beside, &options).unwrap();
        let same = |a: &ndarray::ArrayView1<'_, f32>| {
            found.features.rows().into_iter().any(|f| (&f.slice(ndarray::s![6..]) - a).iter().all(|d| d.abs() < 1e-4))
        };
        assert!(plain.features.rows().into_iter().all(|f| same(&f)));
        assert!(pairs_beside(&crops, &both, &[6, 2], &options).is_err());
        assert!(pairs_beside(&crops, &both, &[5, 3, 1], &options).is_err());
    }

    #[test]
    fn a_crop_given_twice_brings_nothing_new() {
        let crops = [crop(), crop()];
        let (filters, _) = learn_filters(&crops, 5, 6).unwrap();
        let whole =
            PatchOptions { patch: 3, window: 5, per_crop: 3000, candidates: 1, flat: 0.0, ..Default::default() };
        let count = |crops: &[Crop], twins| {
            pairs(crops, &filters, &PatchOptions { twins, ..whole.clone() }).unwrap().features.nrows()
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
        let flat = Crop { photo: 0, high: plane(0.5), low: plane(0.4), beside: Vec::new() };
        let (filters, _) = learn_filters(&[crop()], 5, 6).unwrap();
        let options = PatchOptions { patch: 3, window: 5, ..PatchOptions::default() };
        assert_eq!(pairs(std::slice::from_ref(&flat), &filters, &options).unwrap().features.nrows(), 0);
        assert!(learn_filters(&[flat], 5, 6).is_err());
        assert!(pairs(&[crop()], &filters, &PatchOptions { patch: 4, ..options.clone() }).is_err());
        assert!(pairs(&[crop()], &filters, &PatchOptions { window: 7, ..options }).is_err());
    }
}
