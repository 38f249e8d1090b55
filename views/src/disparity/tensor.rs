//! Structure tensor of the epipolar images (paper 4.3, after Wanner and Goldluecke): in an EPI a scene point draws a
//! line L(s, u) = f(s − D·u), so the eigenvector of least change of [[Σ L_s², Σ L_s·L_u], [·, Σ L_u²]] has slope D.

use lenslet_core::geometry::Size;
use lenslet_core::image::{Plane, box_mean};

use super::planes::shifted_row;

/// Slope and coherence of the lines through each pixel of the reference view.
pub struct Slopes {
    /// Disparity, output pixels per view step.
    pub disparity: Vec<f32>,
    /// Coherence, 0 (no direction stands out) to 1 (all gradients agree).
    pub coherence: Vec<f32>,
    /// Mean squared gradient along the view axes of the image: how much texture there is.
    pub energy: Vec<f32>,
}

/// Tensor over the EPIs sheared by `shear`, horizontal (all rows of views) and vertical (all columns) together. Lines
/// within about one pixel per view step of the shear are measured well. `grid[v][u]` are the views, `at` the reference
/// (v, u); views that `uses` denies, counted row by row, are left out.
pub fn slopes(
    grid: &[Vec<Plane>],
    at: (usize, usize),
    shear: f32,
    radius: usize,
    uses: &(dyn Fn(usize) -> bool + Sync),
) -> Slopes {
    let reference = &grid[at.0][at.1];
    let (w, h) = (reference.width, reference.height);
    let mut tensor = [vec![0f32; w * h], vec![0f32; w * h], vec![0f32; w * h]];
    let mut scratch = Vec::new();
    // Warped rows of the views, and of those above and below for the vertical gradients.
    let (rows, columns) = (grid.len(), grid[0].len());
    let mut warped = vec![vec![vec![0f32; w]; columns]; rows];
    let (mut above, mut below) = (warped.clone(), warped.clone());
    let fill = |t: usize, into: &mut Vec<Vec<Vec<f32>>>, scratch: &mut Vec<f32>| {
        for (v, line) in grid.iter().enumerate() {
            for (u, plane) in line.iter().enumerate() {
                let (du, dv) = (u as f32 - at.1 as f32, v as f32 - at.0 as f32);
                shifted_row(plane, t, shear * du, shear * dv, scratch, &mut into[v][u]);
            }
        }
    };
    fill(0, &mut above, &mut scratch);
    fill(0, &mut warped, &mut scratch);
    // Along the views the derivative is the slope of the regression line over all of them, not a difference of two.
    let (mut mean_row, mut slope) = (vec![0f32; w], vec![0f32; w]);
    for t in 0..h {
        fill((t + 1).min(h - 1), &mut below, &mut scratch);
        let [jss, jsu, juu] = &mut tensor;
        for (v, line) in warped.iter().enumerate().filter(|_| columns > 1) {
            let used = |u: usize| uses(v * columns + u);
            if !regress(line.iter().map(|r| r.as_slice()), columns, &used, &mut mean_row, &mut slope) {
                continue;
            }
            for s in 1..w.saturating_sub(1) {
                add(jss, jsu, juu, t * w + s, 0.5 * (mean_row[s + 1] - mean_row[s - 1]), slope[s]);
            }
        }
        for u in (0..columns).filter(|_| rows > 1) {
            let used = |v: usize| uses(v * columns + u);
            if !regress(warped.iter().map(|l| l[u].as_slice()), rows, &used, &mut mean_row, &mut slope) {
                continue;
            }
            mean_row.fill(0.0);
            let count = (0..rows).filter(|&v| used(v)).count();
            for (_, (a, b)) in above.iter().zip(&below).enumerate().filter(|(v, _)| used(*v)) {
                for ((m, x), y) in mean_row.iter_mut().zip(&a[u]).zip(&b[u]) {
                    *m += y - x;
                }
            }
            for s in 0..w {
                add(jss, jsu, juu, t * w + s, 0.5 * mean_row[s] / count as f32, slope[s]);
            }
        }
        std::mem::swap(&mut above, &mut warped);
        std::mem::swap(&mut warped, &mut below);
    }
    let [mut jss, mut jsu, mut juu] = tensor;
    let mut mean = Vec::new();
    for j in [&mut jss, &mut jsu, &mut juu] {
        // Two boxes in a row: close to a Gaussian window.
        box_mean(j, Size::new(w, h), radius, &mut mean);
        box_mean(&mean, Size::new(w, h), radius, j);
    }
    let mut out = Slopes { disparity: vec![], coherence: vec![], energy: vec![] };
    for k in 0..w * h {
        let (a, b, c) = (jss[k], jsu[k], juu[k]);
        // Lines f(s − Δ·u): L_u = −Δ·L_s; the angle of the main gradient (L_s, L_u) gives Δ = −tan.
        let angle = 0.5 * (2.0 * b).atan2(a - c);
        let spread = ((a - c) * (a - c) + 4.0 * b * b).sqrt();
        // The views were sheared by `shear`; this is what is left of the slope.
        out.disparity.push(shear + (-angle.tan()).clamp(-4.0, 4.0));
        out.coherence.push(if a + c > 0.0 { spread / (a + c) } else { 0.0 });
        out.energy.push(a);
    }
    out
}

#[inline]
fn add(jss: &mut [f32], jsu: &mut [f32], juu: &mut [f32], k: usize, ls: f32, lu: f32) {
    jss[k] += ls * ls;
    jsu[k] += ls * lu;
    juu[k] += lu * lu;
}

/// Mean and slope over those of `n` evenly spaced rows that are `used`, column by column; false where these are fewer
/// than two.
fn regress<'a>(
    rows: impl Iterator<Item = &'a [f32]>,
    n: usize,
    used: &dyn Fn(usize) -> bool,
    mean: &mut [f32],
    slope: &mut [f32],
) -> bool {
    mean.fill(0.0);
    slope.fill(0.0);
    let count = (0..n).filter(|&k| used(k)).count();
    if count < 2 {
        return false;
    }
    let middle = (0..n).filter(|&k| used(k)).map(|k| k as f32).sum::<f32>() / count as f32;
    let squares: f32 = (0..n).filter(|&k| used(k)).map(|k| (k as f32 - middle).powi(2)).sum();
    for (k, row) in rows.enumerate().filter(|(k, _)| used(*k)) {
        let (share, weight) = (1.0 / count as f32, (k as f32 - middle) / squares.max(1e-6));
        for ((m, s), &v) in mean.iter_mut().zip(slope.iter_mut()).zip(row) {
            *m += share * v;
            *s += weight * v;
        }
    }
    true
}
