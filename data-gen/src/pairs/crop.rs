//! Crops of a photo with their low images.

use lenslet_core::dictionary::Footprint;
use lenslet_core::metrics::BORDER;
use ndarray::{Array2, Axis, s};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

use super::degradation::{Degradation, degrade_plane};
use super::error::Error;
use crate::photo::{self, LEAST_SIDE, LuminancePhoto, ReductionKernel, reduce_plane};

/// A sharp crop and what the camera and plain interpolation make of it, of one shape (rows, columns).
#[derive(Debug, Clone)]
pub struct Crop {
    /// Number of the photo among those used.
    pub photo: usize,
    /// The sharp luminance.
    pub high: Array2<f32>,
    /// The low image.
    pub low: Array2<f32>,
    /// Side inputs of a network: other images of the same view, of the same shape; usually none.
    pub side_inputs: Vec<Array2<f32>>,
}

/// The longest side up to `n` that a rectangular grid divides into whole samples; hexagonal lattices take any.
fn whole_samples(n: usize, degradation: &Degradation) -> usize {
    match degradation.footprint {
        Footprint::Grid => ((n as f64 / degradation.pitch).floor() * degradation.pitch).round() as usize,
        _ => n,
    }
    .min(n)
}

/// How crops are cut.
#[derive(Debug, Clone, PartialEq)]
pub struct CropOptions {
    /// Side of a crop, pixels, at least 1; default 256. Smaller photos give smaller crops.
    pub size: usize,
    /// Factor by which photos are made smaller first, 1..=1000; default 1.5. This suppresses the block artefacts of
    /// JPEG.
    pub shrink: f64,
    /// What the camera makes of a crop.
    pub degradation: Degradation,
    /// Seed of places, mirroring, lattice phases and noise; default 1.
    pub seed: u64,
}

impl Default for CropOptions {
    fn default() -> Self {
        CropOptions { size: 256, shrink: 1.5, degradation: Degradation::default(), seed: 1 }
    }
}

/// `count` random crops of a photo, degraded, without the borders that the degradation spoils. `index` is the number of
/// the photo. A photo that would become smaller than a crop is shrunk less, or not at all.
///
/// # Errors
/// Parameters out of range, or a photo smaller than a crop.
///
/// ```
/// use lenslet_data_gen::pairs::{CropOptions, cut_crops};
/// use lenslet_data_gen::photo::LuminancePhoto;
/// let luminance = ndarray::Array2::from_shape_fn((90, 100), |(y, x)| ((x / 7 + y / 5) % 2) as f32);
/// let photo = LuminancePhoto { name: "tiles.png".into(), sha256: String::new(), luminance };
/// let crops = cut_crops(&photo, 0, 3, &CropOptions { size: 40, shrink: 1.0, ..CropOptions::default() })?;
/// assert_eq!((crops.len(), crops[0].high.dim(), crops[0].low.dim()), (3, (40, 40), (40, 40)));
/// # Ok::<(), lenslet_data_gen::pairs::Error>(())
/// ```
pub fn cut_crops(
    photo: &LuminancePhoto,
    index: usize,
    count: usize,
    options: &CropOptions,
) -> Result<Vec<Crop>, Error> {
    let CropOptions { size, shrink, degradation, seed } = options;
    let (h, w) = photo.luminance.dim();
    let side = size + 2 * BORDER;
    let least = h.min(w);
    if least < LEAST_SIDE || *size == 0 {
        let path = photo.name.clone().into();
        return Err(photo::Error::TooFewPixels { path, width: w, height: h, least: LEAST_SIDE }.into());
    }
    if !(1.0..=1000.0).contains(shrink) {
        return Err(Error::Parameter(format!("photos cannot be shrunk by {shrink} (1 to 1000)")));
    }
    let factor = shrink.min(least as f64 / side as f64).max(1.0);
    let shrunk = |n: usize| (n as f64 / factor).round().max(1.0) as usize;
    let plane = reduce_plane(photo.luminance.view(), shrunk(h), shrunk(w), ReductionKernel::Lanczos)?;
    let (h, w) = plane.dim();
    (0..count)
        .into_par_iter()
        .map(|c| {
            let mut rng = ChaCha8Rng::seed_from_u64(*seed);
            rng.set_stream(((index as u64) << 32) | c as u64);
            let (th, tw) = (whole_samples(side.min(h), degradation), whole_samples(side.min(w), degradation));
            let (y, x) = (rng.random_range(0..=h - th), rng.random_range(0..=w - tw));
            let mut high = plane.slice(s![y..y + th, x..x + tw]).to_owned();
            // Mirrored and turned photos are photos too.
            if rng.random::<bool>() {
                high.invert_axis(Axis(0));
            }
            if rng.random::<bool>() {
                high.invert_axis(Axis(1));
            }
            if rng.random::<bool>() {
                high = high.reversed_axes();
            }
            let high = high.as_standard_layout().into_owned();
            let low = degrade_plane(high.view(), degradation, &mut rng)?;
            let (h, w) = high.dim();
            let inner = s![BORDER..h - BORDER, BORDER..w - BORDER];
            let cut = |plane: &Array2<f32>| plane.slice(inner).to_owned();
            Ok(Crop { photo: index, high: cut(&high), low: cut(&low), side_inputs: Vec::new() })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lenslet_core::interpolation::Interpolation;

    fn photo() -> LuminancePhoto {
        let luminance = Array2::from_shape_fn((120, 150), |(y, x)| {
            0.5 + 0.3 * (x as f32 * 0.21).sin() * (y as f32 * 0.13).cos()
                + if (x / 20 + y / 30) % 2 == 0 { 0.1 } else { 0.0 }
        });
        LuminancePhoto { name: "p".into(), sha256: String::new(), luminance }
    }

    fn options(size: usize, degradation: &Degradation, seed: u64) -> CropOptions {
        CropOptions { size, shrink: 1.0, degradation: degradation.clone(), seed }
    }

    #[test]
    fn crops_repeat_and_differ() {
        let d = Degradation::default();
        let a = cut_crops(&photo(), 3, 2, &options(40, &d, 7)).unwrap();
        let b = cut_crops(&photo(), 3, 2, &options(40, &d, 7)).unwrap();
        assert_eq!(a[0].low, b[0].low);
        assert_ne!(a[0].high, a[1].high);
        assert_ne!(a[0].high, cut_crops(&photo(), 4, 1, &options(40, &d, 7)).unwrap()[0].high);
        assert_eq!(a[0].high.dim(), (40, 40));
    }

    #[test]
    fn the_low_image_is_near_and_smoother() {
        for footprint in [Footprint::Point, Footprint::Lenslet] {
            let d = Degradation { footprint, ..Degradation::default() };
            for c in cut_crops(&photo(), 0, 3, &options(64, &d, 1)).unwrap() {
                let mse = (&c.high - &c.low).mapv(|v| v * v).mean().unwrap();
                assert!(mse > 1e-6 && mse < 2e-3, "{mse}");
                let rough = |p: &Array2<f32>| {
                    p.windows((1, 2)).into_iter().map(|w| (w[[0, 1]] - w[[0, 0]]).powi(2)).sum::<f32>()
                };
                assert!(rough(&c.low) < rough(&c.high));
            }
        }
    }

    #[test]
    fn grids_keep_their_pitch() {
        // A ramp survives shrinking and enlarging only where both agree on the pitch and the phase.
        let luminance = Array2::from_shape_fn((131, 142), |(y, x)| 0.2 + 0.002 * x as f32 + 0.003 * y as f32);
        let ramp = LuminancePhoto { name: "p".into(), sha256: String::new(), luminance };
        for pitch in [2.0, 3.0] {
            let d = Degradation {
                pitch,
                footprint: Footprint::Grid,
                base: Interpolation::Bicubic,
                ..Degradation::default()
            };
            for c in cut_crops(&ramp, 0, 3, &options(107, &d, 1)).unwrap() {
                let (h, w) = c.high.dim();
                assert_eq!(((h + 2 * BORDER) % pitch as usize, (w + 2 * BORDER) % pitch as usize), (0, 0));
                assert!((&c.high - &c.low).iter().all(|v| v.abs() < 1e-4));
            }
        }
        let d = Degradation { footprint: Footprint::Grid, ..Degradation::default() };
        assert!(cut_crops(&ramp, 0, 1, &options(100, &d, 1)).is_err(), "a grid on the barycentric base");
    }
}
