//! Crops of a photo with their low image: the hexagonal drop and its re-interpolation (paper section 4.4).

use lenslet_core::dictionary::{Footprint, Interpolation};
use lenslet_core::metrics::BORDER;
use lenslet_core::sampling::{self, Weights, lattice_samples};
use ndarray::{Array2, ArrayView2, Axis, s};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

use super::{Error, Kernel, Loaded, reduce};

/// How a sharp plane becomes the low image.
#[derive(Debug, Clone, PartialEq)]
pub struct Degradation {
    /// Pixels between neighbouring samples of a row.
    pub pitch: f64,
    /// Rotation of the lattice, radians.
    pub rotation: f64,
    /// What one sample sees.
    pub footprint: Footprint,
    /// Interpolation of the samples.
    pub base: Interpolation,
    /// Standard deviation of noise added to the samples, in units of the encoded range 0..1.
    pub noise: f32,
}

impl Default for Degradation {
    fn default() -> Self {
        Degradation {
            pitch: sampling::DEFAULT_PITCH,
            rotation: sampling::DEFAULT_ROTATION,
            footprint: Footprint::Lenslet,
            base: Interpolation::Barycentric,
            noise: 0.0,
        }
    }
}

/// A crop: what it was, and what the camera and plain interpolation make of it. Same shape (rows, columns).
#[derive(Debug, Clone)]
pub struct Crop {
    /// Index of the photo among those used.
    pub photo: usize,
    /// The sharp luminance.
    pub high: Array2<f32>,
    /// The low image.
    pub low: Array2<f32>,
    /// Other images of the same view, for networks that look at them beside the low one; none as a rule.
    pub beside: Vec<Array2<f32>>,
}

/// Standard normal deviate (Box and Muller's way, from the generator's 64-bit words, so portable).
fn normal(rng: &mut ChaCha8Rng) -> f32 {
    let u = 1.0 - rng.random::<f64>();
    let v = rng.random::<f64>();
    ((-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()) as f32
}

/// The low image of a sharp plane: sampled with the lattice's origin at a random phase, interpolated back.
///
/// # Errors
/// Parameters out of range, or a plane too small to hold a lattice.
pub fn degrade(
    high: ArrayView2<'_, f32>,
    degradation: &Degradation,
    rng: &mut ChaCha8Rng,
) -> Result<Array2<f32>, Error> {
    if !(0.0..=1.0).contains(&degradation.noise) {
        return Err(Error::Parameter(format!("noise of {} is out of range (0 to 1)", degradation.noise)));
    }
    let (h, w) = high.dim();
    let phase = [rng.random::<f64>(), rng.random::<f64>()];
    let image = high.insert_axis(Axis(2));
    let footprint = match degradation.footprint {
        Footprint::Point => sampling::Footprint::Bilinear,
        Footprint::Lenslet => sampling::Footprint::Disc(degradation.pitch),
        Footprint::Grid => return grid(high, degradation, rng),
    };
    let (placed, mut values) = lattice_samples(image, degradation.pitch, degradation.rotation, phase, footprint)?;
    if degradation.noise > 0.0 {
        values.mapv_inplace(|v| v + degradation.noise * normal(rng));
    }
    let low = match degradation.base {
        Interpolation::Barycentric => Weights::new(&placed.centres, (w, h), (w, h))?.apply(values.view())?,
        other => return Err(Error::Parameter(format!("pairs on a {other} base are not made from hexagonal samples"))),
    };
    Ok(low.index_axis_move(Axis(2), 0).as_standard_layout().into_owned())
}

/// The low image of a rectangular grid: shrunk by the pitch (antialiased), enlarged bicubically.
fn grid(high: ArrayView2<'_, f32>, degradation: &Degradation, rng: &mut ChaCha8Rng) -> Result<Array2<f32>, Error> {
    if degradation.base != Interpolation::Bicubic {
        return Err(Error::Parameter("a rectangular grid needs the bicubic base".into()));
    }
    let (h, w) = high.dim();
    let (rows, columns) = ((h as f64 / degradation.pitch).round(), (w as f64 / degradation.pitch).round());
    if !(degradation.pitch >= 1.0 && rows >= 2.0 && columns >= 2.0) {
        return Err(Error::Parameter(format!("a {w}x{h} crop is too small for a grid of pitch {}", degradation.pitch)));
    }
    let mut small = reduce(high, rows as usize, columns as usize, Kernel::Bicubic)?;
    if degradation.noise > 0.0 {
        small.mapv_inplace(|v| v + degradation.noise * normal(rng));
    }
    Ok(sampling::bicubic::resize(small.view().insert_axis(Axis(2)), w, h)?.index_axis_move(Axis(2), 0))
}

/// The longest side up to `n` that a rectangular grid divides into whole samples; hexagonal lattices take any.
fn whole(n: usize, degradation: &Degradation) -> usize {
    match degradation.footprint {
        Footprint::Grid => ((n as f64 / degradation.pitch).floor() * degradation.pitch).round() as usize,
        _ => n,
    }
    .min(n)
}

/// `count` random crops of `size` pixels a side from a photo shrunk by `factor`, degraded, without their spoilt borders.
/// A photo that is too small for its factor is shrunk less, down to not at all.
///
/// # Errors
/// Parameters out of range, or a photo smaller than a crop.
pub fn crops(
    photo: &Loaded,
    index: usize,
    count: usize,
    size: usize,
    factor: f64,
    degradation: &Degradation,
    seed: u64,
) -> Result<Vec<Crop>, Error> {
    let (h, w) = photo.luminance.dim();
    let side = size + 2 * BORDER;
    let least = h.min(w);
    if least < 64 || size == 0 {
        return Err(Error::Photo { path: photo.name.clone(), reason: format!("{w}x{h} pixels are too few") });
    }
    if !(1.0..=1000.0).contains(&factor) {
        return Err(Error::Parameter(format!("photos cannot be shrunk by {factor} (1 to 1000)")));
    }
    let factor = factor.min(least as f64 / side as f64).max(1.0);
    let shrunk = |n: usize| (n as f64 / factor).round().max(1.0) as usize;
    let plane = reduce(photo.luminance.view(), shrunk(h), shrunk(w), Kernel::Lanczos)?;
    let (h, w) = plane.dim();
    (0..count)
        .into_par_iter()
        .map(|c| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(((index as u64) << 32) | c as u64);
            let (th, tw) = (whole(side.min(h), degradation), whole(side.min(w), degradation));
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
            let low = degrade(high.view(), degradation, &mut rng)?;
            let (h, w) = high.dim();
            let inner = s![BORDER..h - BORDER, BORDER..w - BORDER];
            let cut = |plane: &Array2<f32>| plane.slice(inner).to_owned();
            Ok(Crop { photo: index, high: cut(&high), low: cut(&low), beside: Vec::new() })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn photo() -> Loaded {
        let luminance = Array2::from_shape_fn((120, 150), |(y, x)| {
            0.5 + 0.3 * (x as f32 * 0.21).sin() * (y as f32 * 0.13).cos()
                + if (x / 20 + y / 30) % 2 == 0 { 0.1 } else { 0.0 }
        });
        Loaded { name: "p".into(), sha256: String::new(), luminance }
    }

    #[test]
    fn crops_repeat_and_differ() {
        let d = Degradation::default();
        let a = crops(&photo(), 3, 2, 40, 1.0, &d, 7).unwrap();
        let b = crops(&photo(), 3, 2, 40, 1.0, &d, 7).unwrap();
        assert_eq!(a[0].low, b[0].low);
        assert_ne!(a[0].high, a[1].high);
        assert_ne!(a[0].high, crops(&photo(), 4, 1, 40, 1.0, &d, 7).unwrap()[0].high);
        assert_eq!(a[0].high.dim(), (40, 40));
    }

    #[test]
    fn the_low_image_is_near_and_smoother() {
        for footprint in [Footprint::Point, Footprint::Lenslet] {
            let d = Degradation { footprint, ..Degradation::default() };
            for c in crops(&photo(), 0, 3, 64, 1.0, &d, 1).unwrap() {
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
        let ramp = Loaded { name: "p".into(), sha256: String::new(), luminance };
        for pitch in [2.0, 3.0] {
            let d = Degradation {
                pitch,
                footprint: Footprint::Grid,
                base: Interpolation::Bicubic,
                ..Degradation::default()
            };
            for c in crops(&ramp, 0, 3, 107, 1.0, &d, 1).unwrap() {
                let (h, w) = c.high.dim();
                assert_eq!(((h + 2 * BORDER) % pitch as usize, (w + 2 * BORDER) % pitch as usize), (0, 0));
                assert!((&c.high - &c.low).iter().all(|v| v.abs() < 1e-4));
            }
        }
        let d = Degradation { footprint: Footprint::Grid, ..Degradation::default() };
        assert!(crops(&ramp, 0, 1, 100, 1.0, &d, 1).is_err(), "a grid on the barycentric base");
    }

    #[test]
    fn noise_is_as_asked() {
        let flat = Array2::from_elem((200, 200), 0.5f32);
        let d = Degradation { noise: 0.02, pitch: 1.0, ..Degradation::default() };
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let deviates: Vec<f32> = (0..20_000).map(|_| normal(&mut rng)).collect();
        let variance = deviates.iter().map(|v| v * v).sum::<f32>() / 20_000.0;
        assert!((variance - 1.0).abs() < 0.05);
        let low = degrade(flat.view(), &d, &mut rng).unwrap();
        let sd = (low.mapv(|v| (v - 0.5).powi(2)).mean().unwrap()).sqrt();
        assert!(sd > 0.008 && sd < 0.02, "{sd}");
        assert!(degrade(flat.view(), &Degradation { noise: f32::NAN, ..d }, &mut rng).is_err());
    }
}
