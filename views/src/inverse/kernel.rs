//! The kernel of a footprint: k on the pixel grid with which interpolation (B-splines) of k ∗ I comes nearest to the mean
//! of I over the footprint, for pictures whose power falls with the square of the frequency.
//!
//! With T the transfer of interpolation at a place between the pixels, ⟨·⟩ the mean over such places and J the
//! footprint's transfer, k minimises Σ_f S(f) ⟨|T(f) k̂(f) − J(f)|²⟩. Splines blur by themselves; the kernel takes that out
//! again.

use std::f64::consts::PI;

use lenslet_core::linalg::gauss_with_back_substitution;

use super::basis::Basis;
use super::dispatch::dispatched;
use super::footprint::SampleFootprint;
use super::forward::interleaved;

/// Frequencies an axis from 0 to half a cycle a pixel.
///
/// Source: chosen.
const FREQUENCIES: usize = 32;

/// Frequency below which the assumed power of pictures no longer grows, cycles a pixel.
///
/// Source: chosen, a period of a hundred pixels.
const CORNER: f64 = 0.01;

/// A symmetric kernel of (2·radius + 1)² taps that sum to one.
#[derive(Debug, Clone, PartialEq)]
pub struct Kernel {
    radius: usize,
    /// Row by row.
    taps: Vec<f32>,
}

impl Kernel {
    /// The kernel that changes nothing.
    #[must_use]
    pub fn identity() -> Self {
        Kernel { radius: 0, taps: vec![1.0] }
    }

    /// The kernel of a footprint. Points keep the identity: nothing is gained where nothing is averaged.
    #[must_use]
    pub fn of_footprint(footprint: &SampleFootprint, basis: Basis) -> Self {
        if *footprint == SampleFootprint::Point && basis == Basis::Linear {
            return Kernel::identity();
        }
        let beyond = match basis {
            Basis::Linear => 0.3,
            Basis::Quadratic => 1.5,
            Basis::Cubic => 3.0,
        };
        let radius = (footprint.reach() + beyond).ceil().clamp(2.0, 12.0) as usize;
        let side = radius + 1;
        let unknowns = side * side;
        let mut system = vec![0f64; unknowns * (unknowns + 1)];
        let mut waves = vec![0f64; unknowns];
        for b in 0..=FREQUENCIES {
            for a in 0..=FREQUENCIES {
                let (fx, fy) = (0.5 * a as f64 / FREQUENCIES as f64, 0.5 * b as f64 / FREQUENCIES as f64);
                let once = |k: usize| if k == 0 || k == FREQUENCIES { 1.0 } else { 2.0 };
                let power = once(a) * once(b) / (fx * fx + fy * fy + CORNER * CORNER);
                let ((mx, sx), (my, sy)) = (basis.transfer(fx), basis.transfer(fy));
                for v in 0..side {
                    for u in 0..side {
                        let fold = |k: usize| if k == 0 { 1.0 } else { 2.0 };
                        waves[v * side + u] =
                            fold(u) * fold(v) * (2.0 * PI * fx * u as f64).cos() * (2.0 * PI * fy * v as f64).cos();
                    }
                }
                let right = power * mx * my * footprint.transfer(fx, fy);
                for (i, wave) in waves.iter().enumerate() {
                    let row = &mut system[i * (unknowns + 1)..(i + 1) * (unknowns + 1)];
                    for (entry, other) in row.iter_mut().zip(&waves) {
                        *entry += power * sx * sy * wave * other;
                    }
                    row[unknowns] += right * wave;
                }
            }
        }
        let trace: f64 = (0..unknowns).map(|i| system[i * (unknowns + 2)]).sum();
        for i in 0..unknowns {
            system[i * (unknowns + 2)] += 1e-9 * trace;
        }
        if gauss_with_back_substitution(&mut system, unknowns, unknowns + 1, 1e-300).is_none() {
            return Kernel::identity();
        }
        let quarter = |v: usize, u: usize| system[(v * side + u) * (unknowns + 1) + unknowns];
        let full = 2 * radius + 1;
        let taps: Vec<f64> =
            (0..full * full).map(|k| quarter((k / full).abs_diff(radius), (k % full).abs_diff(radius))).collect();
        let sum: f64 = taps.iter().sum();
        Kernel { radius, taps: taps.into_iter().map(|t| (t / sum) as f32).collect() }
    }

    /// Taps on each side of the middle one.
    #[must_use]
    pub fn radius(&self) -> usize {
        self.radius
    }

    /// Row by row, (2·radius + 1)² of them.
    #[must_use]
    pub fn taps(&self) -> &[f32] {
        &self.taps
    }

    /// The squares of the taps, as a kernel.
    #[must_use]
    pub(super) fn squared(&self) -> Self {
        Kernel { radius: self.radius, taps: self.taps.iter().map(|t| t * t).collect() }
    }

    /// k ∗ every plane (rows of `width`), as samples see a picture: up to three channels, the rest 0.
    #[must_use]
    pub fn smooth(&self, planes: &[Vec<f32>], width: usize) -> Vec<[f32; 4]> {
        let one = |plane: &Vec<f32>| {
            let mut smooth = vec![0f32; plane.len()];
            dispatched(|| self.convolve(plane, width, &mut smooth));
            smooth
        };
        interleaved(&planes.iter().map(one).collect::<Vec<_>>())
    }

    /// `out` = k ∗ `picture` (rows of `width`); nothing lies outside. The kernel is symmetric, so this is its own
    /// adjoint.
    #[inline(always)]
    pub(super) fn convolve(&self, picture: &[f32], width: usize, out: &mut [f32]) {
        if self.radius == 0 {
            out.copy_from_slice(picture);
            return;
        }
        let r = self.radius;
        let height = picture.len() / width.max(1);
        let mut padded = vec![0f32; width + 2 * r];
        for (t, out) in out.chunks_exact_mut(width).enumerate() {
            out.fill(0.0);
            let line = |t: usize| &picture[t * width..(t + 1) * width];
            for down in 0..=r {
                // Lines with equal taps above and below, then pairs of equal taps left and right.
                let sum = &mut padded[r..r + width];
                match (t.checked_sub(down).map(line), (t + down < height && down > 0).then(|| line(t + down))) {
                    (Some(above), Some(below)) => {
                        for ((s, a), b) in sum.iter_mut().zip(above).zip(below) {
                            *s = a + b;
                        }
                    }
                    (Some(one), None) | (None, Some(one)) => sum.copy_from_slice(one),
                    (None, None) => continue,
                }
                let taps = &self.taps[(r + down) * (2 * r + 1)..(r + down + 1) * (2 * r + 1)];
                for (o, m) in out.iter_mut().zip(&padded[r..r + width]) {
                    *o += taps[r] * m;
                }
                for d in 1..=r {
                    let (left, right) = (&padded[r - d..r - d + width], &padded[r + d..r + d + width]);
                    for ((o, a), b) in out.iter_mut().zip(left).zip(right) {
                        *o += taps[r + d] * (a + b);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::forward::Grid;
    use super::*;

    /// What bilinear interpolation of k ∗ wave gives at a place, against the wave's mean over the footprint.
    fn largest_error(footprint: &SampleFootprint, basis: Basis, f: (f64, f64)) -> f64 {
        let kernel = Kernel::of_footprint(footprint, basis);
        let side = 40;
        let wave: Vec<f32> = (0..side * side)
            .map(|k| (2.0 * PI * (f.0 * (k % side) as f64 + f.1 * (k / side) as f64)).cos() as f32)
            .collect();
        let mut smooth = vec![0f32; side * side];
        kernel.convolve(&wave, side, &mut smooth);
        let smooth = interleaved(&[smooth]);
        let grid = Grid { width: side, height: side, margin: 0, basis };
        let mut worst = 0f64;
        for k in 0..100 {
            let (x, y) = (18.0 + 0.37 * f64::from(k % 10), 18.0 + 0.41 * f64::from(k / 10));
            let truth = footprint.transfer(f.0, f.1) * (2.0 * PI * (f.0 * x + f.1 * y)).cos();
            let row = grid.row(x as f32, y as f32, 0.0, 1.0, 0).unwrap();
            let value = match basis {
                Basis::Linear => row.apply::<2>(&smooth, side),
                Basis::Quadratic => row.apply::<3>(&smooth, side),
                Basis::Cubic => row.apply::<4>(&smooth, side),
            };
            worst = worst.max((f64::from(value[0]) - truth).abs());
        }
        worst
    }

    #[test]
    fn the_kernel_gives_the_mean_over_its_footprint() {
        let disc = SampleFootprint::Disc { diameter: 3.29 };
        let square = SampleFootprint::Box { width: 3.0, height: 3.0 };
        let oblong = SampleFootprint::Box { width: 2.0, height: 4.0 };
        for footprint in [disc, square, oblong, SampleFootprint::Gaussian { sigma: 0.9 }] {
            for f in [(0.0, 0.0), (0.03, 0.05), (0.1, -0.04), (0.08, 0.12)] {
                for (basis, most) in [(Basis::Linear, 0.05), (Basis::Quadratic, 0.01), (Basis::Cubic, 0.006)] {
                    let worst = largest_error(&footprint, basis, f);
                    assert!(worst < most, "{footprint:?} at {f:?}: {worst}");
                }
            }
        }
        // A point taken for the footprint is wrong by far more.
        assert!(1.0 - disc.transfer(0.08, 0.12) > 0.2);
    }

    #[test]
    fn convolution_is_its_own_adjoint() {
        let kernel = Kernel::of_footprint(&SampleFootprint::Disc { diameter: 3.0 }, Basis::Quadratic);
        let (w, h) = (23, 17);
        let value = |k: usize, m: usize| ((k * m + 7) % 101) as f32 / 101.0 - 0.5;
        let a: Vec<f32> = (0..w * h).map(|k| value(k, 37)).collect();
        let b: Vec<f32> = (0..w * h).map(|k| value(k, 61)).collect();
        let (mut ka, mut kb) = (vec![0.0; w * h], vec![0.0; w * h]);
        kernel.convolve(&a, w, &mut ka);
        kernel.convolve(&b, w, &mut kb);
        let dot = |x: &[f32], y: &[f32]| -> f64 { x.iter().zip(y).map(|(x, y)| f64::from(*x) * f64::from(*y)).sum() };
        assert!((dot(&ka, &b) - dot(&a, &kb)).abs() < 1e-6 * dot(&ka, &ka).sqrt() * dot(&b, &b).sqrt());
    }
}
