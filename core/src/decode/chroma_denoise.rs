//! Chroma denoising: the colour noise of a view is smoothed over its lattice; edges of its light are kept.
//!
//! For captures whose colours a lossy coder damaged. A mosaic saved as JPEG is one: filter colours differ from
//! pixel to pixel, JPEG quantises just that frequency away in some of its 8×8 blocks and keeps it in others, and where
//! lenslet rows (8.6 pixels apart) drift against the blocks, bands of colour and of grey follow each other.
//!
//! Edge-avoiding à-trous smoothing (Dammertz et al. 2010) of the colour over the light: passes over the six neighbours
//! at distances 1, 2, 4 and 8 lenslets, each neighbour weighted by how alike its light is. The light itself is not
//! touched.

use std::collections::HashMap;

use ndarray::Array3;
use rayon::prelude::*;

/// Distances of the passes, lenslets.
///
/// Source: chosen; the powers of two of the à-trous scheme.
const PASSES: [i32; 4] = [1, 2, 4, 8];
/// Neighbours whose light differs by this share have half the weight.
///
/// Source: chosen.
const HALF_WEIGHT_CONTRAST: f32 = 0.25;
/// Light below which differences are noise; share of full light.
///
/// Source: chosen.
const DARK: f32 = 0.02;
/// Weights of red, green, blue in the light, before the colour matrix.
///
/// Source: chosen; the shares of the filter array's pixels.
const LIGHT: [f32; 3] = [0.25, 0.5, 0.25];

/// Smooths the colours of `values` (views, lenslets, 3), camera colours after white balance, on a hexagonal or square
/// lattice; `index` holds the lattice index of each lenslet.
pub(super) fn smooth_colours(values: &mut Array3<f32>, index: &[[i32; 2]], hexagonal: bool) {
    let (_, lenslets, channels) = values.dim();
    if channels != 3 || lenslets == 0 || index.len() != lenslets {
        return;
    }
    let places: HashMap<[i32; 2], u32> = index.iter().enumerate().map(|(k, i)| (*i, k as u32)).collect();
    // Hexagonal rows lean by 60 degrees, so the third pair of neighbours is along (1, −1).
    let ring: &[[i32; 2]] = if hexagonal {
        &[[1, 0], [-1, 0], [0, 1], [0, -1], [1, -1], [-1, 1]]
    } else {
        &[[1, 0], [-1, 0], [0, 1], [0, -1]]
    };
    // Neighbours past the border are the lenslet itself.
    let tables: Vec<Vec<u32>> = PASSES
        .iter()
        .map(|&distance| {
            let near =
                |i: &[i32; 2], d: &[i32; 2]| places.get(&[i[0] + distance * d[0], i[1] + distance * d[1]]).copied();
            let of =
                |(k, i): (usize, &[i32; 2])| ring.iter().map(|d| near(i, d).unwrap_or(k as u32)).collect::<Vec<_>>();
            index.iter().enumerate().flat_map(of).collect()
        })
        .collect();
    if let Some(flat) = values.as_slice_mut() {
        flat.par_chunks_mut(3 * lenslets).for_each(|view| smooth_view(view, &tables, ring.len()));
    }
}

/// One view.
fn smooth_view(view: &mut [f32], tables: &[Vec<u32>], ring: usize) {
    let pixels = view.as_chunks_mut::<3>().0;
    let light: Vec<f32> = pixels.iter().map(|p| (0..3).map(|c| LIGHT[c] * p[c]).sum()).collect();
    let mut colour: Vec<[f32; 3]> =
        pixels.iter().zip(&light).map(|(p, &l)| [p[0] - l, p[2] - l, l.max(0.0) + DARK]).collect();
    let mut next = colour.clone();
    for table in tables {
        for (k, near) in table.chunks_exact(ring).enumerate() {
            let mut sum = colour[k];
            for &n in near {
                let n = n as usize;
                let unlike = (light[n] - light[k]) / (HALF_WEIGHT_CONTRAST * (light[k].max(0.0) + DARK));
                let weight = 1.0 / (1.0 + unlike * unlike);
                for (s, c) in sum.iter_mut().zip(colour[n]) {
                    *s += weight * c;
                }
            }
            // Colour and light are summed together, so bright neighbours, whose colour is least noisy, have the most
            // weight.
            let scale = colour[k][2] / sum[2];
            next[k] = [sum[0] * scale, sum[1] * scale, colour[k][2]];
        }
        std::mem::swap(&mut colour, &mut next);
    }
    for ((p, c), &l) in pixels.iter_mut().zip(&colour).zip(&light) {
        let (r, b) = (l + c[0], l + c[1]);
        *p = [r, (l - LIGHT[0] * r - LIGHT[2] * b) / LIGHT[1], b];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: i32 = 40;

    fn index() -> Vec<[i32; 2]> {
        (0..SIDE * SIDE).map(|k| [k % SIDE - k / SIDE / 2, k / SIDE]).collect()
    }

    fn values(of: impl Fn(i32, i32) -> [f32; 3]) -> Array3<f32> {
        let all: Vec<f32> = (0..SIDE * SIDE).flat_map(|k| of(k % SIDE, k / SIDE)).collect();
        Array3::from_shape_vec((1, (SIDE * SIDE) as usize, 3), all).unwrap()
    }

    fn light(v: &Array3<f32>, k: usize) -> f32 {
        (0..3).map(|c| LIGHT[c] * v[[0, k, c]]).sum()
    }

    #[test]
    fn one_colour_stays_and_light_is_never_touched() {
        // One colour under changing light.
        let shade = |x: i32, y: i32| 0.3 + 0.2 * ((x * 7 + y * 3) % 11) as f32 / 11.0;
        let even = values(|x, y| [0.5, 1.0, 0.25].map(|c| c * shade(x, y)));
        let mut out = even.clone();
        smooth_colours(&mut out, &index(), true);
        for k in 0..out.dim().1 {
            assert!((light(&out, k) - light(&even, k)).abs() < 1e-6);
            for c in 0..3 {
                assert!((out[[0, k, c]] - even[[0, k, c]]).abs() < 0.01, "{k}");
            }
        }
    }

    #[test]
    fn bands_of_colour_vanish_and_colours_do_not_cross_edges_of_light() {
        // Alternating rows of green and grey on the left, red on the right, which is twice as bright.
        let scene = |x: i32, y: i32| match (x < SIDE / 2, y / 3 % 2) {
            (true, 0) => [0.1, 0.25, 0.1],
            (true, _) => [0.175, 0.175, 0.175],
            _ => [0.7, 0.3, 0.3],
        };
        let mut out = values(scene);
        smooth_colours(&mut out, &index(), true);
        let green = |x: i32, y: i32| {
            let k = (y * SIDE + x) as usize;
            (out[[0, k, 1]] - out[[0, k, 0]]) / light(&out, k)
        };
        let column: Vec<f32> = (12..28).map(|y| green(9, y)).collect();
        let (low, high) = column.iter().fold((f32::MAX, f32::MIN), |(l, h), &v| (l.min(v), h.max(v)));
        // They alternated between 0 and 0.86.
        assert!(low > 0.25 && high - low < 0.2, "{column:?}");
        // A lenslet away from the edge red is still red, green not.
        assert!(green(SIDE / 2 + 1, 20) < -0.7 && green(SIDE / 2 - 2, 20) > 0.1, "{} {}", green(21, 20), green(18, 20));
    }

    #[test]
    fn grey_light_and_odd_shapes_are_left_alone() {
        let mut mono = Array3::from_elem((1, 4, 1), 0.5);
        smooth_colours(&mut mono, &[[0, 0], [1, 0], [2, 0], [3, 0]], false);
        assert!(mono.iter().all(|v| *v == 0.5));
        let mut few = Array3::from_elem((1, 2, 3), 0.5);
        smooth_colours(&mut few, &[[0, 0]], true);
        assert!(few.iter().all(|v| *v == 0.5));
        smooth_colours(&mut few, &[[0, 0], [1, 0]], false);
        assert!(few.iter().all(|v| (*v - 0.5).abs() < 1e-6));
    }
}
