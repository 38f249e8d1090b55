//! What a camera and plain interpolation make of a sharp plane: the hexagonal drop and its re-interpolation (paper
//! section 4.4), or the rectangular grid of super-resolution protocols.

use lenslet_core::dictionary::Footprint;
use lenslet_core::geometry::Size;
use lenslet_core::interpolation::Interpolation;
use lenslet_core::random::standard_normal;
use lenslet_core::sampling::{self, Weights, lattice_samples};
use ndarray::{Array2, ArrayView2, Axis};
use rand::RngExt;
use rand::rngs::ChaCha8Rng;

use super::camera_lattice::CameraLattice;
use super::error::Error;
use crate::photo::{ReductionKernel, reduce_plane};

/// How a sharp plane becomes the low image.
#[derive(Debug, Clone, PartialEq)]
pub struct Degradation {
    /// Pixels between neighbouring samples of a row.
    pub pitch: f64,
    /// Rotation of the lattice, radians.
    pub rotation: f64,
    /// What one sample is: the value at a point, the mean over a lenslet, or a pixel of a rectangular grid.
    pub footprint: Footprint,
    /// Interpolation of the samples.
    pub base: Interpolation,
    /// Standard deviation of noise added to the samples, in units of the encoded range 0..1.
    pub noise: f32,
    /// The lenslets of a calibrated camera instead of the regular lattice of `pitch` and `rotation`; every crop is
    /// sampled by those of a window of its views. Default: none.
    pub lattice: Option<CameraLattice>,
}

impl Default for Degradation {
    fn default() -> Self {
        Degradation {
            pitch: sampling::DEFAULT_PITCH,
            rotation: sampling::DEFAULT_ROTATION,
            footprint: Footprint::Lenslet,
            base: Interpolation::Barycentric,
            noise: 0.0,
            lattice: None,
        }
    }
}

/// The low image of a sharp plane: sampled with the lattice's origin at a random phase, interpolated back.
///
/// # Errors
/// Parameters out of range, or a plane too small to hold a lattice.
///
/// ```
/// use lenslet_data_gen::pairs::{Degradation, degrade_plane};
/// use rand::{SeedableRng, rngs::ChaCha8Rng};
/// let edge = ndarray::Array2::from_shape_fn((40, 40), |(_, x)| if x < 20 { 0.2f32 } else { 0.8 });
/// let low = degrade_plane(edge.view(), &Degradation::default(), &mut ChaCha8Rng::seed_from_u64(1))?;
/// // Flat where the edge is far, between the two levels at the edge.
/// assert!((low[[20, 8]] - 0.2).abs() < 1e-4 && (low[[20, 31]] - 0.8).abs() < 1e-4);
/// assert!(low[[20, 20]] > 0.3 && low[[20, 20]] < 0.7);
/// # Ok::<(), lenslet_data_gen::pairs::Error>(())
/// ```
pub fn degrade_plane(
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
        Footprint::Grid => return shrink_and_enlarge(high, degradation, rng),
    };
    let (placed, mut values) = match &degradation.lattice {
        Some(lattice) => {
            let placed = lattice.window(w, h, phase)?;
            let values = sampling::sample_image(image, &placed.centres, footprint)?;
            (placed, values)
        }
        None => lattice_samples(image, degradation.pitch, degradation.rotation, phase, footprint)?,
    };
    if degradation.noise > 0.0 {
        values.mapv_inplace(|v| v + degradation.noise * standard_normal(rng) as f32);
    }
    let low = match degradation.base {
        Interpolation::Barycentric => {
            Weights::new(&placed.centres, Size::new(w, h), Size::new(w, h))?.apply(values.view())?
        }
        other => return Err(Error::Parameter(format!("pairs on a {other} base are not made from hexagonal samples"))),
    };
    Ok(low.index_axis_move(Axis(2), 0).as_standard_layout().into_owned())
}

/// The low image of a rectangular grid: shrunk by the pitch (antialiased), enlarged bicubically.
fn shrink_and_enlarge(
    high: ArrayView2<'_, f32>,
    degradation: &Degradation,
    rng: &mut ChaCha8Rng,
) -> Result<Array2<f32>, Error> {
    if degradation.base != Interpolation::Bicubic {
        return Err(Error::Parameter("a rectangular grid needs the bicubic base".into()));
    }
    let (h, w) = high.dim();
    let (rows, columns) = ((h as f64 / degradation.pitch).round(), (w as f64 / degradation.pitch).round());
    if !(degradation.pitch >= 1.0 && rows >= 2.0 && columns >= 2.0) {
        return Err(Error::Parameter(format!("a {w}x{h} crop is too small for a grid of pitch {}", degradation.pitch)));
    }
    let mut small = reduce_plane(high, rows as usize, columns as usize, ReductionKernel::Bicubic)?;
    if degradation.noise > 0.0 {
        small.mapv_inplace(|v| v + degradation.noise * standard_normal(rng) as f32);
    }
    Ok(sampling::bicubic::resize_bicubic(small.view().insert_axis(Axis(2)), Size::new(w, h))?
        .index_axis_move(Axis(2), 0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn a_crop_is_sampled_by_the_calibrated_lenslets_of_its_window() {
        use lenslet_core::calibration::{Calibration, Lattice};

        // Every third lenslet is missing, and rows lie 5 % too far apart: no regular lattice gives the same values.
        let lattice = Lattice::hexagonal(10.0, 0.0, 1.05, [300.0, 300.0]);
        let mut calibration = Calibration::of_lattice(lattice, lenslet_core::geometry::Size::new(600, 600));
        calibration.lenslets.retain(|l| (l.i + l.j).rem_euclid(3) != 0);
        let lattice = CameraLattice::of_calibration(&calibration, 200).unwrap();
        let degradation =
            Degradation { footprint: Footprint::Point, lattice: Some(lattice.clone()), ..Degradation::default() };
        let high = Array2::from_shape_fn((80, 90), |(y, x)| ((x * 7 + y * 13) % 11) as f32 / 11.0);
        let low = degrade_plane(high.view(), &degradation, &mut ChaCha8Rng::seed_from_u64(4)).unwrap();
        let mut same = ChaCha8Rng::seed_from_u64(4);
        let window = lattice.window(90, 80, [same.random(), same.random()]).unwrap();
        let image = high.view().insert_axis(Axis(2));
        let values = sampling::sample_image(image, &window.centres, sampling::Footprint::Bilinear).unwrap();
        let plain =
            Weights::new(&window.centres, Size::new(90, 80), Size::new(90, 80)).unwrap().apply(values.view()).unwrap();
        assert_eq!(low, plain.index_axis(Axis(2), 0));
        let regular = Degradation { lattice: None, ..degradation };
        assert_ne!(low, degrade_plane(high.view(), &regular, &mut ChaCha8Rng::seed_from_u64(4)).unwrap());
    }

    #[test]
    fn noise_has_the_given_deviation() {
        let flat = Array2::from_elem((200, 200), 0.5f32);
        let d = Degradation { noise: 0.02, pitch: 1.0, ..Degradation::default() };
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let deviates: Vec<f32> = (0..20_000).map(|_| standard_normal(&mut rng) as f32).collect();
        let variance = deviates.iter().map(|v| v * v).sum::<f32>() / 20_000.0;
        assert!((variance - 1.0).abs() < 0.05);
        let low = degrade_plane(flat.view(), &d, &mut rng).unwrap();
        let sd = (low.mapv(|v| (v - 0.5).powi(2)).mean().unwrap()).sqrt();
        assert!(sd > 0.008 && sd < 0.02, "{sd}");
        assert!(degrade_plane(flat.view(), &Degradation { noise: f32::NAN, ..d }, &mut rng).is_err());
    }
}
