//! Hexagonal sampling of ordinary images (paper section 4.4: values dropped at a triangular grid's points).

use std::f64::consts::PI;

use ndarray::{Array2, ArrayView3};
use rayon::prelude::*;

use super::{Error, bicubic, check_size};
use crate::calibration::{Grid, Lattice};

/// Pitch of a Lytro's lattice in pixels of its 1080-pixel view.
pub const DEFAULT_PITCH: f64 = 1080.0 / 328.0;
/// Rotation of the lattice against the rows, radians, as usual for this camera.
pub const DEFAULT_ROTATION: f64 = 0.002;

/// Lattice points inside an image, sorted by (j, i).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Placed {
    /// Positions (x, y).
    pub centres: Vec<[f64; 2]>,
    /// Lattice index (i, j) of each.
    pub index: Vec<[i32; 2]>,
}

/// How much of the image one sample sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Footprint {
    /// The image interpolated (bicubic) at the centre.
    Point,
    /// The image interpolated bilinearly at the centre: a point seen through one pixel's width.
    Bilinear,
    /// The mean over a disc of this diameter (pixels): one pitch for a lenslet.
    Disc(f64),
}

/// A hexagonal lattice with rows along x: neighbours `pitch` apart, turned by `rotation` (radians, clockwise on
/// screen), rows `row_stretch`·√3/2·`pitch` apart, lattice point (0, 0) at `origin`.
pub fn hexagonal(pitch: f64, rotation: f64, row_stretch: f64, origin: [f64; 2]) -> Lattice {
    let (sin, cos) = rotation.sin_cos();
    let row = pitch * 3f64.sqrt() / 2.0 * row_stretch;
    let half = pitch / 2.0;
    Lattice {
        grid: Grid::HexRows,
        origin,
        a: [pitch * cos, pitch * sin],
        b: [half * cos - row * sin, half * sin + row * cos],
    }
}

/// Every lattice point with 0 ≤ x ≤ width−1 and 0 ≤ y ≤ height−1.
///
/// # Errors
/// A size out of range; a lattice that is degenerate, or finer than half a pixel.
pub fn place(lattice: &Lattice, width: usize, height: usize) -> Result<Placed, Error> {
    check_size("image", width, height)?;
    let det = lattice.a[0] * lattice.b[1] - lattice.a[1] * lattice.b[0];
    if !(0.25..1e12).contains(&det.abs()) || !lattice.centre(0, 0).iter().all(|c| c.abs() < 1e9) {
        return Err(Error::Parameter(format!("a lattice with cells of {det} square pixels cannot sample an image")));
    }
    let (right, bottom) = ((width - 1) as f64, (height - 1) as f64);
    let corners = [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]].map(|[x, y]| lattice.coordinates(x, y));
    let bounds = |k: usize| {
        let low = corners.iter().map(|c| c[k]).fold(f64::INFINITY, f64::min);
        let high = corners.iter().map(|c| c[k]).fold(f64::NEG_INFINITY, f64::max);
        (low.floor() as i64, high.ceil() as i64)
    };
    let ((i0, i1), (j0, j1)) = (bounds(0), bounds(1));
    let mut placed = Placed::default();
    for j in j0..=j1 {
        // Only the stretch of the row that crosses the image: a point is left out by the exact test below.
        let (mut low, mut high) = (i0, i1);
        for (k, limit) in [(0, right), (1, bottom)] {
            let start = lattice.origin[k] + j as f64 * lattice.b[k];
            if lattice.a[k].abs() > 1e-9 {
                let (p, q) = (-start / lattice.a[k], (limit - start) / lattice.a[k]);
                low = low.max(p.min(q).floor() as i64);
                high = high.min(p.max(q).ceil() as i64);
            }
        }
        for i in low..=high {
            let (Ok(i), Ok(j)) = (i32::try_from(i), i32::try_from(j)) else { continue };
            let [x, y] = lattice.centre(i, j);
            if (0.0..=right).contains(&x) && (0.0..=bottom).contains(&y) {
                placed.centres.push([x, y]);
                placed.index.push([i, j]);
            }
        }
    }
    Ok(placed)
}

/// Samples `image` (t, s, c) at `centres`: shape (centres, channels). Beyond the border the edge pixel repeats.
///
/// # Errors
/// A disc diameter that is not positive and at most 256 pixels, an empty image, a centre that is not finite.
pub fn sample_image(
    image: ArrayView3<'_, f32>,
    centres: &[[f64; 2]],
    footprint: Footprint,
) -> Result<Array2<f32>, Error> {
    let (height, width, channels) = image.dim();
    check_size("image", width, height)?;
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
            bicubic::at(image, x, y, out);
            return;
        }
        let mut sums = vec![0f64; channels];
        for &[dx, dy] in &offsets {
            bilinear_add(image, x + dx, y + dy, &mut sums);
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

fn bilinear_add(image: ArrayView3<'_, f32>, x: f64, y: f64, sums: &mut [f64]) {
    let (height, width, _) = image.dim();
    let x = x.clamp(0.0, (width - 1) as f64);
    let y = y.clamp(0.0, (height - 1) as f64);
    let (x0, y0) = (x as usize, y as usize);
    let (x1, y1) = ((x0 + 1).min(width - 1), (y0 + 1).min(height - 1));
    let (fx, fy) = (x - x0 as f64, y - y0 as f64);
    for (c, sum) in sums.iter_mut().enumerate() {
        let at = |y: usize, x: usize| f64::from(image[[y, x, c]]);
        let top = at(y0, x0) + fx * (at(y0, x1) - at(y0, x0));
        let bottom = at(y1, x0) + fx * (at(y1, x1) - at(y1, x0));
        *sum += top + fy * (bottom - top);
    }
}

/// The drop in one call: `image` (t, s, c) sampled on a hexagonal lattice of `pitch` pixels and `rotation` radians whose
/// origin stands `phase` (fractions of the two lattice vectors) from the image's centre.
///
/// # Errors
/// As [`place`] and [`sample_image`]; a pitch outside 1 … 1000 or a rotation beyond ±π.
pub fn lattice_samples(
    image: ArrayView3<'_, f32>,
    pitch: f64,
    rotation: f64,
    phase: [f64; 2],
    footprint: Footprint,
) -> Result<(Placed, Array2<f32>), Error> {
    if !(1.0..=1000.0).contains(&pitch) || !(-PI..=PI).contains(&rotation) || !phase.iter().all(|p| p.abs() <= 1e3) {
        return Err(Error::Parameter(format!(
            "no lattice of pitch {pitch}, rotation {rotation}, phase {phase:?}: pitch 1 to 1000 pixels, rotation within pi"
        )));
    }
    let (height, width, _) = image.dim();
    check_size("image", width, height)?;
    let mut lattice = hexagonal(pitch, rotation, 1.0, [(width - 1) as f64 / 2.0, (height - 1) as f64 / 2.0]);
    for k in 0..2 {
        lattice.origin[k] += phase[0] * lattice.a[k] + phase[1] * lattice.b[k];
    }
    let placed = place(&lattice, width, height)?;
    let values = sample_image(image, &placed.centres, footprint)?;
    Ok((placed, values))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;

    #[test]
    fn places_every_point_of_the_plain_double_loop() {
        for rotation in [-0.3, 0.0, 0.002, 1.2, 3.0] {
            let lattice = hexagonal(3.3, rotation, 1.0005, [17.2, 8.9]);
            let placed = place(&lattice, 61, 47).unwrap();
            let mut plain = Vec::new();
            for j in -100..=100 {
                for i in -100..=100 {
                    let [x, y] = lattice.centre(i, j);
                    if (0.0..=60.0).contains(&x) && (0.0..=46.0).contains(&y) {
                        plain.push([i, j]);
                    }
                }
            }
            assert_eq!(placed.index, plain, "rotation {rotation}");
        }
    }

    #[test]
    fn lattice_words_come_back() {
        let lattice = hexagonal(9.93, -0.0049, 1.0005, [0.0, 0.0]);
        assert!((lattice.pitch() - 9.93).abs() < 1e-12);
        assert!((lattice.rotation() + 0.0049).abs() < 1e-12);
        assert!((lattice.row_stretch() - 1.0005).abs() < 1e-9);
    }

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
        assert!(place(&hexagonal(0.2, 0.0, 1.0, [0.0; 2]), 10, 10).is_err());
        assert!(place(&hexagonal(3.0, 0.0, 1.0, [f64::NAN; 2]), 10, 10).is_err());
    }
}
