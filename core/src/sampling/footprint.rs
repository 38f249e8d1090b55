//! Hexagonal sampling of ordinary images (paper section 4.4: values taken at the points of a triangular grid).

use std::f64::consts::PI;

use ndarray::{Array2, ArrayView3};
use rayon::prelude::*;

use super::bicubic::bicubic_at;
use super::error::{Error, check_size};
use crate::geometry::{Lattice, LatticePoints, Size};
use crate::image::{Cell, bilinear_by_differences};

/// Pitch of a Lytro's lattice in pixels of its 1080-pixel view.
/// Source: 328 lenslets per row of that view.
pub const DEFAULT_PITCH: f64 = 1080.0 / 328.0;
/// Rotation of the lattice against the rows, radians, typical of this camera.
/// Source: chosen
pub const DEFAULT_ROTATION: f64 = 0.002;

/// The part of the image that one sample covers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Footprint {
    /// The image interpolated (bicubic) at the centre.
    Point,
    /// The image interpolated bilinearly at the centre, which averages over about one pixel.
    Bilinear,
    /// The mean over a disc of this diameter (pixels): one pitch for a lenslet.
    Disc(f64),
}

/// Every point of a lattice in a picture of `width`×`height` pixels: 0 ≤ x ≤ width−1 and 0 ≤ y ≤ height−1, sorted by
/// (j, i).
///
/// # Errors
/// A size out of range; a lattice that is degenerate, or finer than half a pixel.
///
/// ```
/// use lenslet_core::geometry::{Lattice, Size};
/// use lenslet_core::sampling::lattice_points_in;
/// let points = lattice_points_in(&Lattice::hexagonal(3.0, 0.0, 1.0, [1.0, 1.0]), Size::new(7, 3))?;
/// assert_eq!(points.centres, [[1.0, 1.0], [4.0, 1.0]]);
/// # Ok::<(), lenslet_core::sampling::Error>(())
/// ```
pub fn lattice_points_in(lattice: &Lattice, size: Size) -> Result<LatticePoints, Error> {
    check_size("image", size)?;
    let det = lattice.a[0] * lattice.b[1] - lattice.a[1] * lattice.b[0];
    if !(0.25..1e12).contains(&det.abs()) || !lattice.centre(0, 0).iter().all(|c| c.abs() < 1e9) {
        return Err(Error::Parameter(format!("a lattice with cells of {det} square pixels cannot sample an image")));
    }
    Ok(lattice.points_within(size, 0.0))
}

/// Samples `image` (t, s, c) at `centres`: shape (centres, channels). Beyond the border the edge pixel repeats.
///
/// # Errors
/// A disc diameter that is not above 0 and at most 256 pixels, an empty image, a centre that is not finite.
pub fn sample_image(
    image: ArrayView3<'_, f32>,
    centres: &[[f64; 2]],
    footprint: Footprint,
) -> Result<Array2<f32>, Error> {
    let (height, width, channels) = image.dim();
    check_size("image", Size::new(width, height))?;
    if let Some(k) = centres.iter().position(|c| !c.iter().all(|v| v.abs() < 1e9)) {
        return Err(Error::NotFinite(k));
    }
    let offsets = match footprint {
        Footprint::Point => Vec::new(),
        Footprint::Bilinear => vec![[0.0, 0.0]],
        Footprint::Disc(diameter) => disc(diameter)?,
    };
    let mut values = Array2::zeros((centres.len(), channels));
    if channels == 0 {
        return Ok(values);
    }
    let Some(flat) = values.as_slice_mut() else { return Ok(values) };
    flat.par_chunks_mut(channels).zip(centres.par_iter()).for_each(|(out, &[x, y])| {
        if offsets.is_empty() {
            bicubic_at(image, x, y, out);
            return;
        }
        let mut sums = vec![0f64; channels];
        for &[dx, dy] in &offsets {
            add_bilinear(image, x + dx, y + dy, &mut sums);
        }
        for (o, s) in out.iter_mut().zip(&sums) {
            *o = (s / offsets.len() as f64) as f32;
        }
    });
    Ok(values)
}

/// Points that fill a disc evenly, at most a quarter pixel (or a twelfth of the diameter) apart.
fn disc(diameter: f64) -> Result<Vec<[f64; 2]>, Error> {
    if !(diameter > 0.0 && diameter <= 256.0) {
        return Err(Error::Parameter(format!(
            "a footprint {diameter} pixels wide is out of range (above 0, up to 256)"
        )));
    }
    let n = ((diameter / 0.25).ceil() as i64).clamp(12, 96);
    let step = diameter / n as f64;
    let mut points = Vec::new();
    for y in 0..n {
        for x in 0..n {
            let (dx, dy) = ((x as f64 + 0.5) * step - diameter / 2.0, (y as f64 + 0.5) * step - diameter / 2.0);
            if dx.hypot(dy) <= diameter / 2.0 {
                points.push([dx, dy]);
            }
        }
    }
    Ok(points)
}

/// Adds the bilinear values of all channels at (x, y), in f64.
fn add_bilinear(image: ArrayView3<'_, f32>, x: f64, y: f64, sums: &mut [f64]) {
    let (height, width, _) = image.dim();
    let cell = Cell::clamped(x, y, Size::new(width, height));
    for (c, sum) in sums.iter_mut().enumerate() {
        *sum += bilinear_by_differences(cell.corners(|x, y| f64::from(image[[y, x, c]])), cell.fx, cell.fy);
    }
}

/// Hexagonal sampling of an image in one call: `image` (t, s, c) sampled on a hexagonal lattice of `pitch` pixels and
/// `rotation` radians, whose origin is displaced from the image's centre by `phase` (fractions of the two lattice
/// vectors). Returns the points and their values, shape (points, channels).
///
/// # Errors
/// As [`lattice_points_in`] and [`sample_image`]; a pitch outside 1 … 1000 or a rotation beyond ±π.
///
/// ```
/// use lenslet_core::sampling::{Footprint, lattice_samples};
/// let image = ndarray::Array3::from_shape_fn((20, 30, 1), |(_, s, _)| s as f32);
/// let (points, values) = lattice_samples(image.view(), 3.3, 0.0, [0.0; 2], Footprint::Point)?;
/// let middle = points.index.iter().position(|&k| k == [0, 0]).unwrap();
/// assert!((values[[middle, 0]] - 14.5).abs() < 1e-5);
/// # Ok::<(), lenslet_core::sampling::Error>(())
/// ```
pub fn lattice_samples(
    image: ArrayView3<'_, f32>,
    pitch: f64,
    rotation: f64,
    phase: [f64; 2],
    footprint: Footprint,
) -> Result<(LatticePoints, Array2<f32>), Error> {
    if !(1.0..=1000.0).contains(&pitch) || !(-PI..=PI).contains(&rotation) || !phase.iter().all(|p| p.abs() <= 1e3) {
        return Err(Error::Parameter(format!(
            "no lattice of pitch {pitch}, rotation {rotation}, phase {phase:?}: pitch 1 to 1000 pixels, rotation within pi"
        )));
    }
    let (height, width, _) = image.dim();
    check_size("image", Size::new(width, height))?;
    let mut lattice = Lattice::hexagonal(pitch, rotation, 1.0, [(width - 1) as f64 / 2.0, (height - 1) as f64 / 2.0]);
    for k in 0..2 {
        lattice.origin[k] += phase[0] * lattice.a[k] + phase[1] * lattice.b[k];
    }
    let points = lattice_points_in(&lattice, Size::new(width, height))?;
    let values = sample_image(image, &points.centres, footprint)?;
    Ok((points, values))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;

    #[test]
    fn a_plane_is_sampled_exactly_by_both_footprints() {
        let image = Array3::from_shape_fn((40, 50, 2), |(t, s, c)| 0.01 * s as f32 - 0.02 * t as f32 + c as f32);
        for footprint in [Footprint::Point, Footprint::Bilinear, Footprint::Disc(3.3)] {
            let (placed, values) = lattice_samples(image.view(), 3.3, 0.002, [0.3, 0.7], footprint).unwrap();
            let mut checked = 0;
            for (k, &[x, y]) in placed.centres.iter().enumerate() {
                if x > 3.0 && y > 3.0 && x < 46.0 && y < 36.0 {
                    for c in 0..2 {
                        let truth = 0.01 * x - 0.02 * y + c as f64;
                        assert!((f64::from(values[[k, c]]) - truth).abs() < 1e-5);
                    }
                    checked += 1;
                }
            }
            assert!(checked > 100);
        }
    }

    #[test]
    fn bad_input_is_an_error() {
        let image = Array3::<f32>::zeros((4, 4, 1));
        assert!(lattice_samples(image.view(), 0.1, 0.0, [0.0; 2], Footprint::Point).is_err());
        assert!(lattice_samples(image.view(), f64::NAN, 0.0, [0.0; 2], Footprint::Point).is_err());
        assert!(sample_image(image.view(), &[[f64::NAN, 0.0]], Footprint::Point).is_err());
        assert!(sample_image(image.view(), &[[0.0, 0.0]], Footprint::Disc(0.0)).is_err());
        assert!(sample_image(Array3::zeros((0, 4, 1)).view(), &[], Footprint::Point).is_err());
        assert!(lattice_points_in(&Lattice::hexagonal(0.2, 0.0, 1.0, [0.0; 2]), Size::new(10, 10)).is_err());
        assert!(lattice_points_in(&Lattice::hexagonal(3.0, 0.0, 1.0, [f64::NAN; 2]), Size::new(10, 10)).is_err());
    }

    /// One channel, values of a function of the place.
    fn picture(width: usize, height: usize, f: impl Fn(f64, f64) -> f64) -> Array3<f32> {
        Array3::from_shape_fn((height, width, 1), |(t, s, _)| f(s as f64, t as f64) as f32)
    }

    #[test]
    fn footprints_differ_where_the_image_is_no_plane() {
        let step = picture(6, 3, |x, _| f64::from(u8::from(x == 1.0)));
        let at = [[0.5, 1.0], [1.25, 1.0]];
        let value = |footprint| sample_image(step.view(), &at, footprint).unwrap().into_raw_vec_and_offset().0;
        assert_eq!(value(Footprint::Bilinear), [0.5, 0.75]);
        assert_eq!(value(Footprint::Point)[0], 0.5625); // Keys' kernel at a half: (−1, 9, 9, −1)/16
        // The mean of x² over a disc is a quarter of its squared radius, and bilinear values lie 1/6 too high.
        let bowl = picture(41, 41, |x, y| (x - 20.0).powi(2) + 10.0 * y);
        for diameter in [8.0, 20.0] {
            let mean = sample_image(bowl.view(), &[[20.0, 20.0]], Footprint::Disc(diameter)).unwrap()[[0, 0]];
            let truth = diameter * diameter / 16.0 + 1.0 / 6.0 + 200.0;
            assert!((f64::from(mean) - truth).abs() < 0.002 * truth - 0.35, "{diameter}: {mean} against {truth}");
        }
    }

    #[test]
    fn the_points_of_a_disc_lie_a_quarter_pixel_apart() {
        for (diameter, across) in [(1.0, 12), (8.0, 32), (256.0, 96)] {
            let points = disc(diameter).unwrap();
            let full = std::f64::consts::FRAC_PI_4 * f64::from(across * across);
            assert!((points.len() as f64 / full - 1.0).abs() < 0.02, "{diameter}: {} points", points.len());
            assert!(points.iter().all(|p| p[0].hypot(p[1]) <= diameter / 2.0));
            let sum = points.iter().fold([0.0; 2], |s, p| [s[0] + p[0], s[1] + p[1]]);
            assert!(sum.iter().all(|s| s.abs() < 1e-6));
        }
        assert!(disc(256.1).is_err() && disc(-1.0).is_err());
    }

    #[test]
    fn the_phase_moves_the_lattice_by_parts_of_its_vectors() {
        let image = picture(30, 20, |x, y| x + y);
        let place = |phase: [f64; 2]| {
            let (points, _) = lattice_samples(image.view(), 4.0, 0.1, phase, Footprint::Point).unwrap();
            points.centres[points.index.iter().position(|&k| k == [0, 0]).unwrap()]
        };
        let near = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]) < 1e-9;
        assert!(near(place([0.0; 2]), [14.5, 9.5]));
        let (s, c) = 0.1f64.sin_cos();
        let a = [4.0 * c, 4.0 * s];
        // The second vector lies 60 degrees on.
        let b = [0.5 * a[0] - 0.75f64.sqrt() * a[1], 0.5 * a[1] + 0.75f64.sqrt() * a[0]];
        let moved = [14.5 + 0.3 * a[0] + 0.7 * b[0], 9.5 + 0.3 * a[1] + 0.7 * b[1]];
        assert!(near(place([0.3, 0.7]), moved), "{:?} {moved:?}", place([0.3, 0.7]));
    }

    #[test]
    fn each_limit_holds_by_itself() {
        let image = picture(30, 20, |x, y| x + y);
        let asked =
            |pitch, rotation, phase| lattice_samples(image.view(), pitch, rotation, phase, Footprint::Point).is_ok();
        assert!(asked(1000.0, PI, [0.0; 2]) && asked(1.0, -PI, [1e3, -1e3]));
        assert!(!asked(1000.1, 0.0, [0.0; 2]));
        assert!(!asked(3.0, 3.2, [0.0; 2]));
        assert!(!asked(3.0, 0.0, [0.0, 1000.1]));
        // A cell of 0.2 square pixels, both vectors long.
        let thin = Lattice { a: [3.0, 2.0], b: [2.9, 2.0], ..Lattice::hexagonal(3.0, 0.0, 1.0, [0.0; 2]) };
        assert!(lattice_points_in(&thin, Size::new(10, 10)).is_err());
    }
}
