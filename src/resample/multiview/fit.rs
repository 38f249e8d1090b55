//! The smooth fit (our way past 4.3's triangulation): pixels I minimising Σ w_i (f_i − B(x_i)·I)² + λ|I − prior|², B bilinear,
//! by a few steps of diagonally preconditioned descent from the prior, which is what one view alone gives.

use anyhow::Result;
use ndarray::Array3;

use super::surfaces::step;
use super::{Bundle, Surfaces};

/// A sample on its way: cell (upper left of four pixels), where within it, and how much it counts.
#[derive(Clone, Copy)]
struct Ray {
    cell: u32,
    fx: f32,
    fy: f32,
    weight: f32,
    /// Which sample of which view.
    sample: u32,
}

/// Weight of a sample of the target view itself: it is there by definition.
const OWN: f32 = 2.0;

/// Renders the view `at` (row, column).
pub(super) fn view(bundle: &Bundle, surfaces: &Surfaces, at: (usize, usize)) -> Result<Array3<f32>> {
    let prior = bundle.single(at.0, at.1)?;
    let (h, w, c) = prior.dim();
    if w < 2 || h < 2 {
        return Ok(prior);
    }
    // Four lanes a pixel: up to three colours and the weight.
    let mut image: Vec<[f32; 4]> = vec![[0.0; 4]; w * h];
    for (p, q) in image.iter_mut().zip(prior.rows()) {
        for (a, b) in p.iter_mut().zip(q) {
            *a = *b;
        }
    }
    let values = pack(bundle);
    let rays = rays(bundle, surfaces, at, (w, h));
    for (blur, lambda) in [(true, 0.1f32), (false, 0.5)] {
        let mut sums: Vec<[f32; 4]> = vec![[0.0; 4]; w * h];
        for ray in &rays {
            let k = ray.cell as usize;
            let (fx, fy) = (ray.fx, ray.fy);
            let b = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
            let f = values[ray.sample as usize];
            let (p, q) = (&image[k..k + 2], &image[k + w..k + w + 2]);
            let mut r = [0f32; 4];
            for l in 0..3 {
                r[l] = ray.weight * (f[l] - (b[0] * p[0][l] + b[1] * p[1][l] + b[2] * q[0][l] + b[3] * q[1][l]));
            }
            r[3] = ray.weight;
            for (i, place) in [k, k + 1, k + w, k + w + 1].into_iter().enumerate() {
                for l in 0..4 {
                    sums[place][l] += b[i] * r[l];
                }
            }
        }
        if blur {
            binomial(&mut sums, w, h);
        }
        for (p, s) in image.iter_mut().zip(&sums) {
            let share = 1.0 / (s[3] + lambda);
            for l in 0..3 {
                p[l] += share * s[l];
            }
        }
    }
    Ok(Array3::from_shape_fn((h, w, c), |(t, s, k)| image[t * w + s][k]))
}

/// Values as four lanes, all views in a row.
fn pack(bundle: &Bundle) -> Vec<[f32; 4]> {
    let c = bundle.channels();
    bundle
        .values
        .rows()
        .into_iter()
        .map(|v| if c == 3 { [v[0], v[1], v[2], 0.0] } else { [v[0], 0.0, 0.0, 0.0] })
        .collect()
}

/// Where every sample of every view lies in the target view, leaving out what is hidden there.
fn rays(bundle: &Bundle, surfaces: &Surfaces, at: (usize, usize), size: (usize, usize)) -> Vec<Ray> {
    let views = (surfaces.rows, surfaces.columns);
    let own = at.0 * views.1 + at.1;
    let target = step(views, own);
    let n = bundle.points.len();
    let mut rays = Vec::with_capacity(n * views.0 * views.1);
    let (right, bottom) = ((size.0 - 1) as f32, (size.1 - 1) as f32);
    for k in 0..views.0 * views.1 {
        let from = step(views, k);
        let (du, dv) = (from[0] - target[0], from[1] - target[1]);
        let distance = du.abs().max(dv.abs());
        for (i, p) in bundle.points.iter().enumerate() {
            let d = surfaces.at(k, p[0], p[1]);
            let (x, y) = (p[0] - d * du, p[1] - d * dv);
            // Also turns away what is not a number.
            if !(x >= 0.0 && y >= 0.0 && x < right && y < bottom) {
                continue;
            }
            let weight = if k == own {
                OWN
            } else {
                // How far the surface seen here would carry the sample from where it is put.
                let miss = (surfaces.at(own, x, y) - d) * distance / TOLERANCE;
                let agree = 1.0 / (1.0 + miss * miss);
                agree * agree
            };
            if weight < 0.02 {
                continue;
            }
            let (x0, y0) = (x as usize, y as usize);
            rays.push(Ray {
                cell: (y0 * size.0 + x0) as u32,
                fx: x - x0 as f32,
                fy: y - y0 as f32,
                weight,
                sample: (k * n + i) as u32,
            });
        }
    }
    rays
}

/// Misplacement (pixels of the target) at which a sample counts a quarter.
const TOLERANCE: f32 = 0.6;

/// [1 2 1]/4 along both axes, in place, edges repeated.
fn binomial(image: &mut [[f32; 4]], w: usize, h: usize) {
    let mut before = image[..w].to_vec();
    for t in 0..h {
        let now = image[t * w..(t + 1) * w].to_vec();
        let below = if t + 1 < h { image[(t + 1) * w..(t + 2) * w].to_vec() } else { now.clone() };
        let mixed: Vec<[f32; 4]> =
            (0..w).map(|s| std::array::from_fn(|l| 0.25 * (before[s][l] + below[s][l]) + 0.5 * now[s][l])).collect();
        for s in 0..w {
            let (a, b) = (mixed[s.saturating_sub(1)], mixed[(s + 1).min(w - 1)]);
            image[t * w + s] = std::array::from_fn(|l| 0.25 * (a[l] + b[l]) + 0.5 * mixed[s][l]);
        }
        before = now;
    }
}

/// Tells `each` of every sample of every view: where it lies in the view `at`, how much it counts, its value.
pub(super) fn each_ray(
    bundle: &Bundle,
    surfaces: &Surfaces,
    at: (usize, usize),
    size: (usize, usize),
    mut each: impl FnMut(f32, f32, f32, &[f32]),
) {
    let values = pack(bundle);
    for ray in rays(bundle, surfaces, at, size) {
        let (x, y) = (ray.cell as usize % size.0, ray.cell as usize / size.0);
        each(x as f32 + ray.fx, y as f32 + ray.fy, ray.weight, &values[ray.sample as usize][..bundle.channels()]);
    }
}
