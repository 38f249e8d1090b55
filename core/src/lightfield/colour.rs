//! The sRGB transfer curve (IEC 61966-2-1): linear light 0..1 to encoded values 0..1 and back.
//!
//! Values below 0 are mirrored, values above 1 follow the curve, so both directions stay inverse to each other.

use ndarray::{ArrayBase, DataMut, Dimension};
use serde::{Deserialize, Serialize};

/// How values relate to light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ColourSpace {
    /// sRGB primaries, sRGB transfer curve.
    Srgb,
    /// sRGB primaries, linear light.
    Linear,
}

/// Linear light to its sRGB-encoded value.
pub fn encode(linear: f32) -> f32 {
    let x = linear.abs();
    let y = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    y.copysign(linear)
}

/// sRGB-encoded value to linear light.
pub fn decode(encoded: f32) -> f32 {
    let x = encoded.abs();
    let y = if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
    y.copysign(encoded)
}

/// Converts values in place from one colour space to another.
pub fn convert<S: DataMut<Elem = f32>, D: Dimension>(values: &mut ArrayBase<S, D>, from: ColourSpace, to: ColourSpace) {
    match (from, to) {
        (ColourSpace::Linear, ColourSpace::Srgb) => values.mapv_inplace(encode),
        (ColourSpace::Srgb, ColourSpace::Linear) => values.mapv_inplace(decode),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values_and_inverse() {
        // 0.5 encoded is 0.214041 in linear light (IEC 61966-2-1, worked by hand).
        assert!((decode(0.5) - 0.214_041).abs() < 1e-6);
        assert!((encode(1.0) - 1.0).abs() < 1e-6 && encode(0.0) == 0.0);
        for i in -20..=60 {
            let x = i as f32 / 40.0;
            assert!((decode(encode(x)) - x).abs() < 2e-5, "{x}");
        }
    }
}
