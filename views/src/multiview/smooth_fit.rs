//! The smooth fit (an alternative to the triangulation of section 4.3): pixels I minimising Σ w_i (f_i −
//! B(x_i)·I)² + λ|I − prior|², B bilinear, by a few steps of diagonally preconditioned descent from the prior, which is
//! the interpolation of the view's own samples. The samples of the other views are fitted first; those of the view
//! itself then validate the fit (see [`super::cross_validation`]) and enter last.

use lenslet_core::geometry::Size;
use ndarray::Array3;

use super::cross_validation::{Cells, cross_validate};
use super::rays::{OWN, other_samples, own_samples};
use super::sample_set::SampleSet;
use super::view_disparities::ViewDisparities;
use crate::Error;

/// Renders the view `at` (row, column).
pub(super) fn render_view(
    set: &SampleSet,
    disparities: &ViewDisparities,
    at: (usize, usize),
) -> Result<Array3<f32>, Error> {
    let prior = set.single(at.0, at.1)?;
    let (h, w, c) = prior.dim();
    if w < 2 || h < 2 {
        return Ok(prior);
    }
    let alone = lanes(&prior);
    let mut image = alone.clone();
    let rays = other_samples(set, disparities, at, Size::new(w, h));
    // How far the samples of the other views are from the prior.
    let mut prior_residual = Cells::new(w, h);
    let mut sums: Vec<[f32; 4]> = vec![[0.0; 4]; w * h];
    for (round, lambda) in [0.1f32, 0.5].into_iter().enumerate() {
        sums.fill([0.0; 4]);
        for ray in &rays {
            let b = ray.shares();
            let r = ray.residual(&b, &set.lanes[ray.sample as usize], &image, w);
            let m = ray.weight;
            if round == 0 {
                let k = ray.cell as usize;
                prior_residual.add(k % w, k / w, [m * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]), m]);
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
    // Leave-one-view-out residual. An own sample f_i at x_i is predicted by the image I of the others; with
    // s = w/(w + ½), the share of the others in a pixel of weight w, and c_i = B(x_i)·s, the residual f_i − B(x_i)·I is
    // c_i times the error of the others (the prior, made of the own samples, contributes none). So the mean square is
    // Σ (f_i − B(x_i)·I)² / Σ c_i².
    let own = own_samples(set, disparities, at, Size::new(w, h));
    let (mut fit_residual, mut light) = (Cells::new(w, h), Cells::new(w, h));
    for ray in &own {
        let b = ray.shares();
        let r = ray.residual(&b, &set.lanes[ray.sample as usize], &image, w);
        let k = ray.cell as usize;
        let share = |s: &[f32; 4]| s[3] / (s[3] + 0.5);
        let c = b[0] * share(&sums[k])
            + b[1] * share(&sums[k + 1])
            + b[2] * share(&sums[k + w])
            + b[3] * share(&sums[k + w + 1]);
        fit_residual.add(k % w, k / w, [r[0] * r[0] + r[1] * r[1] + r[2] * r[2], c * c]);
        let f = &set.lanes[ray.sample as usize];
        light.add(k % w, k / w, [f[0] + f[1] + f[2], 1.0]);
    }
    let weight = cross_validate(&prior_residual, &fit_residual, &light, set.noise(at));
    for (k, ((p, a), s)) in image.iter_mut().zip(&alone).zip(&mut sums).enumerate() {
        let share = weight.at(k % w, k / w);
        for l in 0..3 {
            p[l] = a[l] + share * (p[l] - a[l]);
        }
        // From here on: residuals of the own samples, and the weight already there.
        *s = [0.0, 0.0, 0.0, s[3] * share];
    }
    let mut weights: Vec<[f32; 4]> = vec![[0.0; 4]; w * h];
    for ray in &own {
        let b = ray.shares();
        let r = ray.residual(&b, &set.lanes[ray.sample as usize], &image, w);
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
