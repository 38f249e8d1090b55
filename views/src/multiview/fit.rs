//! The smooth fit (our way past 4.3's triangulation): pixels I minimising Σ w_i (f_i − B(x_i)·I)² + λ|I − prior|², B bilinear,
//! by a few steps of diagonally preconditioned descent from the prior, which is what one view alone gives. The samples of the
//! other views are fitted first; those of the view itself then judge the fit (see [`super::trust`]) and enter last.

use crate::Error;
use ndarray::Array3;

use super::surfaces::step;
use super::trust::{Cells, trust};
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

impl Ray {
    fn new(x: f32, y: f32, w: usize, weight: f32, sample: usize) -> Ray {
        let (x0, y0) = (x as usize, y as usize);
        Ray { cell: (y0 * w + x0) as u32, fx: x - x0 as f32, fy: y - y0 as f32, weight, sample: sample as u32 }
    }

    /// Shares of the four pixels.
    #[inline]
    fn shares(&self) -> [f32; 4] {
        let (fx, fy) = (self.fx, self.fy);
        [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy]
    }

    /// What is left of the sample when the image is taken away; the lane of the weight is 0.
    #[inline]
    fn residual(&self, b: &[f32; 4], f: &[f32; 4], image: &[[f32; 4]], w: usize) -> [f32; 4] {
        let k = self.cell as usize;
        let (p, q) = (&image[k..k + 2], &image[k + w..k + w + 2]);
        let mut r = [0f32; 4];
        for l in 0..3 {
            r[l] = f[l] - (b[0] * p[0][l] + b[1] * p[1][l] + b[2] * q[0][l] + b[3] * q[1][l]);
        }
        r
    }

    /// Adds `value` to the four pixels by their shares.
    #[inline]
    fn spread(&self, b: &[f32; 4], value: &[f32; 4], sums: &mut [[f32; 4]], w: usize) {
        let k = self.cell as usize;
        for (b, at) in b.iter().zip([k, k + 1, k + w, k + w + 1]) {
            for l in 0..4 {
                sums[at][l] += b * value[l];
            }
        }
    }
}

/// Weight of a sample of the target view itself: it is there by definition.
const OWN: f32 = 2.0;

/// Misplacement (pixels of the target) at which a sample counts a quarter.
const TOLERANCE: f32 = 0.6;

/// Renders the view `at` (row, column).
pub(super) fn view(bundle: &Bundle, surfaces: &Surfaces, at: (usize, usize)) -> Result<Array3<f32>, Error> {
    let prior = bundle.single(at.0, at.1)?;
    let (h, w, c) = prior.dim();
    if w < 2 || h < 2 {
        return Ok(prior);
    }
    let alone = lanes(&prior);
    let mut image = alone.clone();
    let rays = others(bundle, surfaces, at, (w, h));
    // How far the samples of the other views are from the prior.
    let mut surprise = Cells::new(w, h);
    let mut sums: Vec<[f32; 4]> = vec![[0.0; 4]; w * h];
    for (round, lambda) in [0.1f32, 0.5].into_iter().enumerate() {
        sums.fill([0.0; 4]);
        for ray in &rays {
            let b = ray.shares();
            let r = ray.residual(&b, &bundle.lanes[ray.sample as usize], &image, w);
            let m = ray.weight;
            if round == 0 {
                let k = ray.cell as usize;
                surprise.add(k % w, k / w, [m * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]), m]);
            }
            ray.spread(&b, &[m * r[0], m * r[1], m * r[2], m], &mut sums, w);
        }
        if round == 0 {
            binomial(&mut sums, w, h);
        }
        for (p, s) in image.iter_mut().zip(&sums) {
            let share = 1.0 / (s[3] + lambda);
            for l in 0..3 {
                p[l] += share * s[l];
            }
        }
    }
    drop(rays);
    // The view's own samples, foretold by the others. Where these left a pixel to the prior, which knows the own samples, they
    // foretold nothing: a miss is only the share of the others in the image times what they are off by.
    let own = own(bundle, surfaces, at, (w, h));
    let (mut misfit, mut light) = (Cells::new(w, h), Cells::new(w, h));
    for ray in &own {
        let b = ray.shares();
        let r = ray.residual(&b, &bundle.lanes[ray.sample as usize], &image, w);
        let k = ray.cell as usize;
        let share = |s: &[f32; 4]| s[3] / (s[3] + 0.5);
        let c = b[0] * share(&sums[k])
            + b[1] * share(&sums[k + 1])
            + b[2] * share(&sums[k + w])
            + b[3] * share(&sums[k + w + 1]);
        misfit.add(k % w, k / w, [r[0] * r[0] + r[1] * r[1] + r[2] * r[2], c * c]);
        let f = &bundle.lanes[ray.sample as usize];
        light.add(k % w, k / w, [f[0] + f[1] + f[2], 1.0]);
    }
    let trust = trust(&surprise, &misfit, &light, bundle.noise(at));
    for (k, ((p, a), s)) in image.iter_mut().zip(&alone).zip(&mut sums).enumerate() {
        let believed = trust.at(k % w, k / w);
        for l in 0..3 {
            p[l] = a[l] + believed * (p[l] - a[l]);
        }
        // From here on: what the own samples leave, and the weight already there.
        *s = [0.0, 0.0, 0.0, s[3] * believed];
    }
    let mut weights: Vec<[f32; 4]> = vec![[0.0; 4]; w * h];
    for ray in &own {
        let b = ray.shares();
        let r = ray.residual(&b, &bundle.lanes[ray.sample as usize], &image, w);
        ray.spread(&b, &[OWN * r[0], OWN * r[1], OWN * r[2], OWN], &mut weights, w);
    }
    for ((p, s), o) in image.iter_mut().zip(&sums).zip(&weights) {
        let share = 1.0 / (s[3] + o[3] + 0.5);
        for l in 0..3 {
            p[l] += share * o[l];
        }
    }
    Ok(Array3::from_shape_fn((h, w, c), |(t, s, k)| image[t * w + s][k]))
}

/// A picture as four lanes a pixel: up to three colours, and a place for the weight.
fn lanes(picture: &Array3<f32>) -> Vec<[f32; 4]> {
    let mut out = vec![[0f32; 4]; picture.dim().0 * picture.dim().1];
    for (p, q) in out.iter_mut().zip(picture.rows()) {
        for (a, b) in p.iter_mut().zip(q) {
            *a = *b;
        }
    }
    out
}

/// The samples of the view itself.
fn own(bundle: &Bundle, surfaces: &Surfaces, at: (usize, usize), size: (usize, usize)) -> Vec<Ray> {
    let first = (at.0 * surfaces.columns + at.1) * bundle.points.len();
    let (right, bottom) = ((size.0 - 1) as f32, (size.1 - 1) as f32);
    let inside = |p: &[f32; 2]| p[0] >= 0.0 && p[1] >= 0.0 && p[0] < right && p[1] < bottom;
    let points = bundle.points.iter().enumerate().filter(|(_, p)| inside(p));
    points.map(|(i, p)| Ray::new(p[0], p[1], size.0, OWN, first + i)).collect()
}

/// Where every sample of every other view lies in the target view, leaving out what is hidden there.
fn others(bundle: &Bundle, surfaces: &Surfaces, at: (usize, usize), size: (usize, usize)) -> Vec<Ray> {
    let views = (surfaces.rows, surfaces.columns);
    let target_view = at.0 * views.1 + at.1;
    let target = step(views, target_view);
    let n = bundle.points.len();
    let mut rays = Vec::with_capacity(n * (views.0 * views.1).saturating_sub(1));
    let (right, bottom) = ((size.0 - 1) as f32, (size.1 - 1) as f32);
    for k in (0..views.0 * views.1).filter(|&k| k != target_view) {
        let from = step(views, k);
        let (du, dv) = (from[0] - target[0], from[1] - target[1]);
        let distance = du.abs().max(dv.abs()) / TOLERANCE;
        // Noise grows as light falls.
        let light = bundle.weights[k] * bundle.weights[k];
        for (i, (p, d)) in bundle.points.iter().zip(&surfaces.samples[k * n..(k + 1) * n]).enumerate() {
            let (x, y) = (p[0] - d * du, p[1] - d * dv);
            // Also turns away what is not a number.
            if !(x >= 0.0 && y >= 0.0 && x < right && y < bottom) {
                continue;
            }
            // How far the surface seen here would carry the sample from where it is put.
            let miss = (surfaces.near(target_view, x, y) - d) * distance;
            let agree = 1.0 / (1.0 + miss * miss);
            let weight = light * agree * agree;
            if weight >= 0.02 {
                rays.push(Ray::new(x, y, size.0, weight, k * n + i));
            }
        }
    }
    rays
}

/// [1 2 1]/4 along both axes, in place, edges repeated.
fn binomial(image: &mut [[f32; 4]], w: usize, h: usize) {
    let mut before = image[..w].to_vec();
    let mut now = before.clone();
    let mut mixed = before.clone();
    for t in 0..h {
        now.copy_from_slice(&image[t * w..(t + 1) * w]);
        let below = if t + 1 < h { &image[(t + 1) * w..(t + 2) * w] } else { &now[..] };
        for (((m, a), b), c) in mixed.iter_mut().zip(&before).zip(below).zip(&now) {
            *m = std::array::from_fn(|l| 0.25 * (a[l] + b[l]) + 0.5 * c[l]);
        }
        for s in 0..w {
            let (a, b) = (mixed[s.saturating_sub(1)], mixed[(s + 1).min(w - 1)]);
            image[t * w + s] = std::array::from_fn(|l| 0.25 * (a[l] + b[l]) + 0.5 * mixed[s][l]);
        }
        std::mem::swap(&mut before, &mut now);
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
    for ray in own(bundle, surfaces, at, size).into_iter().chain(others(bundle, surfaces, at, size)) {
        let (x, y) = (ray.cell as usize % size.0, ray.cell as usize / size.0);
        let value = &bundle.lanes[ray.sample as usize][..bundle.channels()];
        each(x as f32 + ray.fx, y as f32 + ray.fy, ray.weight, value);
    }
}
