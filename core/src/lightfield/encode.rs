//! Linear light to sRGB for whole views, by a table: computing a power per value would take longer than all the rest.

use std::sync::OnceLock;

use ndarray::Array3;
use rayon::prelude::*;

use crate::colour::srgb_encode;

/// Intervals of the table. The curve bends most just above 0.0031; there the straight pieces are within 4e-7 of it.
const STEPS: usize = 1 << 15;

fn table() -> &'static [f32] {
    static TABLE: OnceLock<Vec<f32>> = OnceLock::new();
    // One entry past the end, so that 1.0 needs no special case.
    TABLE.get_or_init(|| (0..=STEPS + 1).map(|k| srgb_encode(k as f32 / STEPS as f32)).collect())
}

/// A view in linear light, sRGB-encoded. Values are clamped to 0..1; NaN becomes 0.
pub(super) fn encode_srgb(view: &Array3<f32>) -> Array3<f32> {
    let table = table();
    let mut out = view.as_standard_layout().into_owned();
    if let Some(flat) = out.as_slice_mut() {
        flat.par_chunks_mut(1 << 15).for_each(|part| {
            for v in part {
                // max before min, not clamp: NaN becomes 0.
                #[allow(clippy::manual_clamp)]
                let x = v.max(0.0).min(1.0) * STEPS as f32;
                let k = (x as usize).min(STEPS);
                let (a, b) = (table[k], table[k + 1]);
                *v = a + (x - k as f32) * (b - a);
            }
        });
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_the_curve() {
        let n = 1_000_003;
        let view = Array3::from_shape_fn((1, n, 1), |(_, k, _)| k as f32 / (n - 1) as f32);
        for (x, y) in view.iter().zip(&encode_srgb(&view)) {
            // Far below half a step of 16 bits, 7.6e-6; worst at the bend of the curve.
            assert!((srgb_encode(*x) - y).abs() < 2e-6, "{x}: {y}");
        }
        let odd = Array3::from_shape_vec((1, 4, 1), vec![-1.0, 2.0, f32::NAN, f32::INFINITY]).unwrap();
        assert_eq!(encode_srgb(&odd).as_slice().unwrap()[0], 0.0);
        assert_eq!(encode_srgb(&odd).as_slice().unwrap()[2], 0.0);
        for k in [1, 3] {
            assert!((encode_srgb(&odd).as_slice().unwrap()[k] - 1.0).abs() < 1e-6);
        }
    }
}
